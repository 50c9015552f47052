"""Filters that must agree, as data: a new filter joins by adding a row."""

import math

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
    (("iekf", {"iterations": 1}), ("ekf", {}), "nonlinear", 1e-12),
    (("iekf", {"smooth": False}), ("ekf", {}), "nonlinear f", 1e-10),
    (("iekf", {"tolerance": 0.0, "iterations": 9}), ("kf", {}), "linear", 1e-10),
    (("inekf", {}), ("ekf", {}), "nonlinear", 1e-12),  # the coordinates are the pipeline's
    (("ckf", {}), ("kf", {}), "linear", 1e-10),
    (("ckf5", {}), ("kf", {}), "linear", 1e-10),
    (("ddf1", {}), ("kf", {}), "linear", 1e-10),
    (("ddf2", {}), ("kf", {}), "linear", 1e-10),
    (("ddf1", {"interval": 1e-4}), ("ekf", {}), "nonlinear", 1e-7),
    (("ckf", {"form": "square-root"}), ("ckf", {}), "nonlinear", 1e-10),
    (
        ("ukf", {"form": "square-root", "alpha": 0.7, "beta": 2.0, "kappa": 1.0}),
        ("ukf", {"alpha": 0.7, "beta": 2.0, "kappa": 1.0}),
        "nonlinear",
        1e-10,
    ),
    (("filterpy_kf", {}), ("kf", {}), "nonlinear", 1e-10),
    (("filterpy_ekf", {}), ("ekf", {}), "nonlinear", 1e-10),
    (("filterpy_ukf", {}), ("ukf", {}), "nonlinear", 1e-10),
    (
        ("filterpy_ukf", {"alpha": 0.7, "beta": 2.0, "kappa": 1.0}),
        ("ukf", {"alpha": 0.7, "beta": 2.0, "kappa": 1.0}),
        "nonlinear",
        1e-10,
    ),
    (("gsf_ekf", {}), ("ekf", {}), "nonlinear", 1e-12),
    (("imm_ekf", {"q_factors": [1.0, 1.0], "r_factors": [1.0, 1.0]}), ("ekf", {}), "nonlinear", 1e-9),
    (("imm_ukf", {"q_factors": [1.0, 1.0], "r_factors": [1.0, 1.0]}), ("ukf", {}), "nonlinear", 1e-9),
    (("imm_ukf", {"q_factors": [1.0], "r_factors": [1.0]}), ("ukf", {}), "nonlinear", 1e-12),
    (("asmugsf", {"components": 1, "adapt": False}), ("ukf", {}), "nonlinear", 1e-12),
    (("asmugsf", {"omega": 0.0, "adapt": False}), ("ukf", {}), "nonlinear", 1e-12),
    (("aukf", {"adapt": "none"}), ("ukf", {}), "nonlinear", 1e-12),
    (("aukf_fading", {"adapt": "none", "beta": 2.0}), ("ukf", {"beta": 2.0}), "nonlinear", 1e-12),
    (("aukf_fading", {"b": 1.0, "adapt": "qQ"}), ("aukf", {"adapt": "qQ"}), "nonlinear", 1e-12),
    (
        ("aukf_fading", {"b": 0.9, "adapt": "QR"}),
        ("aukf_window", {"b": 0.9, "m": 100, "adapt": "QR"}),
        "nonlinear",
        1e-9,
    ),
    (("aukf", {}), ("aukf_window", {"b": 1.0, "m": 60}), "nonlinear", 1e-9),  # 60 > k0 + 40 epochs would be whole
    (("augmented_aukf", {"adapt": "none"}), ("kf", {}), "linear", 1e-10),
    (("augmented_aukf", {"M": 60}), ("aukf", {}), "linear", 1e-9),
    (("hinf_kf", {"gamma2": np.inf}), ("kf", {}), "nonlinear", 1e-12),
    (("hinf_ukf", {"gamma2": np.inf}), ("ukf", {}), "nonlinear", 1e-12),
    (("hinf_uif", {}), ("hinf_ukf", {}), "nonlinear", 1e-9),
    (("mixed_hinf_ukf", {"gamma2": np.inf}), ("ukf", {}), "nonlinear", 1e-12),
    (("mixed_hinf_ukf", {"d": 1.0}), ("ukf", {}), "nonlinear", 1e-12),
    (("huber_ckf", {"alpha": math.inf}), ("ckf", {}), "nonlinear", 1e-9),
    (("mcc_ckf", {"sigma": math.inf}), ("ckf", {}), "nonlinear", 1e-9),
    (("mcc_ckf", {"sigma": 1e6}), ("ckf", {}), "nonlinear", 1e-9),
    (("huber_ckf5", {"alpha": math.inf}), ("ckf5", {}), "nonlinear", 1e-9),
    (("mcc_ckf5", {"sigma": math.inf}), ("ckf5", {}), "nonlinear", 1e-9),
    (("student_t_ckf", {"dof": math.inf}), ("ckf", {}), "nonlinear", 1e-9),
    (("gm_ekf", {}), ("ekf", {}), "nonlinear", 1e-12),
    (("gm_ekf", {"contamination": [0.0, 10.0]}), ("ekf", {}), "nonlinear", 1e-12),
    (("gm_ekf", {"contamination": [0.3, 1.0]}), ("ekf", {}), "nonlinear", 1e-10),
    (("mpf_ekf", {"weight": math.inf}), ("ekf", {}), "nonlinear", 1e-12),
    (("cgpf", {}), ("kf", {}), "linear", 1e-10),  # all particles weigh the same
    (("cgpf", {}), ("ckf", {}), "nonlinear f", 1e-10),
    (("ugpf", {"beta": 2.0}), ("ukf", {"beta": 2.0}), "nonlinear f", 1e-10),
    (("ugpf", {}), ("cgpf", {}), "nonlinear", 1e-10),
    (("gpf", {"min_ess": 0.999}), ("ckf", {}), "linear", 1e-10),  # every step falls back
]

