"""The update under all regimes at once: against the enumeration of the mixture, one Kalman update for each factor of R."""

import itertools

import numpy as np
import pytest
from oracles.problems import spd
from scipy import stats

from solvers.pipeline.bank import regimes
from solvers.types import Gaussian, NoiseLaw

FACTORS = np.array([0.01, 0.1, 1.0, 10.0, 100.0])
LAWS = [None, NoiseLaw(0.2, 10.0), NoiseLaw(dof=3.0)]


def enumerated(x, P, nu, H, R, p, told):
    """Mean, covariance, log of the density of nu, and probabilities of the regimes, hypothesis by hypothesis."""
    parts = []
    for (i, r), (share, f) in itertools.product(enumerate(FACTORS), zip(told.weights, told.factors, strict=True)):
        S = H @ P @ H.T + r * f * R
        K = P @ H.T @ np.linalg.inv(S)
        density = p[i] * share * stats.multivariate_normal(np.zeros(len(nu)), S).pdf(nu)
        parts.append((i, density, x + K @ nu, P - K @ S @ K.T))
    total = sum(d for _, d, _, _ in parts)
    mean = sum(d / total * m for _, d, m, _ in parts)
    cov = sum(d / total * (C + np.outer(m - mean, m - mean)) for _, d, m, C in parts)
    after = np.zeros(len(p))
    for i, d, _, _ in parts:
        after[i] += d / total
    return mean, cov, np.log(total), after


@pytest.mark.parametrize("law", LAWS)
def test_the_collapsed_update_is_the_enumerated_mixture(law):
    rng = np.random.default_rng(1)
    N, M, n, m = 3, 2, 7, 3
    x, P = rng.standard_normal((N, M, n)), spd(rng, N, M, n)
    H, R, nu = rng.standard_normal((N, m, n)), spd(rng, m), 3.0 * rng.standard_normal((N, M, m))
    nu[0] *= 10.0
    p = rng.dirichlet(np.ones(5), (N, M))
    told = regimes.cells(law)
    found = regimes.update(Gaussian(x, P), nu, H[:, None], R, p, FACTORS, told)
    constant = -0.5 * (np.linalg.slogdet(R)[1] + m * np.log(2 * np.pi))
    for i in np.ndindex(N, M):
        mean, cov, log, after = enumerated(x[i], P[i], nu[i], H[i[0]], R, p[i], told)
        np.testing.assert_allclose(found.x.mean[i], mean, atol=1e-12)
        np.testing.assert_allclose(found.x.cov[i], cov, atol=1e-11)
        np.testing.assert_allclose(found.log_likelihood[i] + constant, log, rtol=1e-12)
        np.testing.assert_allclose(found.regimes[i], after, atol=1e-13)


def test_a_fix_that_sees_nothing_uncertain_changes_nothing():
    x = Gaussian(np.ones((1, 4)), np.zeros((1, 4, 4)))
    found = regimes.update(
        x, np.ones((1, 2)), np.eye(4)[:2], np.eye(2), np.full((1, 5), 0.2), FACTORS, regimes.cells(None)
    )
    np.testing.assert_array_equal(found.x.mean, x.mean)
    np.testing.assert_array_equal(found.x.cov, x.cov)


def test_the_chain_of_the_regimes():
    rest = regimes.stationary(5, 2)
    np.testing.assert_allclose(rest, [0.025, 0.025, 0.9, 0.025, 0.025])
    p = np.array([1.0, 0.0, 0.0, 0.0, 0.0])
    A = 0.99 * np.eye(5) + 0.01 * rest
    np.testing.assert_allclose(regimes.ahead(p, rest), p @ A)
    np.testing.assert_allclose(regimes.ahead(rest, rest), rest)


def test_the_cells_of_a_told_law():
    factors, weights = regimes.cells(NoiseLaw(0.2, 10.0))
    np.testing.assert_allclose(factors, [1.0, 10.0])
    np.testing.assert_allclose(weights, [0.8, 0.2])
    for dof in (2.5, 3.0, 8.0):
        factors, weights = regimes.cells(NoiseLaw(dof=dof))
        edges = np.append(np.inf, dof / 10.0 ** np.arange(-0.25, 2.5, 0.5))  # of chi^2
        probability = -np.diff(np.append(stats.chi2(dof).cdf(edges), 0.0))
        np.testing.assert_allclose(weights, probability, atol=1e-12)
        z = np.array([0.0, 1.0, 2.0, 4.0])  # the mixture has nearly the density of Student-t
        mixture = weights @ stats.norm(0.0, np.sqrt(factors)[:, None]).pdf(z)
        np.testing.assert_allclose(mixture, stats.t(dof).pdf(z), rtol=0.4)
