"""The tables of 000 chapters 2 to 5: what they read, what they print, and a slice from the runs to the file."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from sins_env.evaluation import reproduction
from sins_env.evaluation.reproduction import get_table
from sins_env.evaluation.reproduction.documents import thesis_filters
from sins_env.evaluation.reproduction.documents.thesis_filters import LEVELS, MARKOV, MATCHED, THESIS, task_of
from sins_env.evaluation.reproduction.readings.common import quotient
from sins_env.evaluation.reproduction.readings.sway import largest, settling, wander
from sins_env.evaluation.reproduction.verdicts import IN_ORDER, NOT, REPRODUCED, Estimate, Printed, verdicts
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import run_seed

NUMBERS = ("3.1", "3.2", "3.3", "3.4", "4.1", "4.2", "4.3", "4.4", "5.1", "5.2", "5.3", "5.4")


def results_of(history, lost=()):
    """Made-up results: errors (R, S, 3) once a second from 1 s on."""
    history = np.asarray(history, dtype=np.float32)
    runs = np.arange(len(history))
    criteria = SimpleNamespace(history_t=np.arange(1.0, history.shape[1] + 1))
    records = SimpleNamespace(
        history=history, criteria=criteria, run=runs, unfinished=np.isin(runs, lost), __len__=lambda: len(runs)
    )
    return SimpleNamespace(records=records, bound=None)


def levels(*runs):
    """Errors in north; the other two are zero."""
    history = np.zeros((len(runs), len(runs[0]), 3))
    history[:, :, 1] = runs
    return results_of(history)


def test_errors_have_settled_from_the_last_time_that_they_were_outside():
    runs = [[5, 1, 5, 1, -1, 1], [1, 1, 1, 1, 1, 1], [5, 5, 5, 5, 5, 1], [1, 1, 1, 1, 1, 5], [1, np.nan, 1, 1, 1, 1]]
    found = {
        len(part): settling(LEVELS, 2.0, 6.0)(levels(*part)) for part in (runs[:1] * 9, runs[1:2] * 8, runs[2:3] * 7)
    }
    assert [(one.value, one.low, one.high) for one in found.values()] == [(4, 4, 4), (1, 1, 1), (6, 6, 6)]
    assert settling(LEVELS, 2.0, 6.0)(levels(runs[3], runs[3])).value == math.inf  # outside at the end
    assert settling(LEVELS, 2.0, 5.0)(levels(runs[3], runs[3])).value == 1.0  # not at the end of the span
    assert settling(LEVELS, 2.0, 6.0)(levels(runs[4], runs[4])).value == 3.0  # no answer is outside
    assert settling(0, 2.0, 6.0)(levels(runs[0], runs[0])).value == 1.0  # another component
    assert settling(LEVELS, 2.0, 6.0)(levels(runs[0], runs[0], runs[1])).value == 4.0  # the median
    lost = results_of(np.zeros((2, 6, 3)), lost=[0])
    assert settling(LEVELS, 2.0, 6.0)(lost)[3:5] == (1, 1)


def test_wander_is_about_each_runs_own_mean():
    rng = np.random.default_rng(3)
    history = rng.standard_normal((20, 50, 3)) + 100 * rng.standard_normal((20, 1, 3))
    found = wander(2, 2.0, 2.0, 40.0, 10.0)(results_of(history, lost=[4]))
    spread = np.delete(history, 4, axis=0)[:, 30:40, 2].std(axis=1, ddof=1) / 2.0
    assert found.value == pytest.approx(
        np.sqrt((np.sum(spread**2) + 1.0) / 20), rel=1e-4
    )  # the lost run counts as the cap
    assert (found.runs, found.lost) == (19, 1)


def test_largest_of_so_many_runs_is_the_law_of_their_maximum():
    """Against the maxima of drawn groups of runs."""
    rng = np.random.default_rng(4)
    errors = rng.standard_normal(400)
    history = np.zeros((400, 2, 3))
    history[:, 1, 2] = errors
    found = largest(2, 1.0, 2.0, of=50)(results_of(history))
    maxima = np.abs(rng.choice(errors, (4000, 50))).max(axis=1)
    assert [found.low, found.value, found.high] == pytest.approx(np.quantile(maxima, [0.025, 0.5, 0.975]), rel=0.03)


def test_quotient_takes_several_components_together():
    rng = np.random.default_rng(5)
    a, b = rng.standard_normal((2, 30, 1, 3))
    one, other = results_of(a), results_of(b)
    for parts in ([2], [0, 1]):
        expected = np.sqrt(np.sum(a[..., parts] ** 2) / np.sum(b[..., parts] ** 2))
        given = parts[0] if len(parts) == 1 else tuple(parts)
        assert quotient(given, 10.0, 1.0)(one, other).value == pytest.approx(expected, rel=1e-5)


def test_only_figures_of_a_kind_are_put_in_order():
    """An azimuth that comes out too small is not in order for being larger than a level."""
    ours = [Estimate(1.0, 0.9, 1.1, 40), Estimate(1000.0, 900.0, 1100.0, 40)]
    small, large = Printed(1.0, 10), Printed(5000.0, 10)
    assert verdicts([small, large], ours) == [REPRODUCED, IN_ORDER]
    assert verdicts([small._replace(kind="east"), large._replace(kind="azimuth")], ours) == [REPRODUCED, NOT]


#: What the text and the tables say of the same runs.
@pytest.mark.parametrize("number", NUMBERS)
def test_printed_differences_are_those_of_the_printed_errors(number):
    for group in get_table(number).groups[:2]:
        printed = {line.label: line.printed for line in group.lines}
        azimuths = [one.value for one in printed.values() if getattr(one, "kind", "") == "azimuth"]
        apart = [one.value for one in printed.values() if getattr(one, "kind", "") == "azimuth apart"]
        assert len(azimuths) == len(apart) + 1
        assert apart == pytest.approx([abs(azimuth - azimuths[0]) for azimuth in azimuths[1:]])
        assert {
            one.records for one in printed.values() if getattr(one, "kind", "") in ("east", "north", "azimuth")
        } == {1}


def test_a_filter_that_is_printed_twice_is_printed_alike_and_run_once():
    """The UKF of tables 3.1, 3.3, 5.1 and 5.3 is one run; so are the GPF of 5.1 and 5.3, the UKF and H-infinity UKF of 4."""
    seen = {}
    for number in NUMBERS:
        for group in get_table(number).groups[:2]:
            for line in group.lines:
                if getattr(line.printed, "kind", "") in ("east", "north", "azimuth"):
                    span = next(p.end_s for p in thesis_filters.PRINTINGS if p.number == number)
                    key = line.task.name, line.solver, line.printed.kind, span
                    seen.setdefault(key, set()).add(line.printed.value)
    assert {len(values) for values in seen.values()} == {1}
    tasks = {name for name, *_ in seen}
    assert tasks == {
        f"sway-{noise}-v0"
        for noise in (
            "white", "markov", "markov-360", "white-thesis-prior", "markov-thesis-prior", "markov-360-thesis-prior"
        )
    }  # fmt: skip


def test_tasks_of_other_priors_and_spans_share_the_worlds():
    base = get_task("sway-markov-v0")
    first, told = first_epoch(base)
    for task in (task_of(MARKOV, THESIS), task_of(MARKOV, MATCHED, "rqmc_gpf"), task_of(MARKOV, THESIS, "rqmc_gpf")):
        assert run_seed(task, 3) == run_seed(base, 3)
        found, prior = first_epoch(task)
        for name, value in first.items():
            np.testing.assert_array_equal(found[name], value, name)
        same = np.array_equal(prior.Q, told.Q)
        assert same == (task.kwargs["prior"] == "matched")
    assert task_of(MARKOV, THESIS).what.count("prior of 000 section 2.5.4") == 1


def first_epoch(task):
    """Of two runs, and the prior."""
    env = task.make(2)
    obs, _ = task.reset(env, [0, 5])
    prior = env.unwrapped.task.prior
    env.close()
    return obs, prior


@pytest.mark.parametrize(("number", "lines"), [("4.1", 14), ("5.2", 22)])
def test_a_slice_from_the_runs_to_the_file(cli, short, tmp_path, monkeypatch, number, lines):
    """Tables on 20 s at 5 Hz, of 5.2 the first ten: every line has a figure, also against runs that go on for longer."""
    monkeypatch.chdir(tmp_path)
    whole = next(p for p in thesis_filters.PRINTINGS if p.number == number)
    kwargs = {**short.kwargs, "epoch": 0.2, "gps": {"rate_hz": 5.0}}
    base = dataclasses.replace(short, what="20 s, matched prior", kwargs=kwargs)
    monkeypatch.setitem(thesis_filters.BASES, whole.noise, base)
    monkeypatch.setattr(thesis_filters, "SHORTER_S", 10.0)
    few = {"particles": 64}
    columns = tuple(
        dataclasses.replace(
            column, mean_s=min(column.mean_s, 5.0), settings=few if column.single else {}, single={}
        )
        for column in whole.columns
    )  # fmt: skip
    end_s = 20.0 if number == "4.1" else 10.0
    table = thesis_filters.table(dataclasses.replace(whole, end_s=end_s, columns=columns, costs=()))
    monkeypatch.setitem(reproduction.TABLES, number, table)
    code, _, _ = cli("reproduce", number, "--out", "out", "--workers", 1, "--runs", 3)
    assert code == 0
    text = (tmp_path / "out" / "REPRODUCTION.md").read_text()
    rows = [line for line in text.splitlines() if line.startswith(("| UKF", "| H-infinity", "| GPF", "| RQMC"))]
    assert len(rows) == 2 * lines
    assert not any("nan" in row for row in rows)
    assert "![" + table.pictures[0].caption in text
    svg = (tmp_path / "out" / "figures" / f"table-{number.replace('.', '-')}.svg").read_text()
    assert svg.count("prior of the thesis") == 3  # a panel an axis