#: pairs that must NOT agree on the nonlinear problem: without them SAME would prove nothing
DIFFERENT = [
    (("gpf", {}), ("ckf", {})),
    (("rqmc_gpf", {}), ("gpf", {})),
    (("cgpf", {}), ("ckf", {})),
    (("cgpf", {"widen": 1.2}), ("cgpf", {})),
    (("ugpf", {"beta": 2.0}), ("ugpf", {})),
    (("upf", {}), ("hepf", {})),
    (("kf", {}), ("ekf", {})),
    (("ekf", {}), ("ckf", {})),
    (("iekf", {}), ("ekf", {})),
    (("iekf", {}), ("iekf", {"smooth": False})),
    (("iekf", {}), ("iekf", {"iterations": 2})),
    (("ckf", {"root": "svd"}), ("ckf", {})),
    (("ckf5", {}), ("ckf", {})),
    (("ddf1", {}), ("ekf", {})),
    (("ddf2", {}), ("ddf1", {})),
    (("ddf2", {}), ("ckf", {})),
    (("ukf", {"beta": 2.0}), ("ukf", {})),
    (("ukf", {"alpha": 0.5}), ("ukf", {})),
    (("ukf", {"kappa": 1.0}), ("ukf", {})),
    (("imm_ekf", {}), ("ekf", {})),
    (("imm_ukf", {}), ("imm_ekf", {})),
    (("imm_ukf", {"q_factors": [1.0]}), ("ukf", {})),
    (("imm_ukf", {"r_factors": [1.0]}), ("ukf", {})),
    (("asmugsf", {}), ("ukf", {})),
    (("asmugsf", {"adapt": False}), ("ukf", {})),
    (("asmugsf", {"components": 1}), ("ukf", {})),
    (("gsf_ekf", {"axis": 0}), ("ekf", {})),
    (("hinf_ukf", {}), ("ukf", {})),
    (("aukf", {}), ("ukf", {})),
    (("aukf_fading", {"b": 0.9}), ("aukf", {})),
    (("aukf_window", {"m": 10}), ("aukf", {})),
    (("augmented_aukf", {"adapt": "none"}), ("ukf", {})),
    (("augmented_aukf", {"unbiased": False}), ("augmented_aukf", {})),
    (("hinf_kf", {}), ("kf", {})),
    (("mixed_hinf_ukf", {}), ("ukf", {})),
    (("mixed_hinf_ukf", {}), ("hinf_ukf", {})),
    (("huber_ckf", {}), ("ckf", {})),
    (("mcc_ckf", {}), ("ckf", {})),
    (("mcc_ckf", {"robust": "meas"}), ("mcc_ckf", {})),
    (("mcc_ckf5", {}), ("mcc_ckf", {})),
    (("student_t_ckf", {}), ("ckf", {})),
    (("gm_ekf", {"contamination": "learn"}), ("ekf", {})),
    (("mpf_ekf", {}), ("ekf", {})),
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
