"""The variational filter against a plainly written iteration, and against noise that is known."""

import numpy as np
import pytest
from oracles.problems import linear

from solvers.filters import make_filter
from solvers.types import Gaussian, Linear, Measurement, Transition

OPEN = {"floor": 0.0, "cap": 1e12}


def variational(p, tau, k0, rho, iterations):
    """Huang et al. (2018), algorithm 1, in the words of the paper: degrees of freedom u, U of R and t, T of the prediction."""
    n, m = len(p.x), len(p.H)
    x, P, u, U = p.x, p.P, k0 + m + 1, k0 * p.R
    for z in p.z:
        x_prior, P_prior = p.F @ x + p.c, p.F @ P @ p.F.T + p.Q
        t_prior, T_prior = tau + n + 1, tau * P_prior
        u_prior, U_prior = rho * (u - m - 1) + m + 1, rho * U

        def update(Pt, Rt, z=z, x_prior=x_prior):
            K = Pt @ p.H.T @ np.linalg.inv(p.H @ Pt @ p.H.T + Rt)
            return x_prior + K @ (z - p.H @ x_prior - p.d), Pt - K @ p.H @ Pt

        x, P = update(P_prior, U / (u - m - 1))
        for _ in range(iterations):
            A = P + np.outer(x - x_prior, x - x_prior)  # (25)
            e = z - p.H @ x - p.d
            B = np.outer(e, e) + p.H @ P @ p.H.T  # (26)
            t, T = t_prior + 1, T_prior + A  # (29)
            u, U = u_prior + 1, U_prior + B  # (32)
            x, P = update(T / (t - n - 1), U / (u - m - 1))  # (38-40)
        yield x, P, U / (u - m - 1)


@pytest.mark.parametrize("opaque", [False, True])
def test_it_is_the_textbook_iteration(opaque):
    p = linear(3, 4, 2, missing=0.0, steps=12)
    settings = {"tau": 2.5, "k0": 7.0, "rho": 0.95, "iterations": 3}
    flt = make_filter("vb_ckf", **settings, **OPEN)
    f, h = ((lambda x, M=M, c=c: x @ M.T + c) if opaque else Linear(M, c) for M, c in ((p.F, p.c), (p.H, p.d)))
    b, L = flt.init(Gaussian(p.x, p.P)), np.linalg.cholesky(p.R)
    for z, (x, P, R) in zip(p.z, variational(p, **settings), strict=True):
        b, _ = flt.step(b, Transition(f, p.Q), Measurement(z, h, p.R))
        for got, expected in ((b.mean, x), (b.cov, P), (p.R + L @ b.excess @ L.T, R)):
            np.testing.assert_allclose(got, expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def walk(runs, steps, told_Q, told_R, q=0.02, R=None, outliers=(), **settings):
    """Track a random walk in two dimensions; return the beliefs at the end, and the true states there."""
    rng, R = np.random.default_rng(5), np.eye(2) if R is None else R
    root, x = np.linalg.cholesky(R), np.zeros((runs, 2))
    flt = make_filter("vb_ckf", **settings)
    b = flt.init(Gaussian(x, np.eye(2)))
    one = Linear(np.eye(2))
    for k in range(steps):
        x = x + np.sqrt(q) * rng.standard_normal(x.shape)
        z = x + rng.standard_normal(x.shape) @ root.T
        if k in outliers:
            z = z + 10.0
        b, _ = flt.step(b, Transition(one, told_Q * np.eye(2)), Measurement(z, one, told_R))
    return b, x, flt


@pytest.mark.parametrize("factor", [0.01, 100.0])
def test_a_wrong_R_is_found_within_its_standard_error(factor):
    """Variances and correlation, of constant noise told wrong; a variance from k fixes has the relative error sqrt(2 / k)."""
    R, runs, steps = np.array([[1.0, 0.6], [0.6, 2.0]]), 40, 600
    b, _, _ = walk(runs, steps, 0.02, factor * np.eye(2), R=R, adapt="R", rho=1.0, k0=0.1, iterations=3)
    found = factor * (np.eye(2) + b.excess)
    for i, j in ((0, 0), (1, 1), (0, 1)):
        one = np.sqrt((R[i, i] * R[j, j] + R[i, j] ** 2) / steps)
        assert abs(found[:, i, j].mean() - R[i, j]) < one
        assert 0.65 * one < found[:, i, j].std(ddof=1) < 1.45 * one  # a standard deviation of 40 is good to 11 %
    assert b.health.repairs.sum() == 0


def test_a_Q_told_too_small_costs_less_than_it_costs_the_cubature_filter():
    errors = {}
    for adapt in ("none", "Q"):
        b, x, _ = walk(100, 200, 0.02 / 50, np.eye(2), adapt=adapt, tau=1.0, iterations=3)
        off = b.mean - x
        errors[adapt] = np.mean(off**2), np.mean(off[:, None] @ np.linalg.solve(b.cov, off[..., None])) / 2
    assert errors["Q"][0] < 0.7 * errors["none"][0]
    assert errors["Q"][1] < 0.6 * errors["none"][1]  # consistency, which should be 1


def test_a_burst_of_outliers_is_forgotten():
    """Ten fixes, each 10 standard deviations off: R takes them up, and three hundred fixes later the track is held as before."""
    settings = {"outliers": range(99, 109), "iterations": 3}
    b, x, _ = walk(20, 109, 0.02, np.eye(2), adapt="R", **settings)
    assert np.sqrt(np.mean((b.mean - x) ** 2)) < 3.0  # ckf: 7.5
    b, x, flt = walk(20, 400, 0.02, np.eye(2), **settings)
    assert np.sqrt(np.mean((b.mean - x) ** 2)) < 0.5  # ckf: 0.34
    assert (np.linalg.eigvalsh(b.cov) > 0).all()
    assert (flt.diagnostics(b)["R"] < 3.0).all()


def test_R_stays_within_floor_and_cap_and_a_direction_without_noise_keeps_none():
    told = np.array([[1.0, 0.0], [0.0, 0.0]])
    b, x, flt = walk(5, 60, 0.02, told, R=np.array([[1e4, 0.0], [0.0, 1e-12]]), cap=4.0, rho=0.5)
    np.testing.assert_allclose(flt.diagnostics(b)["R"][:, 0].max(), 4.0, rtol=1e-9)
    np.testing.assert_allclose(b.mean[:, 1], x[:, 1], atol=1e-5)
    b, _, flt = walk(5, 100, 0.02, 1e3 * np.eye(2), R=np.eye(2), floor=0.5)
    assert (np.abs(flt.diagnostics(b)["R"] - 0.5) < 1e-9).all()
    assert (flt.diagnostics(b)["fixes"] < 101.0).all()


def test_bad_settings_are_refused():
    for wrong in (
        {"adapt": "q"},
        {"tau": 0.0},
        {"rho": 1.1},
        {"iterations": 0},
        {"floor": 2.0},
        {"cap": 0.5},
        {"gate": 0},
    ):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            make_filter("vb_ckf", **wrong)
