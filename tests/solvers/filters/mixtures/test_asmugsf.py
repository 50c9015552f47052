"""The split-and-merge filter: one step against Monte Carlo and closed forms, and the noise that it finds."""

import numpy as np
import pytest
import scipy.linalg
from oracles.problems import spd
from scipy.stats import multivariate_normal

import solvers
from sins_env.evaluation import get_task
from solvers.filters import make_filter
from solvers.types import Gaussian, Linear, Measurement, Transition


def problem(seed=0, n=4, m=2, batch=()):
    """A linear step with a large process noise that leaves one state alone."""
    rng = np.random.default_rng(seed)
    Q = 2.0 * spd(rng, *batch, n)
    Q[..., -1, :] = Q[..., :, -1] = 0.0
    F, H = rng.standard_normal((n, n)), rng.standard_normal((m, n))
    return Gaussian(rng.standard_normal((*batch, n)), spd(rng, *batch, n)), F, H, Q, 0.2 * spd(rng, m), rng


def one_step(flt, x, F, H, Q, R, z):
    return flt.step(flt.init(x), Transition(Linear(F), Q), Measurement(z, Linear(H), R))


def direction(F, H, P, Q, R):
    """v of the largest a' HQH' a / a' S a, by scipy's generalised eigenproblem; its sign does not matter."""
    M, S = H @ Q @ H.T, H @ (F @ P @ F.T + Q) @ H.T + R
    a = scipy.linalg.eigh(M, S)[1][:, -1]
    return Q @ H.T @ a / np.sqrt(a @ M @ a)


@pytest.mark.parametrize("G", [2, 3, 5])
def test_a_step_is_the_posterior_of_a_mixture_of_noises(G):
    """Linear f and h: each component's Kalman update, by inverses; weights by its density of z."""
    x, F, H, Q, R, rng = problem()
    omega, v = 0.8, direction(F, H, x.cov, Q, R)
    z = H @ (F @ x.mean + 1.5 * v) + rng.standard_normal(2)
    s = np.linspace(-1.0, 1.0, G)
    s *= np.sqrt(G / (s @ s))
    weights, means, seconds = [], [], []
    for s_g in s:
        mean, P = F @ x.mean + np.sqrt(omega) * s_g * v, F @ x.cov @ F.T + Q - omega * np.outer(v, v)
        S = H @ P @ H.T + R
        weights.append(multivariate_normal.pdf(z, H @ mean, S))
        K = P @ H.T @ np.linalg.inv(S)
        means.append(mean + K @ (z - H @ mean))
        seconds.append(P - K @ S @ K.T + np.outer(means[-1], means[-1]))
    weights = np.array(weights) / sum(weights)
    mean = weights @ means
    cov = np.tensordot(weights, seconds, 1) - np.outer(mean, mean)
    b, innovation = one_step(make_filter("asmugsf", components=G, omega=omega), x, F, H, Q, R, z)
    np.testing.assert_allclose(b.mean, mean, atol=1e-12)
    np.testing.assert_allclose(b.cov, cov, atol=1e-12)
    np.testing.assert_allclose(np.sort(b.weights), np.sort(weights), atol=1e-12)
    assert weights.max() - weights.min() > 0.1
    # the split keeps the moments of w, so the mixture's innovation is the Kalman filter's
    np.testing.assert_allclose(innovation.residual, z - H @ F @ x.mean, atol=1e-12)
    np.testing.assert_allclose(innovation.cov, H @ (F @ x.cov @ F.T + Q) @ H.T + R, atol=1e-12)


