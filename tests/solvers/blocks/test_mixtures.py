import numpy as np
import pytest
from oracles.problems import look, spd, swing

from solvers.blocks.mixtures import (
    collapse,
    effective,
    merge,
    normalise,
    split,
    spread,
    spread_measurement,
    spread_transition,
)
from solvers.blocks.moments import Linearized, SigmaPoints, moments, tangent
from solvers.blocks.sigma_rules import Cubature
from solvers.types import Gaussian, Linear, Measurement, Transition

BATCHES = [(), (3,), (2, 3)]


def mixture(batch, G=3, n=4, seed=0):
    rng = np.random.default_rng(seed)
    weights = rng.random((*batch, G)) + 0.1
    return weights, Gaussian(rng.standard_normal((*batch, G, n)), spd(rng, *batch, G, n))


def moments_of(weights, x):
    """Mean and covariance by E xx' - E x E x', component by component."""
    share = weights / weights.sum()
    mean = sum(w * m for w, m in zip(share, x.mean, strict=True))
    second = sum(w * (P + np.outer(m, m)) for w, m, P in zip(share, x.mean, x.cov, strict=True))
    return mean, second - np.outer(mean, mean)


def at(x, i):
    return Gaussian(x.mean[i], x.cov[i])


@pytest.mark.parametrize("batch", BATCHES)
def test_merge_keeps_the_moments_of_weights_that_do_not_sum_to_one(batch):
    weights, x = mixture(batch)
    total, one = merge(weights, x)
    for i in np.ndindex(batch):
        mean, cov = moments_of(weights[i], at(x, i))
        assert total[i] == pytest.approx(weights[i].sum())
        np.testing.assert_allclose(one.mean[i], mean, atol=1e-14)
        np.testing.assert_allclose(one.cov[i], cov, atol=1e-13)
    np.testing.assert_array_equal(one.cov, one.cov.mT)


def test_merge_of_two_is_3_5_21_corrected():
    w, x = mixture((), 2)
    w *= 0.3
    d = x.mean[0] - x.mean[1]
    expected = (w[0] * x.cov[0] + w[1] * x.cov[1]) / w.sum() + w[0] * w[1] / w.sum() ** 2 * np.outer(d, d)
    np.testing.assert_allclose(merge(w, x)[1].cov, expected, atol=1e-14)


@pytest.mark.parametrize("batch", BATCHES)
def test_collapse_of_many_mixtures_of_the_same_components(batch):
    """Weights (..., M, G) on components (..., 1, G, n): what the mixing of an IMM asks for."""
    _, x = mixture(batch)
    mix = np.random.default_rng(1).dirichlet(np.ones(3), size=(*batch, 5))
    got = collapse(mix, Gaussian(x.mean[..., None, :, :], x.cov[..., None, :, :, :]))
    for i in np.ndindex(batch):
        for j in range(5):
            mean, cov = moments_of(mix[i][j], at(x, i))
            np.testing.assert_allclose(got.mean[i][j], mean, atol=1e-14)
            np.testing.assert_allclose(got.cov[i][j], cov, atol=1e-13)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7])
@pytest.mark.parametrize("batch", BATCHES)
def test_split_keeps_the_moments(batch, count):
    """Along the largest eigenvector, as 000 has it."""
    rng = np.random.default_rng(2)
    x = Gaussian(rng.standard_normal((*batch, 4)), spd(rng, *batch, 4))
    eta, V = np.linalg.eigh(x.cov)
    v = np.sqrt(0.9 * eta[..., -1:]) * V[..., -1]
    parts = split(x, v, count)
    assert parts.mean.shape == (*batch, count, 4)
    again = collapse(np.full((*batch, count), 1.0 / count), parts)
    np.testing.assert_allclose(again.mean, x.mean, atol=1e-14)
    np.testing.assert_allclose(again.cov, x.cov, atol=1e-13)
    assert np.linalg.eigvalsh(parts.cov).min() > 0.0
    if count == 3:
        np.testing.assert_allclose(parts.mean[..., 2, :] - x.mean, np.sqrt(1.5) * v, atol=1e-14)


def test_split_and_merge_with_a_weight():
    rng = np.random.default_rng(3)
    x = Gaussian(rng.standard_normal(3), spd(rng, 3))
    parts = split(x, 0.5 * np.linalg.cholesky(x.cov)[:, 0], 4)
    total, again = merge(np.full(4, 0.05), parts)
    assert total == pytest.approx(0.2)
    np.testing.assert_allclose(again.cov, x.cov, atol=1e-14)


