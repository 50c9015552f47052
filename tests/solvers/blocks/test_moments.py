import numpy as np
import pytest
from oracles.problems import look, spd, swing, swing_jacobian

from solvers.blocks.moments import Linearized, SigmaPoints, correlated_moments, moments, tangent, transform
from solvers.blocks.sigma_rules import Cubature, Unscented
from solvers.types import Gaussian, Linear

RULES = [SigmaPoints(Cubature()), SigmaPoints(Unscented(), "svd"), Linearized("mean"), Linearized("origin")]
BATCHES = [(), (1,), (7,), (2, 3)]


def belief(batch, n, seed=0):
    rng = np.random.default_rng(seed)
    return Gaussian(rng.standard_normal((*batch, n)), spd(rng, *batch, n))


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("batch", BATCHES)
def test_linear_is_exact(rule, shared, batch):
    rng = np.random.default_rng(5)
    x = belief(batch, 4)
    M, o = rng.standard_normal((*(() if shared else batch), 3, 4)), rng.standard_normal((*batch, 3))
    y, repaired = moments(Linear(M, o), x, rule)
    assert repaired is None
    for i in np.ndindex(batch):
        Mi = M if shared else M[i]
        np.testing.assert_allclose(y.mean[i], Mi @ x.mean[i] + o[i], atol=1e-14)
        np.testing.assert_allclose(y.cov[i], Mi @ x.cov[i] @ Mi.T, atol=1e-14)
        np.testing.assert_allclose(y.cross[i], x.cov[i] @ Mi.T, atol=1e-14)
    np.testing.assert_array_equal(y.cov, y.cov.mT)


@pytest.mark.parametrize("rule", RULES)
@pytest.mark.parametrize("batch", BATCHES)
def test_opaque_linear_content_is_found_by_every_rule(rule, batch):
    A = np.random.default_rng(6).standard_normal((3, 4))
    x = belief(batch, 4)
    exact, _ = moments(Linear(A, np.ones(3)), x, rule)
    got, _ = moments(lambda x: x @ A.T + 1.0, x, rule)
    for a, b in zip(got, exact, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-10)


@pytest.mark.parametrize("rule", RULES)
def test_transform_is_moments_without_the_cross_covariance(rule):
    x = belief((5,), 4)
    for g in (look, Linear(np.ones((2, 4)))):
        y, _ = moments(g, x, rule)
        short, _ = transform(g, x, rule)
        np.testing.assert_allclose(short.mean, y.mean, atol=1e-15)
        np.testing.assert_allclose(short.cov, y.cov, atol=1e-15)


@pytest.mark.parametrize("rule", RULES)
def test_a_run_does_not_depend_on_its_neighbours(rule):
    x = belief((6,), 4)
    y, _ = moments(swing, x, rule)
    alone, _ = moments(swing, Gaussian(x.mean[2], x.cov[2]), rule)
    for a, b in zip(y, alone, strict=True):
        np.testing.assert_allclose(a[2], b, rtol=0, atol=1e-15)


def test_quadratic_mean_and_covariance():
    """y = x'x: the cubature mean is exact; the variance of a rule with beta = 2 is Gaussian's own."""
    x = Gaussian(np.array([0.3]), np.array([[0.25]]))
    y, _ = moments(lambda x: x**2, x, SigmaPoints(Unscented(1.0, 2.0, 0.0)))
    assert y.mean[0] == pytest.approx(0.3**2 + 0.25)
    assert y.cov[0, 0] == pytest.approx(2 * 0.25**2 + 4 * 0.3**2 * 0.25)
    assert y.cross[0, 0] == pytest.approx(2 * 0.3 * 0.25)


@pytest.mark.parametrize("batch", BATCHES)
@pytest.mark.parametrize("scale", [1.0, 0.01])
def test_numeric_jacobian(batch, scale):
    x = belief(batch, 5).mean
    value, J = tangent(swing, x, np.full_like(x, scale))
    exact = swing_jacobian(x)
    np.testing.assert_array_equal(value, swing(x))
    np.testing.assert_allclose(J, exact, rtol=0, atol=1e-9 * np.abs(exact).max())


@pytest.mark.parametrize("size", [1e-8, 1.0, 6.4e6])
@pytest.mark.parametrize("sigma", [0.0, 1e-6, 0.1])
def test_numeric_jacobian_in_any_units(size, sigma):
    """States of very different size, with steps that neither vanish in rounding nor leave the curve."""
    x = size * np.array([1.0, -0.7, 0.4])
    _, J = tangent(lambda x: np.sin(x / size) * size, x, np.full(3, sigma * size))
    np.testing.assert_allclose(J, np.diag(np.cos(x / size)), atol=1e-9)


def test_numeric_jacobian_asks_for_all_points_in_one_call():
    calls = []

    def g(x):
        calls.append(x.shape)
        return look(x)

    tangent(g, np.zeros((7, 4)), np.ones((7, 4)))
    assert calls == [(7, 9, 4)]


def test_a_jacobian_that_the_function_has_is_used():
    class Swing:
        def __call__(self, x):
            return swing(x)

        def jacobian(self, x):
            return 2.0 * swing_jacobian(x)

    x = belief((3,), 4)
    y, _ = moments(Swing(), x, Linearized())
    np.testing.assert_allclose(y.cross, 2.0 * x.cov @ swing_jacobian(x.mean).mT)


def test_where_the_tangent_touches():
    x = belief((), 4)
    at_mean, _ = moments(swing, x, Linearized("mean"))
    at_origin, _ = moments(swing, x, Linearized("origin"))
    J, J0 = swing_jacobian(x.mean), swing_jacobian(np.zeros(4))
    np.testing.assert_array_equal(at_mean.mean, swing(x.mean))
    np.testing.assert_allclose(at_mean.cov, J @ x.cov @ J.T, atol=1e-9)
    np.testing.assert_allclose(at_origin.mean, swing(np.zeros(4)) + J0 @ x.mean, atol=1e-9)
    np.testing.assert_allclose(at_origin.cov, J0 @ x.cov @ J0.T, atol=1e-9)


def test_repairs_are_reported():
    x = belief((3,), 4)
    x.cov[1, 2] = x.cov[1, :, 2] = 0.0
    y, repaired = moments(swing, x, SigmaPoints(Cubature()))
    np.testing.assert_array_equal(repaired, [False, True, False])
    eigen, none = moments(swing, x, SigmaPoints(Cubature(), "svd"))
    assert none is None
    assert np.isfinite(y.cov).all()
    assert np.isfinite(eigen.cov).all()


def test_unknown_root():
    with pytest.raises(ValueError, match="did you mean 'cholesky'"):
        SigmaPoints(Cubature(), "choleski")


def test_noise_that_is_correlated_with_the_state():
    """State and noise as one Gaussian, of which H x + v is read."""
    rng = np.random.default_rng(12)
    joint, x, H = spd(rng, 2, 7), rng.standard_normal((2, 5)), rng.standard_normal((2, 2, 5))
    y = correlated_moments(H, Gaussian(x, joint[:, :5, :5]), joint[:, 5:, 5:], joint[:, :5, 5:])
    A = np.concatenate([H, np.broadcast_to(np.eye(2), (2, 2, 2))], axis=-1)
    np.testing.assert_allclose(y.mean, (H @ x[..., None])[..., 0], atol=1e-14)
    np.testing.assert_allclose(y.cov, A @ joint @ A.mT, atol=1e-13)
    np.testing.assert_allclose(y.cross, (joint @ A.mT)[:, :5], atol=1e-13)
