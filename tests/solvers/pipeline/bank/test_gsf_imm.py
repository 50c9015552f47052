"""The recommended solver as a whole: the invariant filter if there is one hypothesis, rows of a batch, starts, lost runs."""

import dataclasses

import numpy as np
import pytest

import sins_env  # noqa: F401
import solvers
from sins_env import attitude
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.types import NavState

ALONE = {"spacing_deg": 360.0, "imu_factors": [[1.0, 1.0]], "fix_factors": [1.0], "fix_offsets": False}


def record(name, runs, epochs, **more):
    """The task, observations and true attitudes of some epochs of an evaluation task."""
    task = get_task(name)
    env = task.make(runs, reveal_truth=True, **more)
    obs, _ = task.reset(env, range(runs), 5)
    public = env.unwrapped.task
    seen, truth = [], []
    for _ in range(epochs):
        seen.append({key: value.copy() for key, value in obs.items()})
        action = np.zeros((runs, 10 if public.navigate else 4))
        action[:, 0] = 1.0
        obs, _, _, _, info = env.step(action)
        truth.append(info["truth"]["q_nb"])
    return public, seen, truth


def play(solver, task, seen, runs=None):
    """The answers of a solver (epochs, ...) to a batch, or to one run of it."""
    if isinstance(runs, int):
        start = task.start and NavState(*(part[runs] for part in task.start))
        task, seen = dataclasses.replace(task, start=start), [{k: v[runs] for k, v in obs.items()} for obs in seen]
    solver.reset(task, None, 1 if isinstance(runs, int) else len(seen[0]["dtheta"]))
    return np.array([solver.step(obs) for obs in seen])


@pytest.mark.parametrize("name", ["sway-white-v0", "flight-sun2012-physical-v0"])
def test_with_one_slice_one_model_and_one_regime_it_is_the_invariant_filter(name):
    task, seen, _ = record(name, 2, 60)
    one, bank = solvers.make("inekf"), solvers.make("gsf_imm", **ALONE)
    np.testing.assert_allclose(play(bank, task, seen), play(one, task, seen), rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(bank.covariance(), one.covariance(), rtol=1e-7, atol=1e-14)


@pytest.mark.parametrize(
    ("name", "more"), [("sway-anyheading-v0", {"n_sub": 5}), ("sway-scratch-v0", {}), ("flight-hotstart60-v0", {})]
)
def test_a_run_of_a_batch_has_the_bits_of_a_single_run(name, more):
    """Slices that are merged and dropped at other times, fixes that are missing, and a lost run beside it change nothing."""
    task, seen, _ = record(name, 3, 40, **more)
    for k, obs in enumerate(seen):
        obs["gps_valid"][1] &= k % 3 == 2 and k > 8
        obs["dvel"][2, 0] += 1e200 if k == 20 else 0.0  # an overflow raises no warning
    solver = solvers.make("gsf_imm", spacing_deg=60.0)
    together = play(solver, task, seen)
    P, facts = solver.covariance(), solver.diagnostics()
    np.testing.assert_array_equal(solver.health().failed_at, [-1, -1, 21])
    np.testing.assert_array_equal(together[20:, 2], together[19, 2][None].repeat(20, axis=0))
    for i in range(2):
        np.testing.assert_array_equal(play(solver, task, seen, i), together[:, i])
        np.testing.assert_array_equal(solver.covariance(), P[i])
        for key, value in solver.diagnostics().items():
            np.testing.assert_array_equal(value, facts[key][i])


def test_doubt_is_the_share_of_epochs_that_the_told_noise_does_not_explain():
    task, seen, _ = record("sway-white-v0", 2, 60, n_sub=5)
    for obs in seen[20:50]:
        obs["gps_vel"][1] += [3.0, 0.0, 0.0]
    solver = solvers.make("gsf_imm", spacing_deg=60.0)
    play(solver, task, seen)
    honest, fooled = solver.diagnostics()["doubt"]
    assert honest == 0.0
    assert 0.5 <= fooled < 0.75  # 30 of 60 epochs, and some fixes until the end is believed


def test_a_base_at_rest_and_a_second_pass():
    """Rows of a batch have the bits of single runs: at rest after ten seconds, and after a coarse phase that ends then."""
    task, seen, truth = record("static8-v0", 3, 160, n_sub=2)
    task = dataclasses.replace(task, coarse_s=10.0)
    seen[20]["dtheta"][1, 0] += 1e-4  # a jolt, after which rest is seen later
    settings = {"stillness": True, "coarse": "svd", "spacing_deg": 60.0}
    solver = solvers.make("gsf_imm", **settings)
    together = play(solver, task, seen)
    P = solver.covariance()
    plain = solvers.make("gsf_imm", coarse="svd", spacing_deg=60.0)
    np.testing.assert_array_equal(play(plain, task, seen)[:99], together[:99])  # the coarse phase
    assert (P[:, 2, 2] < 0.5 * plain.covariance()[:, 2, 2]).all()
    for i in range(2):
        np.testing.assert_array_equal(play(solver, task, seen, i), together[:, i])
        np.testing.assert_array_equal(solver.covariance(), P[i])
    phi = attitude.misalignment(together[-1], truth[-1])
    assert (np.einsum("bi,bij,bj->b", phi, np.linalg.inv(P), phi) < 16.3).all()  # chi-square of 3 at 0.999


def test_a_parked_car_is_aligned_while_people_and_its_engine_rock_it():
    """Fixes of 3 cm/s a second show no heading in 40 s; that the car stays where it is shows it, to what the gyros know.

    The engine shakes by more than the told noise, so that the car is parked and not still. The fixes of the second car have no
    noise, which is not taken for a smaller R.
    """
    task, seen, truth = record(
        "vehicle-v0", 2, 400, n_sub=2, events="people", coarse=0.0, gps={"preset": "dgps", "rate_hz": 1.0}
    )
    for k, obs in enumerate(seen):
        obs["dvel"] += [0.0, 0.0, 0.002 * (-1) ** k]
        obs["gps_valid"][1] &= k >= 40
        obs["gps_vel"][1] *= k < 90
    settings = {"imu_factors": [[1.0, 1.0]], "spacing_deg": 60.0}
    solver, plain = (solvers.make("gsf_imm", stillness=still, **settings) for still in (True, False))
    together, P = play(solver, task, seen), solver.covariance()
    phi = attitude.misalignment(together[-1], truth[-1])
    assert (np.einsum("bi,bij,bj->b", phi, np.linalg.inv(P), phi) < 16.3).all()  # chi-square of 3 at 0.999
    told = solver.labels["regime_probabilities"].index("fixes x 1")
    assert solver.diagnostics()["regime_probabilities"][1, told] > 0.7  # parked after six fixes
    np.testing.assert_array_equal(play(solver, task, seen, 1), together[:, 1])
    play(plain, task, seen)
    assert 9 * P[0, 2, 2] < plain.covariance()[0, 2, 2]
    assert plain.diagnostics()["regime_probabilities"][1, told] < 0.5
