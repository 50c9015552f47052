"""The two-pass reference: exact where it can be, one Gauss-Newton step where it cannot."""

import gymnasium
import numpy as np
import pytest
from oracles.dense_kalman import kalman
from oracles.problems import linear, look, run_of, spd, swing, swing_jacobian

import sins_env  # noqa: F401
import solvers
from sins_env.units import ARCSEC
from solvers.filters.sigma.ckf import CKF
from solvers.pipeline.errors.alignment import PHI
from solvers.pipeline.two_pass import TwoPass, TwoPassFilter
from solvers.types import Gaussian, Linear, Measurement, Transition

DT = 0.1


def play(f, problem, measurements, transition, Q, h, R):
    """Beliefs after each step."""
    b = f.init(problem, None)
    out = []
    for z in measurements:
        b, _ = f.step(b, Transition(transition, Q, None, DT), None if z is None else Measurement(z, h, R))
        out.append(b)
    return out


@pytest.mark.parametrize("batch", [(), (1,), (7,), (2, 3)])
@pytest.mark.parametrize("as_function", [False, True])
def test_on_a_linear_problem_it_is_the_kalman_filter(batch, as_function):
    """Before, at and after the second pass, some epochs without a fix."""
    p = linear(3, 4, 2, batch)
    p.F *= 0.5  # or the batch holds a run that grows by half per step
    F, H = Linear(p.F, p.c), Linear(p.H, p.d)

    def move(x):
        return (p.F @ x.mT).mT + p.c[..., None, :] if x.ndim > p.x.ndim else F(x)

    def see(x):
        return (p.H @ x.mT).mT + p.d[..., None, :] if x.ndim > p.x.ndim else H(x)

    f = TwoPassFilter(2.0)
    functions = (move, see) if as_function else (F, H)
    beliefs = play(f, Gaussian(p.x, p.P), p.z, functions[0], p.Q, functions[1], p.R)
    # the first pass ends at step 20; it starts from a mean that is not zero, which _again must keep
    assert beliefs[18].nominal is None
    assert beliefs[19].nominal is not None
    assert (beliefs[-1].passes, len(beliefs[-1].past)) == (2, 50)  # again at step 40, for its angles are large
    assert beliefs[-1].health.epoch == 50
    for index in np.ndindex(*batch) if batch else [()]:
        expected, _ = kalman(*run_of(p, index))
        for b, (x, P) in zip(beliefs, expected, strict=True):
            found = f.estimate(b)
            np.testing.assert_allclose(found.mean[index], x, atol=1e-9)
            np.testing.assert_allclose(found.cov[index], P, atol=1e-9)


def gauss_newton(x0, P0, Q, R, nominal, measurements):
    """The last state's posterior, linearised along ``nominal`` (K + 1, n): dense least squares over start and noise."""
    n, K = len(x0), len(measurements)
    joint = np.zeros(((K + 1) * n, (K + 1) * n))
    joint[:n, :n] = P0
    mean = np.zeros((K + 1) * n)
    mean[:n] = x0 - nominal[0]
    state = np.eye(n, (K + 1) * n)
    rows, residuals = [], []
    for k, z in enumerate(measurements):
        here = slice((k + 1) * n, (k + 2) * n)
        joint[here, here] = Q
        state = swing_jacobian(nominal[k]) @ state
        state[:, here] += np.eye(n)
        if z is not None:
            x = nominal[k + 1]
            H = np.zeros((2, n))
            H[0, 0], H[0, 2], H[1, 1], H[1, 0] = np.cos(x[0]), 1.0, 1.0, 0.4 * x[0]
            rows.append(H @ state)
            residuals.append(z - look(x))
    M, r = np.concatenate(rows), np.concatenate(residuals)
    S = M @ joint @ M.T + np.kron(np.eye(len(residuals)), R)
    gain = joint @ M.T @ np.linalg.inv(S)
    posterior = mean + gain @ (r - M @ mean)
    cov = joint - gain @ M @ joint
    return nominal[-1] + state @ posterior, state @ cov @ state.T


