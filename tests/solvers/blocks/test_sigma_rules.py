import math
from itertools import combinations_with_replacement

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints
from oracles.problems import look, spd

from solvers.blocks.moments import SigmaPoints
from solvers.blocks.sigma_rules import Cubature, FifthDegree, Unscented, points
from solvers.types import Gaussian

UNSCENTED = [(1.0, 0.0, 0.0), (1e-3, 2.0, 0.0), (0.5, 2.0, 1.0), (1.0, 0.0, -1.0)]
RULES = [Cubature(), *(Unscented(*settings) for settings in UNSCENTED), FifthDegree()]


@pytest.mark.parametrize("n", [2, 3, 4, 10, 15])
@pytest.mark.parametrize("rule", RULES)
def test_points_have_the_moments_of_the_standard_normal(rule, n):
    p = points(rule, n)
    assert p.wm.sum() == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(p.wm @ p.xi, 0.0, atol=1e-12)
    np.testing.assert_allclose((p.wc[:, None] * p.xi).T @ p.xi, np.eye(n), atol=1e-12)
    np.testing.assert_array_equal(p.wm[1:], p.wc[1:])
    assert p.total == pytest.approx(p.wm[1 if p.centre else 0 :].sum(), rel=1e-12)
    assert p.centre == (not p.xi[0].any())
    if p.centre:
        assert p.pull == pytest.approx(p.wc[0] + p.total - 2 + 1 / p.total, rel=1e-8, abs=1e-12)


def normal_moment(powers):
    """E of the product of x_i^powers_i for independent standard normal x_i."""
    return math.prod(0 if k % 2 else math.prod(range(1, k, 2)) for k in powers)


@pytest.mark.parametrize(("rule", "degree"), [(Cubature(), 3), (FifthDegree(), 5)])
@pytest.mark.parametrize("n", range(1, 16))
def test_every_monomial_up_to_the_degree_of_the_rule_is_exact(rule, degree, n):
    p = points(rule, n)
    for d in range(1, degree + 1):
        which = np.array(list(combinations_with_replacement(range(n), d)))
        got = p.wm @ np.prod(p.xi[:, which], axis=-1)
        expected = [normal_moment(np.bincount(row, minlength=n)) for row in which]
        np.testing.assert_allclose(got, expected, rtol=0, atol=3e-14)


@pytest.mark.parametrize(("rule", "moment"), [(Cubature(), 4), (FifthDegree(), 6)])
def test_the_next_even_degree_is_not_exact(rule, moment):
    p = points(rule, 2)
    assert abs(p.wm @ p.xi[:, 0] ** moment - normal_moment([moment])) > 0.5


def test_the_fifth_degree_rule_is_as_large_as_published_and_its_weights_turn_negative():
    for n in range(1, 16):
        p = points(FifthDegree(), n)
        assert len(p.xi) == 2 * n**2 + 1
        assert (p.wm.min() < 0) == (n > 4)
    assert np.abs(points(FifthDegree(), 15).wm).sum() == pytest.approx(2.14, abs=0.005)
    gauss_hermite, weights = np.polynomial.hermite_e.hermegauss(3)
    one = points(FifthDegree(), 1)
    np.testing.assert_allclose(np.sort(one.xi[:, 0]), gauss_hermite, atol=1e-15)
    np.testing.assert_allclose(one.wm[np.argsort(one.xi[:, 0])], weights / weights.sum(), atol=1e-15)


@pytest.mark.parametrize("rule", RULES[1:-1])
def test_unscented_weights_and_points_are_filterpys(rule):
    n = 5
    theirs = MerweScaledSigmaPoints(n, rule.alpha, rule.beta, rule.kappa)
    p = points(rule, n)
    np.testing.assert_allclose(p.wm, theirs.Wm, rtol=1e-9, atol=1e-12)  # lambda + n rounds
    np.testing.assert_allclose(p.wc, theirs.Wc, rtol=1e-9, atol=1e-12)  # lambda + n rounds
    np.testing.assert_allclose(p.xi, theirs.sigma_points(np.zeros(n), np.eye(n)), atol=1e-12)


@pytest.mark.parametrize("rule", [Cubature(), Unscented(), Unscented(0.5, 2.0, 1.0), FifthDegree()])
def test_moments_are_the_plain_weighted_sums(rule):
    rng = np.random.default_rng(3)
    x = Gaussian(rng.standard_normal((4, 3)), spd(rng, 4, 3))
    got, _ = SigmaPoints(rule).moments(look, x)
    p = points(rule, 3)
    for i in range(4):
        chi = x.mean[i] + p.xi @ np.linalg.cholesky(x.cov[i]).T
        y = look(chi)
        mean = p.wm @ y
        np.testing.assert_allclose(got.mean[i], mean, atol=1e-13)
        np.testing.assert_allclose(got.cov[i], (p.wc[:, None] * (y - mean)).T @ (y - mean), atol=1e-12)
        cross = (p.wc[:, None] * (chi - x.mean[i])).T @ (y - mean)
        np.testing.assert_allclose(got.cross[i], cross, atol=1e-13)


def test_huge_weights_keep_their_digits():
    rng = np.random.default_rng(4)
    n = 10
    A = rng.standard_normal((n, n))
    x = Gaussian(3.0 * rng.standard_normal(n), spd(rng, n))
    tiny, _ = SigmaPoints(Unscented(1e-3, 2.0, 0.0)).moments(lambda x: x @ A.T, x)
    plain, _ = SigmaPoints(Unscented(1.0, 2.0, 0.0)).moments(lambda x: x @ A.T, x)
    for a, b in zip(tiny, plain, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max())


def test_points_are_cached_and_cannot_be_written():
    p = points(Unscented(0.3, 2.0, 0.0), 4)
    assert points(Unscented(0.3, 2.0, 0.0), 4) is p
    with pytest.raises(ValueError, match="read-only"):
        p.xi[0] = 1.0


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"alpha": 0.0}, "alpha = 0.0; allowed: a finite number > 0"),
        ({"alpha": math.nan}, "alpha = nan"),
        ({"beta": math.inf}, "beta = inf"),
        ({"kappa": math.nan}, "kappa = nan"),
    ],
)
def test_settings_are_checked(settings, message):
    with pytest.raises(ValueError, match=message):
        Unscented(**settings)


def test_kappa_has_a_limit_that_depends_on_the_dimension():
    points(Unscented(kappa=-3.0), 4)
    with pytest.raises(ValueError, match=r"kappa = -3.0; allowed: a number > -3"):
        points(Unscented(kappa=-3.0), 3)