def test_a_step_against_monte_carlo():
    """2e6 draws of x and of a w that is the mixture, weighted by the density of the fix: mean and covariance
    within five standard errors, where the Kalman filter, for which w is Gaussian, is beyond ten."""
    x, F, H, Q, R, rng = problem(1)
    x = x._replace(cov=0.1 * x.cov)
    N, omega = 2_000_000, 0.9
    v = np.sqrt(omega) * direction(F, H, x.cov, Q, R)
    z = H @ (F @ x.mean + 0.7 * v)
    s = np.array([-1.0, 0.0, 1.0]) * np.sqrt(1.5)
    rest = Q - np.outer(v, v)
    values, U = np.linalg.eigh(rest)
    w = s[rng.integers(0, 3, N)][:, None] * v + rng.standard_normal((N, 4)) @ (U * np.sqrt(np.maximum(values, 0.0))).T
    draws = (x.mean + rng.standard_normal((N, 4)) @ np.linalg.cholesky(x.cov).T) @ F.T + w
    off = np.linalg.solve(np.linalg.cholesky(R), (z - draws @ H.T).T)
    p = np.exp(-0.5 * (off**2).sum(axis=0))
    p /= p.sum()
    mean = p @ draws
    d = draws - mean
    cov = (d * p[:, None]).T @ d
    se_mean = np.sqrt((p**2) @ d**2)
    se_cov = np.sqrt([[(p**2) @ (d[:, i] * d[:, j] - cov[i, j]) ** 2 for j in range(4)] for i in range(4)])
    b, _ = one_step(make_filter("asmugsf", omega=omega), x, F, H, Q, R, z)
    k, _ = one_step(make_filter("kf"), x, F, H, Q, R, z)
    assert (np.abs(b.mean - mean) / se_mean).max() < 5.0
    assert (np.abs(b.cov - cov) / se_cov).max() < 5.0
    assert (np.abs(k.mean - mean) / se_mean).max() > 10.0
    assert (np.abs(k.cov - cov) / se_cov).max() > 10.0


def test_the_split_does_not_depend_on_units():
    """States in other units, and the measurement too: the same step, seen in those units."""
    x, F, H, Q, R, rng = problem(2)
    z = rng.standard_normal(2)
    T, U = np.diag([1e-4, 3.0, 50.0, 1e3]), np.diag([1e-3, 20.0])
    back = np.linalg.inv(T)
    flt = make_filter("asmugsf")
    a, _ = one_step(flt, x, F, H, Q, R, z)
    turned = Gaussian(T @ x.mean, T @ x.cov @ T)
    b, _ = one_step(flt, turned, T @ F @ back, U @ H @ back, T @ Q @ T, U @ R @ U, U @ z)
    np.testing.assert_allclose(back @ b.mean, a.mean, atol=1e-9)
    np.testing.assert_allclose(back @ b.cov @ back, a.cov, atol=1e-9)
    np.testing.assert_allclose(b.factor, a.factor, atol=1e-9)


@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_what_is_split_off_never_exceeds_the_noise(batch):
    x, F, H, Q, R, _ = problem(3, batch=batch)
    flt = make_filter("asmugsf")
    b = flt.predict(flt.init(x), Transition(Linear(F), Q))
    v = flt.direction(b, Measurement(np.zeros((*batch, 2)), Linear(H), R))
    assert v.shape == x.mean.shape
    np.testing.assert_array_equal(v[..., -1], 0.0)
    assert np.linalg.eigvalsh(Q - v[..., :, None] * v[..., None, :]).min() > -1e-12
    for i in np.ndindex(batch):
        expected = direction(F, H, x.cov[i], Q[i], R)
        np.testing.assert_allclose(np.outer(v[i], v[i]), np.outer(expected, expected), atol=1e-10)


def test_without_noise_there_is_nothing_to_split():
    x, F, H, Q, R, _ = problem(4)
    z = np.ones(2)
    b, _ = one_step(make_filter("asmugsf"), x, F, H, 0.0 * Q, R, z)
    k, _ = one_step(make_filter("kf"), x, F, H, 0.0 * Q, R, z)
    np.testing.assert_allclose(b.mean, k.mean, atol=1e-12)
    np.testing.assert_allclose(b.cov, k.cov, atol=1e-12)
    np.testing.assert_array_equal(b.factor, 1.0)


