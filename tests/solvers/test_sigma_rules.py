import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints
from oracles.problems import look, spd

from solvers.blocks.moments import SigmaPoints
from solvers.blocks.sigma_rules import Cubature, Points, Unscented, points
from solvers.types import Gaussian

UNSCENTED = [(1.0, 0.0, 0.0), (1e-3, 2.0, 0.0), (0.5, 2.0, 1.0), (1.0, 0.0, -1.0)]
RULES = [Cubature(), *(Unscented(*settings) for settings in UNSCENTED)]


@dataclass(frozen=True)
class FifthDegree:
    """Unequal and negative weights, 2 n^2 + 1 points (Jia, Xin & Cheng 2013), to test what rules may do."""

    def build(self, n):
        pairs = [(e + s * f) / math.sqrt(2) for e, f in combinations(np.eye(n), 2) for s in (1, -1)]
        xi = math.sqrt(n + 2) * np.array([np.zeros(n), *pairs, *np.eye(n), *np.negative(pairs), *-np.eye(n)])
        w = np.full(len(xi), 1 / (n + 2) ** 2)
        w[np.count_nonzero(xi, axis=1) == 1] = (4 - n) / (2 * (n + 2) ** 2)
        w[0] = 2 / (n + 2)
        total = w[1:].sum()
        return Points(xi, w, w, True, total=total, pull=w[0] + total - 2 + 1 / total, equal=None)


@pytest.mark.parametrize("n", [2, 3, 10, 15])
@pytest.mark.parametrize("rule", [*RULES, FifthDegree()])
def test_points_have_the_moments_of_the_standard_normal(rule, n):
    p = points(rule, n)
    assert p.wm.sum() == pytest.approx(1.0, abs=1e-9)
    np.testing.assert_allclose(p.wm @ p.xi, 0.0, atol=1e-12)
    np.testing.assert_allclose((p.wc[:, None] * p.xi).T @ p.xi, np.eye(n), atol=1e-12)
    np.testing.assert_array_equal(p.wm[1:], p.wc[1:])
    assert p.total == pytest.approx(p.wm[1 if p.centre else 0 :].sum(), rel=1e-12)
    assert p.centre == (not p.xi[0].any())


@pytest.mark.parametrize("rule", RULES[1:])
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
        ({"alpha": 0.0}, "alpha = 0.0: must be a finite number > 0"),
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
    with pytest.raises(ValueError, match=r"kappa = -3.0: must be greater than -3"):
        points(Unscented(kappa=-3.0), 3)
