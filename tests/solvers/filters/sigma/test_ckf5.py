import numpy as np
import pytest
from oracles.problems import spd
from oracles.quadrature import gauss_hermite

from solvers.filters import make_filter
from solvers.filters.gaussian import GaussianFilter
from solvers.filters.sigma.ckf5 import CKF5, FifthDegreeFilter
from solvers.types import Gaussian, Linear, Measurement, Transition


class Unguarded(CKF5):
    """The fifth-degree filter without its safeguard."""

    predict = GaussianFilter.predict
    correct = GaussianFilter.correct


def fifth_power(x):
    """Polynomials of degree 5 in n >= 2 states."""
    a, b = x[..., 0], x[..., 1]
    return np.stack([a**5 - 2.0 * a**2 * b**3, a**4 * b + b, a * b**2 + x[..., -1] ** 5], axis=-1)


def quadratic(x):
    return np.stack([x[..., 0] * x[..., 1], x[..., 0] ** 2 - x[..., -1], x[..., 1]], axis=-1)


@pytest.mark.parametrize("n", [2, 3])
def test_the_prediction_is_exact_to_the_claimed_degree(n):
    """The mean of degree 5, mean and covariance of degree 2; ckf is neither."""
    rng = np.random.default_rng(n)
    x = Gaussian(rng.standard_normal(n), spd(rng, n))
    for g, moments in ((fifth_power, 1), (quadratic, 2)):
        exact = gauss_hermite(g, *x, per_axis=8)[:moments]
        scale = [np.abs(e).max() for e in exact]

        def error(name, g=g, exact=exact, scale=scale):
            flt = make_filter(name)
            got = flt.estimate(flt.predict(flt.init(x), Transition(g, np.zeros((3, 3)))))
            return max(np.abs(a - b).max() / s for a, b, s in zip(got, exact, scale, strict=False))

        assert error("ckf5") < 1e-13
        assert error("ckf") > 0.01


def test_one_state_is_the_gauss_hermite_rule():
    def f(x):
        return np.sin(x) + x**2

    flt = make_filter("ckf5")
    got = flt.predict(flt.init(Gaussian(np.array([0.3]), np.array([[0.5]]))), Transition(f, np.zeros((1, 1))))
    mean, cov, _ = gauss_hermite(f, np.array([0.3]), np.array([[0.5]]), per_axis=3)
    np.testing.assert_allclose(got.mean, mean, atol=1e-15)
    np.testing.assert_allclose(got.cov, cov, atol=1e-15)


def cubic(x):
    """Its variance needs moments of degree 6, where the axes' negative weights tell: -18 for E x^6 = 15, n = 10."""
    return x**3 - 2.9 * x


@pytest.mark.parametrize("n", [10, 15])
def test_a_broken_prediction_is_the_third_degrees_and_counted_in_its_run_alone(n):
    x = Gaussian(np.zeros((3, n)), np.stack([np.eye(n), 1e-6 * np.eye(n), np.eye(n)]))
    tr = Transition(cubic, 0.01 * np.eye(n))
    broken = Unguarded().step(Unguarded().init(x), tr, None)[0]
    assert (np.diagonal(broken.cov[0]) < 0).all()
    flt = make_filter("ckf5")
    b, _ = flt.step(flt.init(x), tr, None)
    np.testing.assert_array_equal(b.health.fallbacks, [1, 0, 1])
    np.testing.assert_array_equal(b.health.repairs, 0)
    ckf = make_filter("ckf")
    third, _ = ckf.step(ckf.init(x), tr, None)
    np.testing.assert_array_equal(b.cov[[0, 2]], third.cov[[0, 2]])
    np.testing.assert_array_equal(b.mean[[0, 2]], third.mean[[0, 2]])
    np.testing.assert_array_equal(b.cov[1], broken.cov[1])


