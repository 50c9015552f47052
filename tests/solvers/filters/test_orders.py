"""The claimed order of each moment rule, as data: how its error shrinks with the spread of x, by Gauss-Hermite grids."""

import math

import numpy as np
import pytest
from oracles.problems import spd
from oracles.quadrature import gauss_hermite

from solvers.filters import make_filter
from solvers.types import Gaussian, Transition

#: filter, settings, order in sigma of the error of the mean and of the covariance
ORDERS = [
    ("ekf", {}, 2, 4),
    ("ddf1", {}, 2, 4),
    ("ddf2", {}, 4, 4),
    ("ukf", {"beta": 2.0}, 4, 4),
    ("ckf", {}, 4, 4),
    ("ckf", {"form": "square-root"}, 4, 4),
    ("ckf5", {}, 6, 6),
]


def bent(x):
    """A smooth map of two states."""
    return np.stack([np.sin(x[..., 0] + 0.5 * x[..., 1]), np.exp(0.5 * x[..., 1]) * x[..., 0]], axis=-1)


def twisted(x):
    """Another, of three."""
    a, b, c = x[..., 0], x[..., 1], x[..., 2]
    return np.stack([np.sin(a + b) * c, np.cos(b - 0.5 * c), np.exp(0.3 * a) + b * c], axis=-1)


@pytest.mark.parametrize(("f", "n"), [(bent, 2), (twisted, 3)])
@pytest.mark.parametrize(("name", "settings", "mean_order", "cov_order"), ORDERS)
def test_the_error_shrinks_as_claimed(name, settings, mean_order, cov_order, f, n):
    rng = np.random.default_rng(n)
    x, P = rng.standard_normal(n), spd(rng, n)
    flt = make_filter(name, **settings)
    errors = []
    for sigma in (0.2, 0.1):
        mean, cov, _ = gauss_hermite(f, x, sigma**2 * P, 14)
        got = flt.estimate(flt.predict(flt.init(Gaussian(x, sigma**2 * P)), Transition(f, np.zeros((n, n)))))
        errors.append((np.abs(got.mean - mean).max(), np.abs(got.cov - cov).max()))
    coarse, fine = errors
    for a, b, order in zip(coarse, fine, (mean_order, cov_order), strict=True):
        assert b > 1e-14  # above rounding
        assert math.log2(a / b) == pytest.approx(order, abs=0.25)
