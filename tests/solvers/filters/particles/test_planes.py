"""Particles in planes: every number of particles, whole planes or not, against plain products."""

import numpy as np
import pytest

from solvers.filters.particles import planes
from solvers.filters.particles.pf import driven_columns
from solvers.filters.particles.planes import LANES
from solvers.filters.particles.random_points import normals


@pytest.fixture(params=[1, 2, LANES - 1, LANES, LANES + 1, 3 * LANES])
def x(request):
    return np.random.default_rng(0).standard_normal((2, request.param, 4)) + 3.0


def test_moments(x):
    rng, M = np.random.default_rng(1), x.shape[1]
    w = rng.dirichlet(np.ones(M), size=2)
    got = planes.cloud_moments(x, w)
    mean = (w[..., None] * x).sum(axis=1)
    apart = x - mean[:, None]
    np.testing.assert_allclose(got.mean, mean, rtol=1e-13)
    np.testing.assert_allclose(got.cov, apart.mT @ (w[..., None] * apart), atol=1e-13)
    np.testing.assert_array_equal(got.cov, got.cov.mT)
    np.testing.assert_allclose(planes.second_moments(x), x.mT @ x / M, rtol=1e-13)


def test_affine_maps(x):
    rng = np.random.default_rng(2)
    origin, A, to = rng.standard_normal((2, 4)), rng.standard_normal((3, 4)), rng.standard_normal(3)
    A[1, 2] = 0.0
    np.testing.assert_allclose(planes.affine(x, origin, A, to), (x - origin[:, None]) @ A.T + to, atol=1e-13)


def test_copies_are_roughened(x):
    rng, M = np.random.default_rng(3), x.shape[1]
    mean, N, S = rng.standard_normal((2, 4)), rng.standard_normal((2, 2, M)).mT, rng.standard_normal((4, 2))
    expected = mean[:, None] + 0.6 * (x - mean[:, None]) + N @ S.T
    np.testing.assert_allclose(planes.roughened(x, mean, 0.6, N, S), expected, atol=1e-13)
    which = rng.integers(M, size=(2, M))
    np.testing.assert_array_equal(planes.taken(x, which), np.take_along_axis(x, which[..., None], axis=1))


def test_noise_of_a_run_does_not_depend_on_the_directions_that_others_drive():
    keys, M = np.array([5, 7]), 3
    Q_root = np.array([np.diag([0.0, 2.0, 0.0, 3.0]), np.diag([1.0, 2.0, 0.0, 3.0])])

    def noise(S, keys):
        S = driven_columns(S)
        return normals("random", keys, 1, 0, S.shape[-1], M).mT @ S.mT

    both = noise(Q_root, keys)
    assert (both[0][:, [0, 2]] == 0.0).all()
    assert (both[0][:, [1, 3]] != 0.0).all()
    for i in range(2):
        np.testing.assert_array_equal(both[i], noise(Q_root[i], keys[i : i + 1])[0])
    assert driven_columns(np.zeros((4, 4))).shape == (4, 0)