def test_normalise():
    log_weights = np.array([[-1e5, -1e5 + np.log(3.0)], [0.0, -np.inf], [700.0, 701.0]])
    weights, log_total = normalise(log_weights)
    np.testing.assert_allclose(weights[:2], [[0.25, 0.75], [1.0, 0.0]], atol=1e-15)
    np.testing.assert_allclose(log_total, [-1e5 + np.log(4.0), 0.0, 701.0 + np.log1p(np.exp(-1.0))], atol=1e-10)
    np.testing.assert_allclose(weights.sum(axis=-1), 1.0)


def test_effective_number():
    np.testing.assert_allclose(effective(np.array([[0.25] * 4, [0.5, 0.5, 0, 0], [1.0, 0, 0, 0]])), [4.0, 2.0, 1.0])


class Own:
    """A map with data per run, (*batch, n) or (*batch, points, n), as the error model has it; with its Jacobian."""

    def __init__(self, A):
        self.A = A

    def __call__(self, x):
        y = swing(x)
        return y + (x @ self.A.mT if x.ndim == self.A.ndim else (self.A @ x[..., None])[..., 0])


def components(x):
    """Index of each component, run by run."""
    return list(np.ndindex(x.mean.shape[:-1]))


@pytest.mark.parametrize("rule", [Linearized(), SigmaPoints(Cubature())])
@pytest.mark.parametrize("batch", BATCHES)
def test_spread_is_a_loop_over_components(batch, rule):
    _, x = mixture(batch)
    A = 0.3 * np.random.default_rng(4).standard_normal((*batch, 4, 4))
    got, repaired = moments(spread(Own(A), len(batch)), x, rule)
    assert repaired is None
    for i in components(x):
        one, _ = moments(Own(A[i[:-1]]), at(x, i), rule)
        for a, b in zip(got, one, strict=True):
            np.testing.assert_allclose(a[i], b, atol=1e-13)


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("batch", BATCHES)
def test_spread_of_linear_maps(batch, shared):
    _, x = mixture(batch)
    rng = np.random.default_rng(5)
    own = () if shared else batch
    g = Linear(rng.standard_normal((*own, 2, 4)), rng.standard_normal((*own, 2)))
    wide = spread(g, len(batch))
    assert isinstance(wide, Linear)
    got, _ = moments(wide, x, Linearized())
    for i in components(x):
        matrix, offset = (g.matrix, g.offset) if shared else (g.matrix[i[:-1]], g.offset[i[:-1]])
        np.testing.assert_allclose(got.mean[i], matrix @ x.mean[i] + offset, atol=1e-13)
        np.testing.assert_allclose(got.cov[i], matrix @ x.cov[i] @ matrix.T, atol=1e-13)
        np.testing.assert_allclose(got.cross[i], x.cov[i] @ matrix.T, atol=1e-13)
    assert spread(Linear(g.matrix), len(batch)).offset is None


@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("batch", BATCHES)
def test_spread_models(batch, shared):
    """Noise and measurement of a run are those of each of its components."""
    rng = np.random.default_rng(6)
    own = () if shared else batch
    Q, R, z = spd(rng, *own, 4), spd(rng, *own, 2), rng.standard_normal((*batch, 2))
    tr = spread_transition(Transition(swing, Q, dt=0.5), len(batch))
    me = spread_measurement(Measurement(z, look, R), len(batch))
    _, x = mixture(batch)
    S, residual = x.cov + tr.Q, me.z - me.h(x.mean)
    assert tr.dt == 0.5
    for i in components(x):
        np.testing.assert_allclose(S[i], x.cov[i] + (Q if shared else Q[i[:-1]]), atol=1e-15)
        np.testing.assert_allclose(residual[i], z[i[:-1]] - look(x.mean[i]), atol=1e-15)
        np.testing.assert_array_equal(np.broadcast_to(me.R, (*batch, 3, 2, 2))[i], R if shared else R[i[:-1]])


def test_a_jacobian_that_the_function_has_is_used_for_components_too():
    class Known:
        def __call__(self, x):
            return x**2

        def jacobian(self, x):
            return 5.0 * x[..., None] * np.eye(x.shape[-1])  # not the true one: it shows that it was asked

    x = np.random.default_rng(7).standard_normal((2, 3, 4))
    value, J = tangent(spread(Known(), 1), x, np.ones(x.shape))
    np.testing.assert_array_equal(value, x**2)
    np.testing.assert_array_equal(J, Known().jacobian(x))
