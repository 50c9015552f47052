"""Repeatability of the heading: a constant of a group drops out, the variance is unbiased, the interval covers it."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from sins_env.evaluation import evaluate, get_task
from sins_env.evaluation.score.repeatability import repeatability
from sins_env.units import DEG

VEHICLE, RLG, SWAY = (get_task(name) for name in ("vehicle-v0", "rlg-car-v0", "sway-white-v0"))


def records(error, heading=None, runs=None, unfinished=(), scored=True):
    """What repeatability reads of a Records; errors and headings in rad, run i of the suite unless given."""
    error = np.asarray(error, dtype=float)
    bad = np.isin(np.arange(len(error)), unfinished)
    return SimpleNamespace(
        criteria=SimpleNamespace(scored=scored),
        run=np.arange(len(error)) if runs is None else np.asarray(runs),
        final=np.stack([0 * error, 0 * error, error], axis=-1),
        heading=error if heading is None else np.asarray(heading, dtype=float),
        unfinished=bad,
    )


def test_each_heading_is_a_group_and_its_constant_error_drops_out():
    error = np.random.default_rng(0).normal(0.0, 0.02, 60) * DEG
    constant = np.repeat([0.3, -0.2, 0.1], 10)[np.arange(60) % 30] * DEG
    *each, whole = repeatability(records(error + constant), VEHICLE)
    assert [one.group for one in each] == ["149.4°", "-28.8°", "-26.3°"]
    assert [one.runs for one in (*each, whole)] == [20, 20, 20, 60]
    for i, one in enumerate(each):
        mine = error[np.arange(60) % 30 // 10 == i]
        assert one.deg == pytest.approx(np.degrees(mine.std(ddof=1)), rel=1e-9)
        assert one.interval[0] < one.deg < one.interval[1]
    assert whole.deg == pytest.approx(np.sqrt(np.mean([one.deg**2 for one in each])), rel=1e-9)


def test_the_variance_is_unbiased_and_the_interval_covers_it():
    rng, sigma, repeats = np.random.default_rng(1), 0.02, 150
    found = [repeatability(records(rng.normal(0.0, sigma * DEG, 30)), VEHICLE)[-1] for _ in range(repeats)]
    variance = np.array([one.deg**2 for one in found])
    assert variance.mean() == pytest.approx(sigma**2, rel=4 * np.sqrt(2 / 27 / repeats))
    covered = np.mean([one.interval[0] < sigma < one.interval[1] for one in found])
    assert 0.84 < covered <= 0.99  # 30 values less three means: a little short of 95 %


def test_single_runs_and_runs_without_a_heading_are_left_out():
    *each, whole = repeatability(records([0.1, 0.3, 5.0, 0.2], runs=[0, 1, 2, 10], unfinished=[2]), VEHICLE)
    assert [one.runs for one in each] == [2, 0, 0]
    assert np.isnan(each[1].deg)
    assert np.isnan(each[1].interval).all()
    assert whole.runs == 2
    assert whole.deg == pytest.approx(np.degrees(0.2 / np.sqrt(2)))
    (none,) = repeatability(records([0.1]), SWAY)
    assert none.runs == 0
    assert np.isnan(none.deg)


def test_a_recording_is_one_group_and_angles_wrap():
    heading = np.radians([359.9, 0.0, 0.1])
    (found,) = repeatability(records([np.nan] * 3, heading, scored=False), RLG)
    assert found.group == "all"
    assert found.deg == pytest.approx(0.1, rel=1e-9)


def test_results_have_it():
    task = get_task("static8-v0")
    short = dataclasses.replace(task, kwargs={**task.kwargs, "coarse": 10.0, "duration": 15.0}, hold_s=3.0)
    results = evaluate(short, "coarse_inertial", runs=[0, 8, 1, 9])
    first, second, *others, whole = results.repeatability
    assert (first.group, first.runs, second.runs, len(others), whole.runs) == ("0°", 2, 2, 6, 4)
    error = np.degrees(results.records.final[:, 2])
    assert first.deg == pytest.approx(abs(error[0] - error[2]) / np.sqrt(2))  # sorted: runs 0, 1, 8, 9
