"""The square-root form of the sigma-point filters: the same estimates, more digits."""

from fractions import Fraction

import numpy as np
import pytest
from oracles.problems import look, spd, swing
from oracles.zoo import generators

from solvers.filters import make_filter
from solvers.types import Gaussian, Linear, Measurement, Transition

UKFS = [{}, {"beta": 2.0}, {"alpha": 0.5, "beta": 2.0}, {"alpha": 0.7, "beta": 2.0, "kappa": 1.0}, {"kappa": 2.0}]
BOTH = [("ckf", {}), *(("ukf", s) for s in UKFS)]


def reset(x):
    """Feedback that is not linear."""
    return x - 0.1 * np.sin(x)


def reset_jacobian(x):
    return (1.0 - 0.1 * np.cos(x))[..., None] * np.eye(x.shape[-1]) + 0.05 * np.eye(x.shape[-1], k=1)


@pytest.mark.parametrize("n", [4, 10])
@pytest.mark.parametrize(("name", "settings"), BOTH)
def test_both_forms_give_the_same_estimates(name, settings, n):
    rng = np.random.default_rng(1)
    x, P, Q, R = rng.standard_normal((5, n)), spd(rng, 5, n), 0.05 * spd(rng, n), spd(rng, 2)
    filters = [make_filter(name, form=form, **settings) for form in ("covariance", "square-root")]
    beliefs = [f.init(Gaussian(x, P), generators((5,))) for f in filters]
    for k in range(60):
        me = None if k % 4 == 2 else Measurement(0.5 * rng.standard_normal((5, 2)), look, R)
        after = [f.step(b, Transition(swing, Q), me) for f, b in zip(filters, beliefs, strict=True)]
        beliefs = [b for b, _ in after]
        if k % 7 == 5:
            beliefs = [f.relocate(b, reset, reset_jacobian) for f, b in zip(filters, beliefs, strict=True)]
        a, b = (f.estimate(b) for f, b in zip(filters, beliefs, strict=True))
        np.testing.assert_allclose(a.mean, b.mean, rtol=0, atol=1e-10 * np.abs(a.mean).max())
        np.testing.assert_allclose(a.cov, b.cov, rtol=0, atol=1e-10 * np.abs(a.cov).max())
        if me is not None:
            for u, v in zip(after[0][1], after[1][1], strict=True):
                np.testing.assert_allclose(u, v, rtol=0, atol=1e-10 * np.abs(u).max())
    assert not beliefs[1].health.repairs.any()


def exact(rows, R, z):
    """Static state, P0 = I, measurements one after the other, in rational numbers: mean and variances."""
    n = len(rows[0])
    x, P = [Fraction(0)] * n, [[Fraction(int(i == j)) for j in range(n)] for i in range(n)]
    for row, z_k in zip(rows, z, strict=True):
        h = [Fraction(v) for v in row]
        Ph = [sum(p * v for p, v in zip(line, h, strict=True)) for line in P]
        S = sum(p * v for p, v in zip(Ph, h, strict=True)) + Fraction(R)
        r = Fraction(z_k) - sum(a * v for a, v in zip(x, h, strict=True))
        x = [a + p * r / S for a, p in zip(x, Ph, strict=True)]
        P = [[P[i][j] - Ph[i] * Ph[j] / S for j in range(n)] for i in range(n)]
    return np.array([float(a) for a in x]), np.array([float(P[i][i]) for i in range(n)])


DELTA = 2.0**-28  #: delta^2 is lost beside 1, delta is not
ROWS = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 1.0 + DELTA]])


def precise(name, settings, opaque):
    """Two nearly parallel measurements of sigma = 4e-9 each: the classical example of Bierman (1977)."""
    flt = make_filter(name, **settings)
    R, z = DELTA**2, ROWS @ np.array([0.5, -1.0, 0.25])
    b = flt.init(Gaussian(np.zeros(3), np.eye(3)))
    for row, z_k in zip(ROWS, z, strict=True):
        h = (lambda x, row=row: x @ row[:, None]) if opaque else Linear(row[None])
        b, _ = flt.correct(b, Measurement(z_k[None], h, np.array([[R]])))
    mean, var = exact(ROWS, R, z)
    got = flt.estimate(b)
    return np.abs(got.mean - mean).max(), np.abs(np.diagonal(got.cov) / var - 1.0).max(), int(b.health.repairs)


@pytest.mark.parametrize("opaque", [False, True])
@pytest.mark.parametrize(
    ("name", "settings"),
    [("ckf", {"form": "square-root"}), ("ukf", {"form": "square-root", "beta": 2.0}), ("ddf1", {}), ("ddf2", {})],
)
def test_the_root_keeps_the_digits_of_a_very_precise_measurement(name, settings, opaque):
    error, variance, repairs = precise(name, settings, opaque)
    assert error < 1e-6
    assert variance < 1e-6
    assert repairs == 0


@pytest.mark.parametrize("opaque", [False, True])
@pytest.mark.parametrize("name", ["ckf", "ukf"])
def test_the_covariance_form_loses_them(name, opaque):
    """Otherwise the test above would prove nothing."""
    error, variance, _ = precise(name, {}, opaque)
    assert not (error < 1e-2 and variance < 1e-2)  # NaN where S came out negative


def test_what_has_no_square_root_form_is_refused_at_the_start():
    flt = make_filter("ukf", form="square-root", kappa=-1.0)
    with pytest.raises(ValueError, match=r"Unscented\(.*kappa=-1.0\) has no square-root form in 4 dimensions"):
        flt.init(Gaussian(np.zeros(4), np.eye(4)))
    make_filter("ukf", form="square-root", kappa=-1.0, beta=0.25).init(Gaussian(np.zeros(4), np.eye(4)))


@pytest.mark.parametrize(("name", "settings"), [("ckf", {"form": "square-root"}), ("ddf2", {})])
def test_a_fix_that_is_missing_in_one_run_changes_nothing_there(name, settings):
    """The pipeline gives such runs a huge R."""
    rng = np.random.default_rng(3)
    flt = make_filter(name, **settings)
    b = flt.init(Gaussian(rng.standard_normal((2, 4)), spd(rng, 2, 4)))
    R = np.stack([np.eye(2), 1e20 * np.eye(2)])
    after, _ = flt.correct(b, Measurement(np.zeros((2, 2)), look, R))
    np.testing.assert_allclose(after.mean[1], b.mean[1], rtol=0, atol=1e-15)
    np.testing.assert_allclose(flt.estimate(after).cov[1], flt.estimate(b).cov[1], rtol=0, atol=1e-14)
    assert np.abs(after.mean[0] - b.mean[0]).max() > 0.1
