"""What readers see of navigation tasks: what ranks stays in sight, figures draw what tables say, rounding is no difference."""

import csv
import dataclasses

import numpy as np
import pytest
from evaluation.score.test_navigation import CRITERIA, FLIGHT, errors_of, solver

from sins_env.cli.verbs.run import averaging_spans
from sins_env.evaluation import compare, evaluate
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.play.records import Records, score
from sins_env.evaluation.report import page_tables
from sins_env.evaluation.report.page_figures import drawings
from sins_env.evaluation.report.panel import Lineup
from sins_env.evaluation.score.repeatability import shares_headings
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show import error_figure, footer, plain_tables, terminal_tables
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.store.verify import compare_runs
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.units import DEG


def printed(results, width, capsys):
    from rich.console import Console

    terminal_tables.print_tables(results, Console(width=width))
    return capsys.readouterr().out


@pytest.fixture
def hot():
    """Of thirty runs ten fail, or three."""
    lines = []
    for name, failed in (("many", 10), ("few", 3)):
        angle = np.where(np.arange(30) < failed, 10 * DEG, 1e-3)
        lines.append(solver(name, {"phi_u": angle, "heading": angle}, rank_by="failures", fail_azimuth_deg=5.0))
    return lines


def test_a_narrow_terminal_shows_what_ranks(hot, capsys):
    text = printed(hot, 60, capsys)
    assert "Left out in 60 columns" in text
    assert "10 diverged" in text
    assert "score" in text.split("─")[0]
    assert "10 of 30" in text


def test_failed_runs_are_compared_in_pairs(hot):
    """Ten against three of the same thirty: Bonett and Price with 7 discordant pairs, all on one side."""
    found = compare(*hot)
    p, q, n = (7 + 1) / 32, 1 / 32, 30
    half = 1.959964 * np.sqrt((p + q - (p - q) ** 2) / (n + 2))
    assert found.failures[0] == pytest.approx(7 / 30)
    np.testing.assert_allclose(found.failures[1], (p - q - half, p - q + half), rtol=1e-6)
    assert "failed runs, difference    +23.3% [" in str(found)


def test_curves_are_of_the_lengths_in_the_table(monkeypatch):
    """Errors 3 and 4 m east and north: 5 m in table, curve of the report and figure; a threshold is of a component only."""
    one = solver("one", {"pos_e": np.full(10, 3.0), "pos_n": np.full(10, 4.0), "phi_e": np.full(10, 1e-5)})
    assert one.summary.navigation.armse["position_h"][0] == pytest.approx(5.0)
    drawn = {}
    monkeypatch.setattr(
        "sins_env.evaluation.report.panel.inline",
        lambda figure, name, *rest: drawn.setdefault(name, [line.get_ydata() for line in figure.axes[0].lines]) and "",
    )
    captions = {d.title: d.caption for d in drawings(Lineup([one], {}, "t"))}
    np.testing.assert_allclose(drawn["t-t-position_h"], [np.full(100, 5.0)], rtol=1e-6)
    assert len(drawn["t-t-level"]) == 1
    assert len(drawn["t-t-azimuth"]) == 2
    assert not any("component" in caption for caption in captions.values())
    (panel,) = [
        axes for axes in error_figure.error_figure([one]).axes if axes.get_title(loc="left").startswith("position")
    ]
    np.testing.assert_allclose(panel.lines[0].get_ydata(), 5.0, rtol=1e-6)
    sizes = np.array([[3.0, 4.0]])
    np.testing.assert_allclose(
        [error_figure.size_of(sizes, True), error_figure.size_of(sizes, False)], [[np.sqrt(12.5)], [5.0]]
    )


def test_failures_stand_beside_the_main_error_on_the_page(hot):
    heads = [name for name, _ in page_tables.heads_of(hot)]
    assert heads[:4] == ["score", "failed", "median", "against ckf"]
    assert heads.count("failed") == 1
    assert "median time" not in heads
    assert "fine alignment" not in footer.footer(hot)


