"""Fits of rotations against scipy, the textbook's K and the K of optimisation-based alignment as published."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sins_env import attitude
from solvers.pipeline.coarse.fits import by_davenport, by_svd, triad

FITS = pytest.mark.parametrize("fit", [by_svd, by_davenport])


def noisy_pairs(batch, pairs=6, noise=0.3, seed=0):
    """u, v (*batch, pairs, 3) with u = C v + noise, and weights (pairs,)."""
    rng = np.random.default_rng(seed)
    C = Rotation.random(int(np.prod(batch)), rng=rng).as_matrix().reshape(*batch, 1, 3, 3)
    v = rng.standard_normal((*batch, pairs, 3))
    u = (C @ v[..., None])[..., 0] + noise * rng.standard_normal(v.shape)
    return u, v, rng.uniform(0.1, 2.0, pairs)


def profile(u, v, w):
    return np.swapaxes(w[:, None] * u, -1, -2) @ v


@FITS
@pytest.mark.parametrize("batch", [(), (5,), (2, 3)])
@pytest.mark.parametrize("noise", [0.3, 10.0])  # at 10 many profiles have a negative determinant
def test_against_scipy(fit, batch, noise):
    u, v, w = noisy_pairs(batch, noise=noise)
    found = fit(profile(u, v, w))
    for i in np.ndindex(batch):
        expected, _ = Rotation.align_vectors(u[i], v[i], weights=w)
        assert_allclose(found[i], expected.as_matrix(), atol=1e-9)


def test_against_the_matrices_of_the_literature():
    """Davenport's K, and the sum of (beta+ - alpha-)'(beta+ - alpha-), whose smallest eigenvector Wu et al. take."""
    u, v, w = noisy_pairs(())
    M = profile(u, v, w)
    z = np.sum(w[:, None] * np.cross(v, u), axis=0)
    K = np.block([[np.trace(M), z], [z[:, None], M + M.T - np.trace(M) * np.eye(3)]])
    assert_allclose(attitude.davenport(M), K - np.trace(M) * np.eye(4), atol=1e-12)
    published = np.zeros((4, 4))
    for u_k, v_k, w_k in zip(u, v, w, strict=True):
        plus = np.block([[0.0, -u_k], [u_k[:, None], attitude.skew(u_k)]])
        minus = np.block([[0.0, -v_k], [v_k[:, None], -attitude.skew(v_k)]])
        published += w_k * (plus - minus).T @ (plus - minus)
    q = np.linalg.eigh(published)[1][:, 0]
    assert_allclose(attitude.to_dcm(q), by_davenport(M), atol=1e-9)


@FITS
def test_profiles_that_leave_the_rotation_open(fit):
    """None is an error: rank one takes its vector over, zero and NaN are what the docstring says, and nobody else's run."""
    u, v, w = noisy_pairs((4,), noise=0.0)
    M = profile(u, v, w)
    expected = fit(M[0])
    M[1] = np.outer(u[1, 0], v[1, 0])
    M[2], M[3, 0, 0] = 0.0, np.nan
    C = fit(M)
    assert_allclose(C[0], expected, atol=1e-15)
    for i in (0, 1, 2):
        assert_allclose(C[i] @ C[i].T, np.eye(3), atol=1e-12)
        assert np.linalg.det(C[i]) > 0
    assert_allclose(C[1] @ v[1, 0] / np.linalg.norm(v[1, 0]), u[1, 0] / np.linalg.norm(u[1, 0]), atol=1e-9)
    assert np.isnan(C[3]).all()


def test_the_fit_of_nothing_is_the_identity():
    assert_allclose(by_svd(np.zeros((3, 3))), np.eye(3))


def test_triad_against_scipy():
    """scipy's align_vectors with one weight infinite anchors on that vector."""
    u, v, _ = noisy_pairs((7,), pairs=2)
    found = triad(u[:, 0], u[:, 1], v[:, 0], v[:, 1])
    for C, u_k, v_k in zip(found, u, v, strict=True):
        expected, _ = Rotation.align_vectors(u_k, v_k, weights=[np.inf, 1.0])
        assert_allclose(C, expected.as_matrix(), atol=1e-9)
    assert_allclose(triad(u[0, 0], u[0, 1], v[0, 0], 2.0 * v[0, 0])[:, 1:] @ np.zeros(2), 0.0)