@pytest.mark.parametrize("far", [1.0, 20.0])
@pytest.mark.parametrize("gap", [0, 2])
def test_the_noise_estimate_is_the_equation(far, gap):
    """The factors after one fix, element by element: within and beyond the gate, at once and after epochs without."""
    x, F, H, Q, R, _ = problem(5)
    fading, k0, omega = 0.9, 7, 0.5
    flt = make_filter("asmugsf", b=fading, k0=k0, omega=omega, gate=0.99)
    b, tr, mean, before = flt.init(x), Transition(Linear(F), Q), F @ x.mean, F @ x.cov @ F.T + Q
    for _ in range(gap):
        b, _ = flt.step(b, tr, None)
        mean, before = F @ mean, F @ before @ F.T + Q
    np.testing.assert_allclose(b.noise, gap * Q, atol=1e-14)
    z = H @ mean + far * np.sqrt(gap + 1) * np.array([1.0, -0.5])
    b, innovation = flt.step(b, tr, Measurement(z, Linear(H), R))
    noise = (gap + 1) * Q
    M, S = H @ noise @ H.T, H @ before @ H.T + R
    a = scipy.linalg.eigh(M, S)[1][:, -1]
    v, q = noise @ H.T @ a / np.sqrt(a @ M @ a), np.diagonal(noise)
    merged = q + omega * v**2 * ((b.weights - 1.0 / 3.0) @ np.array([1.5, 0.0, 1.5]))
    squared = innovation.residual @ np.linalg.solve(innovation.cov, innovation.residual)
    bound = scipy.stats.chi2.ppf(0.99, 2)
    assert (squared > bound) == b.health.fallbacks
    assert gap or b.health.fallbacks == (far == 20.0)
    learnt = np.diagonal(before - b.cov)
    share = np.minimum(1.0, q / learnt)
    found = q + share * ((b.mean - mean) ** 2 / max(squared / bound, 1.0) - learnt)
    d = (1.0 - fading) / (1.0 - fading**k0)
    ratio = (((1.0 - d) * merged + d * found)[:3] / q[:3]).clip(1e-6, 1e2)
    np.testing.assert_allclose(b.factor, [*ratio, 1.0], rtol=1e-9)
    assert b.fixes == 1


def track(told, runs=40, steps=1500, every=1, **settings):
    """Mean square errors of the filter, and of Kalman filters told ``told`` times the noise, and the true one; factors."""
    rng = np.random.default_rng(0)
    F, H, R = np.array([[1.0, 0.1], [0.0, 1.0]]), np.array([[1.0, 0.0]]), np.array([[0.01]])
    Q = np.diag([1e-4, 1e-2])
    flt, kf = make_filter("asmugsf", **settings), make_filter("kf")
    prior = Gaussian(np.zeros((runs, 2)), np.eye(2))
    b, wrong, right = flt.init(prior), kf.init(prior), kf.init(prior)
    x, errors = rng.standard_normal((runs, 2)), np.zeros(3)
    for k in range(steps):
        x = x @ F.T + rng.standard_normal((runs, 2)) * np.sqrt(np.diagonal(Q))
        z = x @ H.T + 0.1 * rng.standard_normal((runs, 1))
        me = Measurement(z, Linear(H), R) if k % every == 0 else None
        b, _ = flt.step(b, Transition(Linear(F), told * Q), me)
        wrong, _ = kf.step(wrong, Transition(Linear(F), told * Q), me)
        right, _ = kf.step(right, Transition(Linear(F), Q), me)
        if k >= steps // 2:
            errors += [np.square(each.mean - x).sum() for each in (b, wrong, right)]
    return errors / errors[2], told * b.factor, b


