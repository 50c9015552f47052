"""What users of Python and of notebooks have: evaluate, compare, Results, Store, tasks, bound."""

import sys
import types

import pytest

import sins_env
from sins_env.evaluation.play import progress

SCENARIO = {
    "name": "short-ferry-v0",
    "motion": {"roll": {"amplitude_deg": 4, "period_s": 9}},
    "samples_per_epoch": 10,
    "duration_s": 20,
    "score": {"azimuth_deg": 10, "level_arcsec": 300, "hold_s": 5},
}


def test_from_a_dict_to_a_board(tmp_path):
    """Two solvers on a task of one's own; the file gives the same board again, and runs that are there stay."""
    with sins_env.Store.open(tmp_path / "a.sqlite") as store:
        board = store.fill(SCENARIO, ["kf", "ekf"], 3, workers=1)
        assert [one.solver for one in board] == ["kf", "ekf"]
        assert [row["runs"] for row in board.rows()] == [3, 3]
        assert repr(board) == repr(store.board(["short-ferry-v0"]))
        assert "short-ferry-v0" in repr(board).splitlines()[0]
        assert board._repr_html_().startswith("<pre>")
        assert len(store.fill(SCENARIO, "kf", 4, workers=1)[0].records) == 4
        changed = {**SCENARIO, "duration_s": 21}
        with pytest.raises(ValueError, match="short-ferry-v0 has changed since its runs were made, its definition"):
            store.fill(changed, "kf", 3, workers=1)
        assert "azimuth score, ratio" in str(sins_env.compare(board[0], board[1]))
    one = sins_env.evaluate(SCENARIO, "kf", 3, workers=1, cost=False)
    assert repr(one) == "<Results of kf on short-ferry-v0: 3 runs>"
    assert one.row()["runs"] == 3
    assert one.row()["score of the azimuth"] == board[0].row()["score of the azimuth"]
    rows = one.rows()
    assert [row["run"] for row in rows] == [0, 1, 2]
    assert {type(value) for row in rows for value in row.values()} <= {int, float, str}
    assert rows[1]["final_u_rad"] == one.records.final[1, 2]
    assert one._repr_html_().startswith("<table><tr><th>task</th><td>short-ferry-v0</td>")


def test_public_names():
    assert sins_env.tasks.load(SCENARIO) == sins_env.tasks.get(SCENARIO)
    assert "sway-white-v0" in sins_env.tasks.names()
    assert all(hasattr(sins_env, name) for name in sins_env.__all__)
    assert sins_env.bound(SCENARIO).t[-1] == pytest.approx(20)


def test_progress_shows_in_a_notebook(monkeypatch):
    """A terminal's bar would be lost there: one line of text in the output of the cell is replaced instead."""
    shown = []
    handle = types.SimpleNamespace(update=lambda data, raw: shown.append(data["text/plain"]))
    package, module = types.ModuleType("IPython"), types.ModuleType("IPython.display")
    package.get_ipython = type("ZMQInteractiveShell", (), {})
    module.display = lambda data, raw, display_id: shown.append(data["text/plain"]) or handle
    monkeypatch.setitem(sys.modules, "IPython", package)
    monkeypatch.setitem(sys.modules, "IPython.display", module)
    sins_env.evaluate(SCENARIO, "kf", 3, workers=1, chunk=1, cost=False)
    with progress.Bar("a bar") as bar:
        bar.update(1.0, 4.0, "note")
    assert shown.pop().startswith("a bar  25%  0:00:00 left  note")
    assert shown.pop() == "a bar"
    assert shown[0] == "kf on short-ferry-v0"
    assert shown[1].startswith("kf on short-ferry-v0  ")
    assert "100%" in shown[-1]
