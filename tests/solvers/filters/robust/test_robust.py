"""The reweighted update against the textbook's matrices, against a minimiser of the cost, and on its borders."""

import math

import numpy as np
import pytest
from oracles.problems import spd
from scipy.optimize import minimize

from solvers.blocks.conditioning import condition, posterior_cov
from solvers.filters.robust.reweighting import FLOOR, Correntropy, Each, Huber, StudentT, reweight, widened
from solvers.types import Gaussian, Moments

N, M = 4, 2


def case(seed, batch=(), shift=5.0):
    """A prior, the moments of z under it, and a z that is ``shift`` standard deviations from its prediction."""
    rng = np.random.default_rng(seed)
    prior = Gaussian(rng.standard_normal((*batch, N)), spd(rng, *batch, N))
    H = rng.standard_normal((*batch, M, N))
    R = spd(rng, *batch, M)
    cross = prior.cov @ H.mT
    mean = rng.standard_normal((*batch, M))
    S = H @ cross + R
    away = rng.standard_normal((*batch, M, 1))
    away = np.linalg.cholesky(S) @ away / np.linalg.norm(away, axis=-2, keepdims=True)
    return prior, Moments(mean, S, cross), mean + shift * away[..., 0]


def stacked(prior, y):
    """H, Rbar and the two roots, by plain inverses."""
    H = y.cross.T @ np.linalg.inv(prior.cov)
    R = y.cov - H @ prior.cov @ H.T
    return H, R, np.linalg.cholesky(prior.cov), np.linalg.cholesky(R)


def textbook(prior, y, z, phi, both, rounds=500):
    """Chen et al. (2017), eqs. 16-31, literally: D = W x + e, reweighted until it stands."""
    H, R, S_p, S_r = stacked(prior, y)
    S = np.block([[S_p, np.zeros((N, M))], [np.zeros((M, N)), S_r]])
    z = z - y.mean + H @ prior.mean
    D = np.linalg.solve(S, np.concatenate([prior.mean, z]))
    W = np.linalg.solve(S, np.vstack([np.eye(N), H]))
    x = prior.mean + y.cross @ np.linalg.solve(y.cov, z - H @ prior.mean)
    for _ in range(rounds):
        c = phi(D - W @ x)
        C_x, C_y = np.diag(c[:N] if both else np.ones(N)), np.diag(c[N:])
        P = S_p @ np.linalg.inv(C_x) @ S_p.T
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + S_r @ np.linalg.inv(C_y) @ S_r.T)
        x = prior.mean + K @ (z - H @ prior.mean)
    I_KH = np.eye(N) - K @ H
    return x, I_KH @ prior.cov @ I_KH.T + K @ R @ K.T


def updated(prior, y, z, weigh, rounds=500, tolerance=1e-14):
    fit = reweight(prior, y, z, weigh, rounds, tolerance)
    x = prior.mean + (fit.gain @ (z - y.mean)[..., None])[..., 0]
    return Gaussian(x, posterior_cov(prior, y, fit.gain)), fit


INFLUENCES = [
    (Huber(1.345), lambda e: np.array([min(1.0, 1.345 / abs(v)) for v in e])),
    (Correntropy(2.0), lambda e: np.exp(-(e**2) / 8.0)),
]


@pytest.mark.parametrize("robust", ["both", "meas"])
@pytest.mark.parametrize(("influence", "phi"), INFLUENCES)
@pytest.mark.parametrize("seed", range(4))
def test_it_is_the_textbook_iteration(influence, phi, robust, seed):
    prior, y, z = case(seed)
    x, P = textbook(prior, y, z, phi, robust == "both")
    got, _ = updated(prior, y, z, Each(influence, robust))
    np.testing.assert_allclose(got.mean, x, atol=1e-9)
    np.testing.assert_allclose(got.cov, P, atol=1e-9)
    assert np.abs(x - condition(prior, y, z)[0].mean).max() > 1e-2  # not the ordinary update


def cost(x, prior, y, z, rho):
    H, _, S_p, S_r = stacked(prior, y)
    e = np.linalg.solve(S_p, prior.mean - x), np.linalg.solve(S_r, z - y.mean - H @ (x - prior.mean))
    return rho(np.concatenate(e)).sum()


@pytest.mark.parametrize("seed", range(3))
def test_huber_minimises_the_cost_of_huber(seed):
    prior, y, z = case(seed)

    def rho(e):
        return np.where(np.abs(e) <= 1.345, 0.5 * e**2, 1.345 * np.abs(e) - 0.5 * 1.345**2)

    best = minimize(cost, prior.mean, (prior, y, z, rho), method="BFGS", options={"gtol": 1e-8})
    np.testing.assert_allclose(updated(prior, y, z, Each(Huber(1.345)))[0].mean, best.x, atol=2e-5)


def test_correntropy_is_a_maximum_of_the_kernels():
    prior, y, z = case(5)

    def rho(e):
        return -np.exp(-0.5 * (e / 2.0) ** 2)

    x = updated(prior, y, z, Each(Correntropy(2.0)))[0].mean
    best = minimize(cost, x, (prior, y, z, rho), method="BFGS", options={"gtol": 1e-9})
    np.testing.assert_allclose(x, best.x, atol=1e-5)