@pytest.mark.parametrize(("told", "every"), [(0.01, 1), (100.0, 1), (100.0, 4)])
def test_it_makes_good_for_a_noise_that_was_told_wrong(told, every):
    """A hundredth or a hundred times the true Q, with three of four fixes missing too: near the filter that knows it."""
    (mine, wrong, _), factor, b = track(told, every=every)
    assert wrong > 1.5
    assert mine < 1.0 + (0.1 if every == 1 else 0.25) * (wrong - 1.0)
    assert (np.abs(np.log10(np.median(factor, axis=0))) < 0.6).all()
    shown = make_filter("asmugsf").diagnostics(b)
    np.testing.assert_array_equal(shown["q_factor"], b.factor)
    assert ((shown["effective_components"] > 1.0) & (shown["effective_components"] <= 3.0 + 1e-12)).all()


def test_it_costs_little_where_the_noise_was_told_right():
    (mine, *_), factor, _ = track(1.0)
    assert mine < 1.02
    assert (np.abs(np.median(factor, axis=0) - 1.0) < 0.3).all()


def test_without_adaptation_the_noise_stays_as_told():
    (mine, wrong, _), _, b = track(100.0, runs=10, steps=200, adapt=False)
    assert mine == pytest.approx(wrong, rel=0.05)
    np.testing.assert_array_equal(b.factor, 1.0)


def test_floor_and_cap_hold():
    _, low, _ = track(100.0, runs=5, steps=300, floor=0.5)
    _, high, _ = track(0.01, runs=5, steps=300, cap=3.0)
    np.testing.assert_allclose(low.min(), 50.0)
    np.testing.assert_allclose(high.max(), 0.03)


def test_alignment_told_the_wrong_noise():
    """A minute of the task whose told noise is too large; the biases, which have none, keep none."""
    task = get_task("sway-told-wrong-v0")
    env = task.make(8, duration=60.0)
    obs, _ = task.reset(env, range(8))
    estimator = solvers.make("asmugsf")
    estimator.reset(env.unwrapped.task, np.random.default_rng(0), 8)
    for _ in range(599):
        obs, _, _, _, info = env.step(estimator.step(obs))
    assert np.isfinite(info["errors"]["phi"]).all()
    assert np.degrees(np.abs(info["errors"]["phi"])).max() < 10.0
    factor = estimator.diagnostics()["q_factor"]
    assert (factor[:, :2] < 0.2).all()
    np.testing.assert_array_equal(factor[:, 5:], 1.0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"components": 0}, "components = 0; allowed: a whole number >= 1"),
        ({"omega": 1.0}, "omega = 1.0; allowed: a number >= 0 and < 1"),
        ({"b": 0.0}, "b = 0.0; allowed: a number > 0 and <= 1"),
        ({"k0": 0}, "k0 = 0; allowed: a whole number >= 1"),
        ({"floor": 0.0}, "floor = 0.0; allowed: a number > 0 and <= 1"),
        ({"cap": 0.5}, "cap = 0.5; allowed: a finite number >= 1"),
        ({"gate": 1.1}, "gate = 1.1; allowed: a number > 0 and <= 1"),
        ({"alpha": 0.0}, "alpha = 0.0; allowed: a finite number > 0"),
    ],
)
def test_settings_are_checked(settings, message):
    with pytest.raises(ValueError, match=message):
        make_filter("asmugsf", **settings)


def test_noise_that_a_stable_system_forgets_is_not_split():
    """x' = 0.3 x + w over epochs without a fix: the noises add up to more than P, and a split by them would exceed it."""
    flt = make_filter("asmugsf", omega=0.9, adapt=False)
    x, tr = Gaussian(np.zeros(2), np.eye(2)), Transition(Linear(0.3 * np.eye(2)), np.eye(2))
    me = Measurement(np.ones(2), Linear(np.eye(2)), 0.1 * np.eye(2))
    b = flt.init(x)
    for k in range(60):
        b, _ = flt.step(b, tr, me if k % 6 == 5 else None)
        assert np.linalg.eigvalsh(b.cov)[0] > 0.0
    assert b.health.repairs == 0
    assert np.abs(b.mean).max() < 2.0
