"""Models of the noise: mixing against the enumeration of their pasts, the chain, and the products of covariances."""

import numpy as np
import pytest
from oracles.problems import spd

from solvers.pipeline.bank.models import OFFSET_STD, Models, carried, propagate
from solvers.types import Gaussian

IMU = ((1.0, 1.0), (1.0, 0.01), (30.0, 0.01))
B = slice(4, 7)


def states(rng, N, M, n):
    x = Gaussian(rng.standard_normal((N, M, n)), spd(rng, N, M, n))
    x.mean[:, :-1, B] = 0.0
    x.cov[:, :-1, B], x.cov[:, :-1, :, B] = 0.0, 0.0
    return x


def test_mixing_is_the_enumeration_of_what_a_model_came_from():
    rng = np.random.default_rng(2)
    models = Models(IMU, offset=True)
    N, M, n = 3, models.count, 7
    x, p = states(rng, N, M, n), rng.dirichlet(np.ones(M), N)
    chain = models.chain(5.0)  # a long epoch, so that all changes count
    regimes = rng.dirichlet(np.ones(5), (N, M))
    found = models.mix(p, x, regimes, chain, B)
    last = M - 1
    for k in range(N):
        for to in range(M):
            w = p[k] * chain[:, to]
            np.testing.assert_allclose(found.weight[k, to], w.sum())
            w /= w.sum()
            means, covs = x.mean[k].copy(), x.cov[k].copy()
            for origin in range(M):
                if to == last and origin != last:
                    covs[origin][B, B] = OFFSET_STD**2 * np.eye(3)
                if to != last:
                    means[origin][B] = 0.0
                    covs[origin][B], covs[origin][:, B] = 0.0, 0.0
            mean = w @ means
            cov = sum(w[j] * (covs[j] + np.outer(means[j] - mean, means[j] - mean)) for j in range(M))
            np.testing.assert_allclose(found.x.mean[k, to], mean, atol=1e-13)
            np.testing.assert_allclose(found.x.cov[k, to], cov, atol=1e-13)
            np.testing.assert_allclose(found.regimes[k, to], w @ regimes[k])


@pytest.mark.parametrize("offset", [True, False])
def test_the_chain(offset):
    models = Models(((1.0, 1.0), (1.0, 0.01), (30.0, 0.01), (30.0, 1e-4)), offset)
    for epoch_s in (0.01, 0.1, 10.0):
        A = models.chain(epoch_s)
        np.testing.assert_allclose(A.sum(axis=1), 1.0)
        assert (A >= 0.0).all()
    A = models.chain(0.1)
    np.testing.assert_allclose(A[0, 0], 0.999 + 0.001 * 0.994, atol=4e-4)
    np.testing.assert_allclose(A[1, :2], [0.001 * 0.994, 0.999 + 2e-6], atol=4e-4)
    if offset:
        np.testing.assert_allclose(A[:-1, -1], 3e-4, rtol=1e-3)
        np.testing.assert_allclose(A[-1, -1], 0.99, atol=1e-4)
        half = models.chain(0.05)
        np.testing.assert_allclose(half @ half, A, atol=1e-5)  # the same chain in time
    np.testing.assert_array_equal(models.noise[:, 0], [1.0, 1.0, 30.0, 30.0, *[1.0] * offset])
    np.testing.assert_array_equal(models.noise[:, 1], [1.0, 0.01, 0.01, 1e-4, *[1.0] * offset])


def test_one_model_stays_as_it_is():
    rng = np.random.default_rng(3)
    models = Models(((1.0, 1.0),), offset=False)
    x = Gaussian(rng.standard_normal((2, 1, 7)), spd(rng, 2, 1, 7))
    regimes = np.full((2, 1, 5), 0.2)
    found = models.mix(np.array([[1.0], [0.25]]), x, regimes, models.chain(0.1), B)
    np.testing.assert_array_equal(found.weight, [[1.0], [0.25]])
    np.testing.assert_array_equal(found.x.mean, x.mean)
    np.testing.assert_array_equal(found.x.cov, x.cov)


def test_products_of_all_models_at_once():
    rng = np.random.default_rng(4)
    F, x = rng.standard_normal((3, 7, 7)), Gaussian(rng.standard_normal((3, 4, 7)), spd(rng, 3, 4, 7))
    F[:, 5:] = np.eye(7)[5:]
    gyro, accel, factors = np.zeros((3, 7, 7)), np.zeros((7, 7)), rng.random((4, 2))
    gyro[:, :5, :5], accel[:5, :5] = spd(rng, 3, 5), spd(rng, 5)
    carried_P = F[:, None] @ x.cov @ F[:, None].mT
    np.testing.assert_allclose(carried(F, x.cov, 5), carried_P, atol=1e-12)
    after = propagate(x, F, gyro, accel, factors, 5)
    Q = factors[:, :1, None] * gyro[:, None] + factors[:, 1:, None] * accel
    np.testing.assert_allclose(after.mean, (F[:, None] @ x.mean[..., None])[..., 0], atol=1e-13)
    np.testing.assert_allclose(after.cov, carried_P + Q, atol=1e-12)
    np.testing.assert_array_equal(after.cov, after.cov.mT)