@pytest.mark.parametrize("seed", range(3))
def test_student_t_is_the_variational_iteration(seed):
    prior, y, z = case(seed)
    H, R, *_ = stacked(prior, y)
    precision = 1.0
    for _ in range(300):
        S = H @ prior.cov @ H.T + R / precision
        K = prior.cov @ H.T @ np.linalg.inv(S)
        x, P = prior.mean + K @ (z - y.mean), prior.cov - K @ S @ K.T
        r = z - y.mean - H @ (x - prior.mean)
        precision = (3.0 + M) / (3.0 + np.trace(np.linalg.inv(R) @ (np.outer(r, r) + H @ P @ H.T)))
    got, fit = updated(prior, y, z, StudentT(3.0))
    np.testing.assert_allclose(fit.weights, precision, rtol=1e-10)
    np.testing.assert_allclose(got.mean, x, atol=1e-10)
    np.testing.assert_allclose(fit.R, R, atol=1e-12)
    assert abs(precision - 1.0) > 0.1


@pytest.mark.parametrize("weigh", [Each(Huber(math.inf)), Each(Correntropy(math.inf)), StudentT(math.inf)])
def test_without_robustness_it_is_the_ordinary_update(weigh):
    prior, y, z = case(3, (5,))
    got, fit = updated(prior, y, z, weigh, rounds=3)
    best, _, _ = condition(prior, y, z)
    np.testing.assert_array_equal(fit.weights, 1.0)
    np.testing.assert_allclose(got.mean, best.mean, atol=1e-12)
    np.testing.assert_allclose(got.cov, best.cov, atol=1e-12)


@pytest.mark.parametrize("rounds", [1, 4, 20])
@pytest.mark.parametrize("weigh", [Each(Huber()), Each(Correntropy(1.5)), StudentT()])
def test_a_run_that_has_converged_rests(weigh, rounds):
    """Rows that converge at once, late and never: each is what it is alone."""
    prior, y, z = case(4, (2, 3))
    z = y.mean + (z - y.mean) * np.array([[0.0, 0.1, 1.0], [3.0, 10.0, 0.3]])[..., None]
    whole = reweight(prior, y, z, weigh, rounds)
    for i in np.ndindex(2, 3):
        alone = reweight(Gaussian(*(a[i] for a in prior)), Moments(*(a[i] for a in y)), z[i], weigh, rounds)
        np.testing.assert_allclose(whole.gain[i], alone.gain, rtol=1e-12, atol=1e-14)
        np.testing.assert_allclose(whole.weights[i], alone.weights, rtol=1e-12, atol=1e-14)


def test_rounds_go_on_until_the_weights_stand_still():
    prior, y, z = case(6)
    weigh = Each(Correntropy(2.0))
    far, close, end = (reweight(prior, y, z, weigh, k).weights for k in (2, 20, 500))
    assert np.abs(far - end).max() > 1e-4
    np.testing.assert_allclose(close, end, atol=1e-5)


def test_weights_have_a_floor():
    prior, y, _ = case(7)
    fit = reweight(prior, y, y.mean + 1e3, Each(Correntropy(0.5), "meas"), 20)
    np.testing.assert_array_equal(fit.weights, FLOOR)
    assert np.abs(fit.gain).max() < 1e-5


def test_the_covariance_of_any_gain_is_josephs():
    prior, y, _ = case(8, (3,))
    K = np.random.default_rng(0).standard_normal((3, N, M))
    for i in range(3):
        H, R, *_ = stacked(Gaussian(*(a[i] for a in prior)), Moments(*(a[i] for a in y)))
        I_KH = np.eye(N) - K[i] @ H
        joseph = I_KH @ prior.cov[i] @ I_KH.T + K[i] @ R @ K[i].T
        np.testing.assert_allclose(posterior_cov(prior, y, K)[i], joseph, atol=1e-12)


def test_a_wide_prior_explains_the_innovation():
    prior, y, _ = case(9, (2,))
    R = 0.2 * np.eye(M)
    without = y._replace(cov=y.cov - 0.1 * np.eye(M))
    residual = np.array([[9.0, -4.0], [0.01, 0.0]])
    wide, z = widened(prior, without, R, residual)
    beta = wide.cov[:, 0, 0] / prior.cov[:, 0, 0]
    np.testing.assert_allclose(M + beta[0] * np.trace(without.cov[0]) / 0.2, (81.0 + 16.0) / 0.2)
    assert beta[1] == 1.0  # never narrower
    np.testing.assert_allclose(z.cov, beta[:, None, None] * without.cov + R)
    np.testing.assert_allclose(z.cross, beta[:, None, None] * y.cross)


def test_influences_by_hand():
    e = np.array([0.0, -1.0, 2.69, -1e100])
    np.testing.assert_allclose(Huber(1.345)(e), [1.0, 1.0, 0.5, 1.345e-100])
    np.testing.assert_allclose(Correntropy(2.0)(e), [1.0, math.exp(-0.125), math.exp(-0.5 * 1.345**2), 0.0])


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Correntropy(0.4), "sigma = 0.4; allowed: a number >= 0.5, or inf"),
        (lambda: Correntropy(math.nan), "sigma = nan"),
        (lambda: Huber(0.0), "alpha = 0.0"),
        (lambda: StudentT(-1.0), "dof = -1.0"),
        (lambda: Each(Huber(), "fix"), "unknown robust 'fix'.*both, meas"),
    ],
)
def test_settings_are_checked(make, message):
    with pytest.raises(ValueError, match=message):
        make()