def test_a_task_without_the_bound_of_its_main_error_has_no_mark_for_it(hot):
    vars(hot[0])["bound_means"] = {"azimuth": float("nan")}
    assert page_tables.whiskers(hot[:1])(hot[0]).bound is None


def test_what_the_rms_of_a_run_are_over():
    assert averaging_spans(CRITERIA) == "; RMS: of angles in the last 60 s, of the others from 20 s on"


def test_one_window_has_no_spread():
    task = dataclasses.replace(FLIGHT, windows=1)
    assert not shares_headings(task)
    assert shares_headings(dataclasses.replace(task, windows=2))
    assert shares_headings(dataclasses.replace(task, windows=0, records=30))


def scaled(records, **factors):
    return dataclasses.replace(records, **{name: getattr(records, name) * f for name, f in factors.items()})


def test_rounding_of_a_navigation_task_is_held_against_the_spread_of_its_start():
    """A position of a metre that came from a spread of ten: the eighth digit may differ, the seventh not. Alignment is held
    against the error itself."""
    rng = np.random.default_rng(0)
    given: Records = score(errors_of(rng.uniform(1, 2, (2, 12)) * 1e-2), None, CRITERIA)
    given = dataclasses.replace(given, nees_all=np.full((2, 4), 9.0))
    assert compare_runs(given, scaled(given, span_final=1 + 2e-9, nees_all=1 + 2e-6, steady_mean=1 + 2e-9)) == []
    for name, factor in (("span_final", 1 + 2e-6), ("nees_all", 1 + 2e-5), ("steady_mean", 1 + 2e-6)):
        assert len(compare_runs(given, scaled(given, **{name: factor}))) == 2, name
    aligned = dataclasses.replace(given, criteria=dataclasses.replace(CRITERIA, navigates=False))
    assert len(compare_runs(aligned, scaled(aligned, nees_all=1 + 2e-6))) == 2
    assert len(compare_runs(aligned, scaled(aligned, final=1 + 3e-9))) == 2


def test_compare_in_level_knows_the_end(short, tmp_path, monkeypatch, cli):
    """From a results file all scores are read, not only those of tables."""
    monkeypatch.chdir(tmp_path)
    solvers = [f"evaluation.plugins:{name}" for name in ("Noisy", "DeadReckoning")]
    parts = [evaluate(short, name, 8, workers=1, cost=False) for name in solvers]
    with Store("results.sqlite") as db:
        db.add_task(short)
        for name, one in zip(solvers, parts, strict=True):
            db.add(Key.of(short.name, one.suite, name, {}, "1"), one.records)
    code, out, _ = cli("compare", short.name, *solvers, "--score", "level")
    assert code == 0
    assert out.strip() == str(compare(*parts, "level"))
    assert "at the end        unknown" not in out


def test_a_flight_has_diverged_at_ten_sigmas_of_its_start():
    """3/3/10 deg, 0.1 m/s and 10 m; nothing is known of a start before the first reset."""
    task = get_task("flight-sun2012-v0")
    env = task.make(1)
    task.reset(env, [0])
    limit = Criteria.of(task, env.unwrapped.task).limit
    np.testing.assert_allclose(limit, [*np.radians([30.0, 30.0, 100.0]), *[1.0] * 3, *[100.0] * 3])


def test_the_ratio_to_the_bound_is_that_of_the_mean_over_time():
    """Position errors that shrink: their mean over time is less than their RMS over time."""
    values = np.zeros((5, 12))
    values[:, 6] = 1.0
    course = np.linspace(4.0, 1.0, CRITERIA.num_epochs)
    one = Results(FLIGHT, "one", {}, "s", score(errors_of(values, course), None, CRITERIA), stored_bound=None)
    vars(one)["bound_means"] = {"position": 0.5}
    expected = course[9::10][CRITERIA.span].mean() / 0.5
    assert one.headline_ratio == pytest.approx(expected, rel=1e-6)
    assert one.summary.navigation.rms["position"][0] / 0.5 > 1.03 * expected
    (row,) = csv.DictReader(plain_tables.as_csv([one]).splitlines())
    assert float(row["bound_ratio_position"]) == pytest.approx(expected, rel=1e-6)
