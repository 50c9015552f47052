import math

import numpy as np
import pytest
from oracles.problems import look, spd
from oracles.quadrature import gauss_hermite

from solvers.blocks.factors import Differences, PairedPoints, beside, factors
from solvers.blocks.moments import SigmaPoints
from solvers.blocks.sigma_rules import Cubature, FifthDegree, Unscented
from solvers.types import Gaussian, Linear

H = math.sqrt(3.0)
PAIRED = [Cubature(), Unscented(), Unscented(1e-3, 2.0), Unscented(0.7, 2.0, 1.0), Unscented(1.0, 0.0, 2.0)]
RULES = [Differences(H, False), Differences(H, True), *map(PairedPoints, PAIRED)]


def moments(y, S):
    cov = y.slope @ y.slope.mT + (0.0 if y.rest is None else y.rest @ y.rest.mT)
    return y.mean, cov, S @ y.slope.mT


def norgaard(g, mean, S, h, second):
    """Norgaard, Poulsen & Ravn (2000), covariances as sums of outer products, one run."""
    n = len(mean)
    up = [g(mean + h * S[:, p]) for p in range(n)]
    down = [g(mean - h * S[:, p]) for p in range(n)]
    centre = g(mean)
    cov = sum(np.outer(a - b, a - b) for a, b in zip(up, down, strict=True)) / (4 * h**2)
    cross = sum(np.outer(S[:, p], up[p] - down[p]) for p in range(n)) / (2 * h)
    if not second:
        return centre, cov, cross
    bends = [a + b - 2 * centre for a, b in zip(up, down, strict=True)]
    cov = cov + (h**2 - 1) / (4 * h**4) * sum(np.outer(c, c) for c in bends)
    return (h**2 - n) / h**2 * centre + sum(up + down) / (2 * h**2), cov, cross


@pytest.mark.parametrize("second", [False, True])
@pytest.mark.parametrize("h", [1.0, H, 2.5])
def test_differences_are_norgaards(second, h):
    rng = np.random.default_rng(1)
    mean, S = rng.standard_normal((2, 3, 4)), rng.standard_normal((2, 3, 4, 4))
    got = moments(factors(look, mean, S, Differences(h, second)), S)
    for i in np.ndindex(2, 3):
        for a, b in zip(got, norgaard(look, mean[i], S[i], h, second), strict=True):
            np.testing.assert_allclose(a[i], b, atol=1e-12)


@pytest.mark.parametrize("rule", PAIRED)
def test_paired_points_have_the_moments_of_the_sigma_points(rule):
    rng = np.random.default_rng(2)
    x = Gaussian(rng.standard_normal((3, 4)), spd(rng, 3, 4))
    S = np.linalg.cholesky(x.cov)
    expected, _ = SigmaPoints(rule).moments(look, x)
    for a, b in zip(moments(factors(look, x.mean, S, PairedPoints(rule)), S), expected, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-9 if rule.__dict__.get("alpha") == 1e-3 else 1e-13)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("shared", [True, False])
def test_linear_functions_are_mapped_exactly(rule, shared):
    rng = np.random.default_rng(3)
    batch = () if shared else (2, 3)
    mean, S = rng.standard_normal((2, 3, 4)), rng.standard_normal((2, 3, 4, 4))
    A, b = rng.standard_normal((*batch, 5, 4)), rng.standard_normal((*batch, 5))
    exact = factors(Linear(A, b), mean, S, rule)
    assert exact.rest is None
    y, cov, cross = moments(exact, S)
    np.testing.assert_allclose(y, (A @ mean[..., None])[..., 0] + b, atol=1e-13)
    np.testing.assert_allclose(cov, A @ S @ S.mT @ A.mT, atol=1e-12)
    np.testing.assert_allclose(cross, S @ S.mT @ A.mT, atol=1e-12)


def second_order(x):
    """All squares along the axes, no product of two states."""
    return np.stack([x[..., 0] ** 2, x[..., 0] + 3.0 * x[..., 1] ** 2 - x[..., 2] ** 2, x[..., 2]], axis=-1)


def test_second_order_differences_have_the_moments_of_squares():
    mean, S = np.array([0.3, -1.0, 2.0]), np.diag([1.5, 0.5, 1.0])
    got = moments(factors(second_order, mean, S, Differences(H, True)), S)
    for a, b in zip(got, gauss_hermite(second_order, mean, S @ S, 6), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)


def test_the_mean_is_exact_for_every_quadratic_and_the_covariance_misses_products():
    rng = np.random.default_rng(4)
    A, mean, P = rng.standard_normal((3, 3)), rng.standard_normal(3), spd(rng, 3)
    S = np.linalg.cholesky(P)

    def quadratic(x):
        return (x * (x @ A.T)).sum(axis=-1, keepdims=True)

    y, cov, cross = moments(factors(quadratic, mean, S, Differences(H, True)), S)
    exact = gauss_hermite(quadratic, mean, P, 6)
    np.testing.assert_allclose(y, exact[0], atol=1e-12)
    np.testing.assert_allclose(cross, exact[2], atol=1e-12)
    B = S.T @ (A + A.T) @ S / 2  # the quadratic in the columns of S: var = 2 tr(B^2) + slope; the products are missed
    off = B - np.diag(np.diag(B))
    np.testing.assert_allclose(exact[1] - cov, 2 * np.sum(off**2), atol=1e-11)


@pytest.mark.parametrize(
    ("rule", "mean", "var"),
    [(Differences(H, True), 1.0, 2.0), (Differences(1.0, True), 1.0, 0.0), (Differences(H, False), 0.0, 0.0)],
)
def test_the_square_of_one_standard_normal(rule, mean, var):
    """E x^2 = 1, var x^2 = 2: what the printed 3.3.24 makes 6 (erratum 21) and the first order misses."""
    y = moments(factors(np.square, np.zeros(1), np.eye(1), rule), np.eye(1))
    np.testing.assert_allclose(y[0], mean, atol=1e-14)
    np.testing.assert_allclose(y[1], var, atol=1e-14)


def test_the_kurtosis_as_interval_gives_the_covariance_with_a_cube():
    y = moments(factors(lambda x: x**3, np.zeros(1), np.eye(1), Differences(H, True)), np.eye(1))
    np.testing.assert_allclose([y[2][0, 0], y[1][0, 0]], [3.0, 9.0], atol=1e-13)  # truth: 3 and 15


@pytest.mark.parametrize("rule", [FifthDegree(), Unscented(1.0, 0.0, -1.0)])
def test_rules_that_are_no_sum_of_squares_are_refused(rule):
    with pytest.raises(ValueError, match="has no square-root form"):
        factors(np.sin, np.zeros(5), np.eye(5), PairedPoints(rule))


def test_beside():
    a, b = np.ones((2, 3, 4, 2)), 2.0 * np.ones((4, 3))
    both = beside(a, None, b)
    assert both.shape == (2, 3, 4, 5)
    np.testing.assert_array_equal(both[1, 2, 0], [1, 1, 2, 2, 2])
