"""The oracle: its errors have the covariance that it states, and jumps do not change them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from sins_env.evaluation import evaluate
from sins_env.evaluation.bound import bounds, oracle
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask

RUNS = 100


def short(name: str, **settings: object) -> EvaluationTask:
    """Return a task of the suite that lasts 70 s, with six samples an epoch of half a second and another suite seed."""
    task = get_task(name)
    gps = task.kwargs.get("gps", "thesis")
    gps = {**({"preset": gps} if isinstance(gps, str) else gps), "rate_hz": 2.0}
    kwargs = {**task.kwargs, "duration": 70.0, "epoch": 0.5, "n_sub": 6, "gps": gps, **settings}
    return dataclasses.replace(task, name=f"short-{name}", kwargs=kwargs, suite_seed=3)


@pytest.mark.parametrize("name", ["sway-white-v0", "sway-contaminated-v0"])
def test_errors_have_the_stated_covariance(name: str) -> None:
    found = oracle.compute(short(name), RUNS)
    assert found is not None
    error = math.sqrt(2.0 / (3 * RUNS))
    assert found.nees.mean() / 3.0 == pytest.approx(1.0, abs=3.5 * error)
    # the mean square over a minute varies from run to run by less than a single square
    np.testing.assert_allclose(found.steady.mean(axis=0) / found.expected_steady, 1.0, atol=3.5 * math.sqrt(2.0 / RUNS))
    np.testing.assert_allclose(found.final.mean(axis=0) / found.expected_final, 1.0, atol=3.5 * math.sqrt(2.0 / RUNS))


def test_expected_errors_are_the_bound_for_gaussian_fixes() -> None:
    task = short("sway-white-v0")
    found, bound = oracle.compute(task, 4), bounds.compute(task, 4)
    assert found is not None
    assert bound is not None
    np.testing.assert_allclose(np.sqrt(found.expected_steady), bound.steady, rtol=1e-12)
    np.testing.assert_allclose(np.sqrt(found.expected_final), bound.final, rtol=1e-12)


def test_jumps_scale_factors_and_pulses_are_taken_out() -> None:
    imu = {"preset": "thesis-white", "scale_ppm": 500.0, "misalignment_arcsec": 100.0, "accel_lsb_mps": 1e-3}
    gps = {"rate_hz": 2.0, "jump_mps": 3.0, "jump_s": 20.0}
    rough = oracle.compute(short("sway-white-v0", imu=imu, gps={**gps, "vel_std_mps": 0.1}), 3)
    usual = oracle.compute(short("sway-white-v0", gps={"rate_hz": 2.0, "vel_std_mps": 0.1}), 3)
    assert rough is not None
    assert usual is not None
    np.testing.assert_array_equal(rough.steady, usual.steady)


def test_run_i_does_not_depend_on_their_number() -> None:
    task = short("sway-white-v0")
    some, one = oracle.compute(task, 3), oracle.compute(task, 1)
    assert some is not None
    assert one is not None
    np.testing.assert_allclose(some.steady[0], one.steady[0], rtol=1e-9)


def test_a_flight_with_a_lever_arm() -> None:
    task = get_task("flight-zhao2010-v0")
    gps = {"vel_std_mps": 0.1, "pos_std_m": 5.0, "rate_hz": 1.0, "lever_arm_m": [1.0, -2.0, 0.5]}
    task = dataclasses.replace(task, kwargs={**task.kwargs, "gps": gps, "duration": 60.0}, suite_seed=3)
    found = oracle.compute(task, 60)
    assert found is not None
    assert found.nees.mean() / 9.0 == pytest.approx(1.0, abs=3.5 * math.sqrt(2.0 / (9 * 60)))


def test_none_where_there_is_no_bound() -> None:
    assert oracle.compute(get_task("vehicle-v0"), 2) is None


def test_tails_of_fixes_count_little() -> None:
    """Fixes without a variance: with the weights of an efficient estimator the covariance is that of the bound."""
    gps = {"vel_std_mps": 0.1, "rate_hz": 2.0, "heavy_tail_dof": 1.5}
    task = short("sway-white-v0", gps=gps)
    found, bound = oracle.compute(task, RUNS), bounds.compute(task, RUNS)
    assert found is not None
    assert bound is not None
    np.testing.assert_allclose(np.sqrt(found.expected_steady), bound.steady, rtol=1e-9)
    assert found.nees.mean() / 3.0 == pytest.approx(1.0, abs=3.5 * math.sqrt(2.0 / (3 * RUNS)))


def test_other_runs_and_other_suites() -> None:
    task = short("sway-told-wrong-v0")
    some, all_of_it = oracle.compute(task, [1, 4]), oracle.compute(task, 5)
    elsewhere = oracle.compute(dataclasses.replace(task, suite_seed=8), [4], suite_seed=3)
    assert some is not None
    assert all_of_it is not None
    assert elsewhere is not None
    np.testing.assert_allclose(some.final, all_of_it.final[[1, 4]], rtol=1e-8)
    np.testing.assert_allclose(elsewhere.final[0], all_of_it.final[4], rtol=1e-8)
    records = all_of_it.records
    assert records.run.tolist() == [0, 1, 2, 3, 4]
    np.testing.assert_allclose(np.square(records.steady_rms), all_of_it.steady, rtol=1e-8)
    np.testing.assert_allclose(np.square(records.final), all_of_it.final, rtol=1e-12)
    np.testing.assert_allclose(records.nees[:, -1], all_of_it.nees)


@pytest.mark.parametrize(
    ("imu", "axis", "least"),
    [
        ({}, 0, 0.6),  # of 0.88; 0.17 if the errors of the accelerometers have the wrong sign
        ({"gyro_bias_deg_h": 3.0, "accel_bias_ug": 1000.0}, 2, 0.35),  # of 0.63; -0.02 if those of the gyros have
    ],
    ids=["accelerometers", "gyros"],
)
def test_a_good_filter_errs_as_the_oracle_does(imu: dict[str, float], axis: int, least: float) -> None:
    """In each run: errors that are drawn with the wrong sign leave all statistics of the oracle as they are, but not this."""
    task = short("sway-white-v0", imu={"preset": "thesis-white", **imu})
    found = oracle.compute(task, 24)
    assert found is not None
    records = evaluate(task, "inekf", 24, workers=1, cost=False).records
    assert np.corrcoef(np.square(records.final[:, axis]), found.final[:, axis])[0, 1] > least