def test_the_second_pass_is_a_gauss_newton_step():
    """Against dense algebra on a nonlinear problem, along the trajectory that the first filter's estimate leads to."""
    rng = np.random.default_rng(8)
    P0, Q, R = spd(rng, 4), 1e-4 * spd(rng, 4), 0.1 * spd(rng, 2)
    z = [None if k % 4 == 3 else look(rng.standard_normal(4)) for k in range(30)]
    f = TwoPassFilter(30 * DT)
    zero = np.zeros(4)
    b = play(f, Gaussian(zero, P0), z, swing, Q, look, R)[-1]
    first = play(CKF(), Gaussian(zero, P0), z, swing, Q, look, R)[-1]
    x = start_of(first.mean)
    nominal = [x]
    for _ in z:
        nominal.append(swing(nominal[-1]))
    np.testing.assert_allclose(b.nominal, nominal[-1], atol=1e-12)
    mean, cov = gauss_newton(zero, P0, Q, R, np.array(nominal), z)
    found = f.estimate(b)
    np.testing.assert_allclose(found.cov, cov, rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(found.mean, mean, rtol=1e-5, atol=1e-7)


def start_of(end):
    """The start that the second pass takes: two corrections of the angles, nothing known of the first two states."""
    x0 = end.copy()
    x0[:2] = 0.0
    for _ in range(2):
        x = x0
        for _ in range(30):
            x = swing(x)
        x0[PHI] += end[PHI] - x[PHI]
    return x0


def episode(runs, duration, seed=5, solver=None, spoil=None, **settings):
    """phi (epochs, runs, 3) and the estimator; ``spoil(k, obs)`` may change observations."""
    env = gymnasium.make_vec("SINS/AlignSway-v0", num_envs=runs, duration=duration)
    obs, _ = env.reset(seed=seed)
    estimator = solvers.make(solver or "two_pass", **settings)
    estimator.reset(env.unwrapped.task, [np.random.default_rng(i) for i in range(runs)], runs)
    errors = []
    for k in range(round(duration / 0.1)):
        if spoil:
            spoil(k + 1, obs)
        obs, _, _, _, info = env.step(estimator.step(obs))
        errors.append(info["errors"]["phi"])
    return np.array(errors), estimator


def test_the_first_pass_is_the_ckf_and_the_second_leads_to_its_estimate():
    phi, estimator = episode(4, 40.1, relinearise_s=40.0)
    reference, ckf = episode(4, 40.0, solver="ckf")
    np.testing.assert_array_equal(phi[:399], reference[:399])
    assert np.abs(phi[399:401, :, 2] - reference[399, :, 2]).max() > ARCSEC
    b = estimator.belief
    assert b.health.epoch == 401
    end = ckf.filter.estimate(ckf.running.belief).mean
    near = b.nominal[:, PHI] - end[:, PHI]  # an epoch later
    assert np.abs(near).max() < 2 * ARCSEC
    assert np.isfinite(estimator.covariance()).all()
    biases = {"gyro_bias", "gyro_bias_sigma", "accel_bias", "accel_bias_sigma"}
    assert set(estimator.diagnostics()) == {"gps_nis", "gps_residual", "gps_covariance", *biases}


def test_a_batch_is_its_runs():
    phi, together = episode(3, 15.0, relinearise_s=5.0)
    assert together.belief.passes == 2  # at 5 and 10 s
    for i in range(3):
        env = gymnasium.make("SINS/AlignSway-v0", duration=15.0)
        obs, _ = env.reset(seed=5 + i)
        estimator = TwoPass(relinearise_s=5.0)
        estimator.reset(env.unwrapped.task, np.random.default_rng(i))
        for k in range(150):
            obs, _, _, _, info = env.step(estimator.step(obs))
            np.testing.assert_allclose(info["errors"]["phi"], phi[k, i], atol=1e-9)
        assert estimator.covariance().shape == (3, 3)


def test_runs_that_the_first_pass_lost_stay_lost():
    """The others do not notice."""
    p = linear(4, 4, 2, (3,), steps=30, missing=0.0)
    z = [np.where(np.arange(3)[:, None] == 1, np.inf, y) if k == 5 else y for k, y in enumerate(p.z)]
    f = TwoPassFilter(1.0)
    F, H = Linear(p.F, p.c), Linear(p.H, p.d)
    spoiled = play(f, Gaussian(p.x, p.P), z, F, p.Q, H, p.R)[-1]
    clean = play(f, Gaussian(p.x, p.P), p.z, F, p.Q, H, p.R)[-1]
    assert spoiled.health.failed_at.tolist() == [-1, 6, -1]
    assert spoiled.health.frozen
    for a, b in zip(f.estimate(spoiled), f.estimate(clean), strict=True):
        np.testing.assert_allclose(a[[0, 2]], b[[0, 2]], atol=1e-12)
        assert np.isfinite(a[1]).all()


@pytest.mark.parametrize("epoch", [20, 110])
def test_an_ins_that_breaks_costs_its_run_only(epoch):
    """Increments that are not finite, before and after the second pass begins; nothing warns."""
    phi, _ = episode(3, 15.0, relinearise_s=10.0)

    def spoil(k, obs):
        if k == epoch:
            obs["dtheta"][1] = np.nan

    spoiled, estimator = episode(3, 15.0, relinearise_s=10.0, spoil=spoil)
    np.testing.assert_allclose(spoiled[:, [0, 2]], phi[:, [0, 2]], atol=1e-9)
    assert estimator.health().failed_at.tolist() == [-1, epoch, -1]


def test_what_happened_in_the_first_pass_stays_on_record():
    """A run that only the first filter lost, and repairs."""
    p = linear(4, 4, 2, (3,), steps=10, missing=0.0)
    f = TwoPassFilter(1.0)
    b = play(f, Gaussian(p.x, p.P), p.z[:9], Linear(p.F, p.c), p.Q, Linear(p.H, p.d), p.R)[-1]
    health = b.inner.health._replace(failed_at=np.array([-1, 3, -1]), repairs=np.array([2, 0, 0]), frozen=True)
    b = b._replace(inner=b.inner._replace(health=health))
    b, _ = f.step(b, Transition(Linear(p.F, p.c), p.Q, None, DT), Measurement(p.z[9], Linear(p.H, p.d), p.R))
    assert b.nominal is not None
    assert b.health.failed_at.tolist() == [-1, 3, -1]
    assert b.health.repairs.tolist() == [2, 0, 0]
    assert b.health.epoch == 10


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan")])
def test_settings(bad):
    with pytest.raises(ValueError, match="relinearise_s"):
        solvers.make("two_pass", relinearise_s=bad)
    with pytest.raises(ValueError, match="relinearise_s"):
        solvers.make("two_pass", relinearise=60.0)  # the nearest name is offered
    assert "two_pass" in solvers.names()
    assert "reference estimator" in solvers.describe("two_pass")


def test_it_runs_open_loop():
    with pytest.raises(NotImplementedError, match="open loop"):
        TwoPassFilter().relocate(None, None, None)


def test_a_rough_run_alone_is_linearised_again():
    """At twice the time; the others go on along the trajectory they have, and what is no longer needed is dropped."""
    rng = np.random.default_rng(8)
    P0, Q, R = 1e-2 * spd(rng, 4), 1e-9 * spd(rng, 4), 1e-2 * spd(rng, 2)
    z = [look(0.1 * rng.standard_normal((3, 4))) for _ in range(20)]
    f = TwoPassFilter(1.0)
    before = play(f, Gaussian(np.zeros((3, 4)), P0), z[:19], swing, Q, look, R)[-1]
    assert before.passes == 1
    step = Transition(swing, Q, None, DT), Measurement(z[19], look, R)
    some = f.step(before._replace(rough=np.array([True, False, True])), *step)[0]
    every = f.step(before._replace(rough=np.ones(3, dtype=bool)), *step)[0]
    none = f.step(before._replace(rough=np.zeros(3, dtype=bool)), *step)[0]
    for way, expected in ((some, [every, none, every]), (every, [every] * 3)):
        for run, other in enumerate(expected):
            np.testing.assert_array_equal(way.nominal[run], other.nominal[run])
            np.testing.assert_array_equal(f.estimate(way).cov[run], f.estimate(other).cov[run])
    assert np.abs(every.nominal - none.nominal).max(axis=-1).min() > 1e-6
    assert (some.passes, none.passes) == (2, 1)
    assert some.health.epoch == none.health.epoch == 20