@pytest.mark.parametrize(
    ("slope", "S_is_broken"), [(1.0, True), (5.0, False)], ids=["S is indefinite", "the posterior alone is"]
)
def test_a_broken_update_is_the_third_degrees(slope, S_is_broken):
    n = 12
    x = Gaussian(np.zeros((2, n)), np.stack([np.eye(n), 1e-4 * np.eye(n)]))
    stay = Transition(Linear(np.eye(n)), np.zeros((n, n)))
    me = Measurement(np.ones((2, 2)), lambda x: x[..., :2] ** 3 + slope * x[..., :2], 0.01 * np.eye(2))

    def play(flt):
        return flt.step(flt.init(x), stay, me)

    worst, hit = play(Unguarded())
    if S_is_broken:
        assert worst.health.failed_at[0] == 1
    else:
        assert hit.cov[0, 0, 0] > 1.0
        assert np.linalg.eigvalsh(worst.cov[0])[0] < -1.0
    (b, innovation), (third, expected) = play(make_filter("ckf5")), play(make_filter("ckf"))
    np.testing.assert_array_equal(b.health.fallbacks, [1, 0])
    np.testing.assert_array_equal(b.health.repairs, 0)
    np.testing.assert_array_equal(b.mean[0], third.mean[0])
    np.testing.assert_array_equal(b.cov[0], third.cov[0])
    np.testing.assert_array_equal(innovation.cov[0], expected.cov[0])
    np.testing.assert_array_equal(b.cov[1], worst.cov[1])
    assert np.abs(b.mean[1] - third.mean[1]).max() > 0


def test_a_repair_in_the_attempt_that_is_given_up_does_not_count():
    def h(x):
        return np.stack([cubic(x[..., 0]), x[..., 1]], axis=-1)  # S is negative in one of two directions

    n = 12
    x, me = Gaussian(np.zeros(n), np.eye(n)), Measurement(np.ones(2), h, 0.01 * np.eye(2))
    stay = Transition(Linear(np.eye(n)), np.zeros((n, n)))
    counts = []
    for flt in (Unguarded(), make_filter("ckf5")):
        health = flt.step(flt.init(x), stay, me)[0].health
        counts.append((int(health.repairs), int(health.fallbacks)))
    assert counts == [(1, 0), (0, 1)]


@pytest.mark.parametrize("name", ["ckf5", Unguarded])
@pytest.mark.parametrize("n", [10, 15])
def test_a_hard_problem_is_survived(name, n):
    """Strong rotations of the state under a wide prior, as on a hot start: -P is never handed on."""
    rng = np.random.default_rng(n)
    flt = make_filter(name) if isinstance(name, str) else name()
    x = rng.standard_normal((30, n))
    b = flt.init(Gaussian(np.zeros((30, n)), np.eye(n)))

    def f(x):
        y = 0.95 * x
        y[..., 1:] += 0.7 * np.sin(2.0 * x[..., :-1])
        y[..., 0] -= 0.2 * x[..., 1] ** 3 / (1.0 + 0.1 * x[..., 1] ** 2)
        return y

    least = np.inf
    for _ in range(60):
        x = f(x) + 0.05 * rng.standard_normal((30, n))
        tr = Transition(f, 0.0025 * np.eye(n))
        least = min(least, float(np.linalg.eigvalsh(flt.predict(b, tr).cov).min()))
        z = x[:, :3] + 0.3 * rng.standard_normal((30, 3))
        b, _ = flt.step(b, tr, Measurement(z, Linear(np.eye(3, n)), 0.09 * np.eye(3)))
    if name != "ckf5":
        assert least < -0.1  # otherwise the problem would prove nothing
        return
    assert least > -1e-12
    assert not b.health.frozen
    assert (b.health.fallbacks > 0).mean() > 0.3
    assert np.isfinite(b.mean).all()
    assert np.linalg.eigvalsh(b.cov).min() > -1e-12


def test_what_is_linear_is_not_watched():
    """A covariance that is indefinite by rounding alone is no reason to fall back."""
    flt = make_filter("ckf5")
    b = flt.init(Gaussian(np.zeros(5), np.eye(5)))
    b = b._replace(cov=np.diag([1.0, 1.0, 1.0, 1.0, -1e-3]))
    b, _ = flt.step(b, Transition(Linear(np.eye(5)), np.zeros((5, 5))), None)
    assert b.health.fallbacks == 0


def test_a_mixin_without_a_third_says_so():
    class Bare(FifthDegreeFilter):
        pass

    with pytest.raises(NotImplementedError, match="Bare has nothing to fall back on"):
        _ = Bare().third
