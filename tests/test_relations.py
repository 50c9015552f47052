"""Filters that must agree, as data: a new filter joins by adding a row."""

import numpy as np
import pytest
from oracles.problems import look, spd, swing
from oracles.zoo import AS_KALMAN, generators, made

from solvers.filters import FILTERS, make_filter
from solvers.types import Gaussian, Linear, Measurement, Transition

A = np.array([[0.9, 0.1, 0.0, 0.0], [-0.2, 0.9, 0.1, 0.0], [0.0, 0.1, 0.95, 0.0], [0.1, 0.0, 0.0, 0.98]])
H = np.array([[1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.5]])

#: problem -> (f, h); swing and look are smooth and far from linear over one standard deviation
PROBLEMS = {
    "nonlinear": (swing, look),
    "nonlinear f": (swing, Linear(H)),
    "linear": (lambda x: x @ A.T, lambda x: x @ H.T),
}

#: (filter, settings), (filter, settings), problem, relative tolerance
SAME = [
    (("ukf", {}), ("ckf", {}), "nonlinear", 1e-12),
    (("ukf", {"root": "svd"}), ("ckf", {"root": "svd"}), "nonlinear", 1e-12),
    (("ukf", {"alpha": 1e-3, "beta": 2.0}), ("ckf", {}), "linear", 1e-8),
    (("ckf", {"root": "svd"}), ("ckf", {}), "linear", 1e-10),
    (("ekf", {}), ("kf", {}), "linear", 1e-10),
    (("ckf", {}), ("kf", {}), "linear", 1e-10),
    (("filterpy_kf", {}), ("kf", {}), "nonlinear", 1e-10),
    (("filterpy_ekf", {}), ("ekf", {}), "nonlinear", 1e-10),
    (("filterpy_ukf", {}), ("ukf", {}), "nonlinear", 1e-10),
    (
        ("filterpy_ukf", {"alpha": 0.7, "beta": 2.0, "kappa": 1.0}),
        ("ukf", {"alpha": 0.7, "beta": 2.0, "kappa": 1.0}),
        "nonlinear",
        1e-10,
    ),
]

#: pairs that must NOT agree on the nonlinear problem: without them SAME would prove nothing
DIFFERENT = [
    (("kf", {}), ("ekf", {})),
    (("ekf", {}), ("ckf", {})),
    (("ckf", {"root": "svd"}), ("ckf", {})),
    (("ukf", {"beta": 2.0}), ("ukf", {})),
    (("ukf", {"alpha": 0.5}), ("ukf", {})),
    (("ukf", {"kappa": 1.0}), ("ukf", {})),
]


def play(which, problem, runs=3, steps=40):
    """Means (steps, runs, 4) and covariances; filters of one run are looped over."""
    name, settings = which
    flt = make_filter(name, **settings)
    f, h = PROBLEMS[problem]
    rng = np.random.default_rng(42)
    x, P = rng.standard_normal((runs, 4)), spd(rng, runs, 4)
    z = 0.5 * rng.standard_normal((steps, runs, 2))
    Q, R = 0.05 * np.eye(4), 0.5 * np.eye(2)
    if flt.batched:
        return _run(flt, x, P, f, h, Q, R, z)
    each = [_run(flt, x[i], P[i], f, h, Q, R, z[:, i]) for i in range(runs)]
    means, covs = zip(*each, strict=True)
    return np.stack(means, axis=1), np.stack(covs, axis=1)


def _run(flt, x, P, f, h, Q, R, z):
    b = flt.init(Gaussian(x, P), generators(x.shape[:-1]))
    out = []
    for k, z_k in enumerate(z):
        b, _ = flt.step(b, Transition(f, Q), None if k % 5 == 3 else Measurement(z_k, h, R))
        out.append(flt.estimate(b))
    assert not b.health.frozen
    return np.array([e.mean for e in out]), np.array([e.cov for e in out])


def distance(a, b):
    """Largest difference of means and covariances, relative to the largest element."""
    return max(np.abs(u - v).max() / np.abs(v).max() for u, v in zip(a, b, strict=True))


@pytest.mark.parametrize(("a", "b", "problem", "tolerance"), SAME)
def test_same(a, b, problem, tolerance):
    assert distance(play(a, problem), play(b, problem)) < tolerance


@pytest.mark.parametrize(("a", "b"), DIFFERENT)
def test_different(a, b):
    assert distance(play(a, "nonlinear"), play(b, "nonlinear")) > 1e-4


@pytest.mark.parametrize("name", [n for n in FILTERS if AS_KALMAN.get(n, {}) is not None])
def test_every_filter_has_a_relation(name):
    assert any(name in (a[0], b[0]) for a, b, *_ in SAME)


@pytest.mark.parametrize("name", [n for n in FILTERS if FILTERS[n].batched])
def test_batch_is_its_runs(name):
    """Row i of a batch is run i alone, through nonlinear functions, to the last bits."""
    flt = made(name)
    rng = np.random.default_rng(1)
    x, P, z = rng.standard_normal((6, 4)), spd(rng, 6, 4), rng.standard_normal((6, 2))
    tr, R = Transition(swing, 0.05 * np.eye(4)), 0.5 * np.eye(2)
    batch, _ = flt.step(flt.init(Gaussian(x, P), generators((6,))), tr, Measurement(z, look, R))
    for i, own in enumerate(generators((6,))):
        one, _ = flt.step(flt.init(Gaussian(x[i], P[i]), own), tr, Measurement(z[i], look, R))
        for whole, alone in zip(flt.estimate(batch), flt.estimate(one), strict=True):
            np.testing.assert_allclose(whole[i], alone, rtol=1e-13, atol=1e-14)
