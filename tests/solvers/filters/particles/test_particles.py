"""Particle filters: against the dense Kalman filter, quadrature on a grid, and over thousands of epochs."""

import numpy as np
import pytest
from oracles.dense_kalman import kalman
from oracles.problems import linear, look, run_of, spd, swing
from oracles.zoo import generators
from scipy import stats

from solvers.filters import make_filter
from solvers.types import Gaussian, Linear, Measurement, NoiseLaw, Transition

GAUSSIAN = ["gpf", "rqmc_gpf", "cgpf", "ugpf"]
CLOUDS = ["pf", "upf", "hepf"]
RUNS = 200


def mild():
    """One step of a linear problem whose fix is 1.2 standard deviations from its prediction."""
    p = linear(15, 4, 2, (), steps=1, missing=0.0)
    predicted = p.H @ (p.F @ p.x + p.c) + p.d
    S = p.H @ (p.F @ p.P @ p.F.T + p.Q) @ p.H.T + 4.0 * p.R
    p.R, p.z = 4.0 * p.R, [predicted + np.linalg.cholesky(S) @ np.array([1.0, -0.7])]
    return p


def one_step(name, M, **settings):
    """RUNS estimates of the same step from different draws, whitened: errors of the means and of the covariances."""
    p = mild()
    (x, P) = kalman(*run_of(p, ()))[0][0]
    flt = make_filter(name, particles=M, **settings)
    b = flt.init(Gaussian(np.broadcast_to(p.x, (RUNS, 4)), p.P), np.random.default_rng(1))
    tr = Transition(lambda x: x @ p.F.T + p.c, p.Q)
    b, _ = flt.step(b, tr, Measurement(np.broadcast_to(p.z[0], (RUNS, 2)), Linear(p.H, p.d), p.R))
    got, whiten = flt.estimate(b), np.linalg.inv(np.linalg.cholesky(P))
    assert (b.health.fallbacks == 0).all()
    return (got.mean - x) @ whiten.T, whiten @ (got.cov - P) @ whiten.T


def slope(name, **settings):
    """Of the logarithm of the mean's RMS error against that of the number of particles."""
    numbers = [256, 1024, 4096]
    errors = [np.sqrt(np.mean(one_step(name, M, **settings)[0] ** 2)) for M in numbers]
    return np.polyfit(np.log(numbers), np.log(errors), 1)[0]


@pytest.mark.parametrize("settings", [{}, {"marginal": False}, {"marginal": False, "matching": "none"}])
def test_gpf_converges_to_kalman_with_the_root_of_the_number(settings):
    assert slope("gpf", min_ess=0.0, **settings) == pytest.approx(-0.5, abs=0.06)


@pytest.mark.parametrize(("points", "at_most"), [("sobol", -0.9), ("halton", -0.62), ("halton_start", -0.62)])
def test_rqmc_gpf_converges_faster(points, at_most):
    assert slope("rqmc_gpf", min_ess=0.0, points=points) < at_most


@pytest.mark.parametrize(
    ("name", "M", "settings"),
    [
        ("gpf", 4096, {"min_ess": 0.0}),
        ("gpf", 4096, {"min_ess": 0.0, "matching": "none", "marginal": False}),
        ("rqmc_gpf", 1024, {"min_ess": 0.0}),
        ("cgpf", 1024, {"widen": 1.3, "matching": "moments"}),
        ("ugpf", 1024, {"widen": 1.3, "marginal": False, "matching": "none"}),
        ("pf", 4096, {"min_ess": 0.0}),
        ("pf", 4096, {"min_ess": 0.0, "matched": False}),
        ("upf", 256, {"min_ess": 0.0}),
        ("hepf", 256, {"min_ess": 0.0}),
    ],
)
def test_no_bias_beyond_one_in_the_number(name, M, settings):
    """The average over the runs misses the Kalman filter by no more than chance and O(1 / effective number) allow."""
    mean, cov = one_step(name, M, **settings)
    for error in (mean, cov.reshape(RUNS, -1)):
        spread = error.std(axis=0)
        assert (np.abs(error.mean(axis=0)) < 4.5 * spread / np.sqrt(RUNS) + 2.0 * spread.max() ** 2).all()
        assert (spread < 0.35).all()


@pytest.mark.parametrize("marginal", [True, False])
@pytest.mark.parametrize("name", ["cgpf", "ugpf"])
def test_particles_of_the_kalman_result_weigh_the_same(name, marginal):
    p = linear(16, 5, 2, (3,), missing=0.2)
    flt = make_filter(name, particles=64, marginal=marginal)
    b = flt.init(Gaussian(p.x, p.P), generators((3,)))
    for k, z in enumerate(p.z):
        b, _ = flt.step(
            b, Transition(Linear(p.F, p.c), p.Q), None if z is None else Measurement(z, Linear(p.H, p.d), p.R)
        )
        np.testing.assert_allclose(b.ess, 1.0, rtol=1e-10)
        for i in range(3):
            x, P = kalman(*run_of(p, i))[0][k]
            np.testing.assert_allclose(flt.estimate(b).mean[i], x, atol=1e-9)
            np.testing.assert_allclose(flt.estimate(b).cov[i], P, atol=1e-9)
    wide = make_filter(name, particles=64, widen=1.3, marginal=marginal)
    z = next(z for z in p.z if z is not None)
    b, _ = wide.step(b, Transition(Linear(p.F), p.Q), Measurement(z, Linear(p.H), p.R))
    assert (b.ess < 0.97).all()


def grid_posterior(prior, log_likelihood):
    """Mean and standard deviation of N(0, prior^2) times the likelihood, in one dimension."""
    x = np.linspace(-9 * prior, 9 * prior, 40001)
    density = np.exp(stats.norm.logpdf(x, scale=prior) + log_likelihood(x))
    density /= density.sum()
    mean = density @ x
    return mean, np.sqrt(density @ (x - mean) ** 2)


LAWS = [NoiseLaw(dof=3.0), NoiseLaw(share=0.2, factor=50.0)]


def log_law(law, v, scale):
    if law.dof:
        return stats.t.logpdf(v, law.dof, scale=scale)
    clean, dirty = stats.norm.pdf(v, scale=scale), stats.norm.pdf(v, scale=scale * np.sqrt(law.factor))
    return np.log((1 - law.share) * clean + law.share * dirty)


@pytest.mark.parametrize("z", [0.4, 3.0, 12.0])
@pytest.mark.parametrize("law", LAWS, ids=["t", "mixture"])
@pytest.mark.parametrize("name", ["gpf", "rqmc_gpf", "cgpf", "ugpf", "pf", "upf"])
def test_the_told_law_gives_the_posterior_of_a_grid(name, law, z):
    """50 runs of one fix, each alone far from exact, together unbiased to a few parts in a thousand of the prior."""
    prior, scale, runs = 1.0, 0.8, 50
    mean, sigma = grid_posterior(prior, lambda x: log_law(law, z - x, scale))
    flt = make_filter(name, particles=1000, **({"min_ess": 0.0} if name in GAUSSIAN else {"resample": 0.1}))
    b = flt.init(Gaussian(np.zeros((runs, 1)), np.array([[prior**2]])), generators((runs,)))
    b, _ = flt.correct(b, Measurement(np.full((runs, 1), z), Linear(np.eye(1)), np.array([[scale**2]]), law))
    got = flt.estimate(b)
    assert got.mean.mean() == pytest.approx(mean, abs=0.015)
    assert np.sqrt(got.cov).mean() == pytest.approx(sigma, abs=0.015)


@pytest.mark.parametrize("name", [*GAUSSIAN, *CLOUDS])
def test_the_gaussian_likelihood_does_not_hear_the_law(name):
    flt = make_filter(name, particles=64, likelihood="gaussian")
    b = flt.init(Gaussian(np.zeros((2, 3)), np.eye(3)), generators((2,)))
    me = Measurement(np.full((2, 2), 1.5), Linear(np.eye(2, 3)), np.eye(2))
    told, _ = flt.correct(b, me._replace(law=NoiseLaw(dof=3.0)))
    plain, _ = flt.correct(b, me)
    np.testing.assert_array_equal(flt.estimate(told).mean, flt.estimate(plain).mean)


def test_pf_keeps_both_modes_where_a_gaussian_cannot():
    """z = x^2 + v: two modes at +-1.4, which no Gaussian belief holds."""
    h, runs, z, sigma = (lambda x: x**2), 40, 2.0, 0.3
    flt = make_filter("pf", particles=2000, resample=0.02)
    b = flt.init(Gaussian(np.zeros((runs, 1)), np.eye(1)), generators((runs,)))
    b, _ = flt.correct(b, Measurement(np.full((runs, 1), z), h, np.array([[sigma**2]])))
    _, expected = grid_posterior(1.0, lambda x: stats.norm.logpdf(z - x**2, scale=sigma))
    got = flt.estimate(b)
    assert np.sqrt(got.cov).mean() == pytest.approx(expected, abs=0.01)
    near_zero = (np.exp(b.log_w) * (np.abs(b.x[..., 0]) < 0.7)).sum(axis=-1)
    assert near_zero.max() < 1e-3


@pytest.mark.parametrize("name", ["pf", "upf"])
def test_weights_go_on_from_fix_to_fix(name):
    """Three fixes without a resampling between them, told as Student-t: the posterior of a grid."""
    fixes, runs, law = (0.5, 3.0, 0.9), 40, NoiseLaw(dof=3.0)
    mean, sigma = grid_posterior(1.0, lambda x: sum(log_law(law, z - x, 0.8) for z in fixes))
    flt = make_filter(name, particles=1000, resample=0.05)
    b = flt.init(Gaussian(np.zeros((runs, 1)), np.eye(1)), generators((runs,)))
    for z in fixes:
        b, _ = flt.correct(b, Measurement(np.full((runs, 1), z), Linear(np.eye(1)), np.array([[0.64]]), law))
    assert flt.estimate(b).mean.mean() == pytest.approx(mean, abs=0.02)
    assert np.sqrt(flt.estimate(b).cov).mean() == pytest.approx(sigma, abs=0.02)


def slow_biases(name, epochs, runs=16, **settings):
    """NEES per state at the end: a position read at 10 Hz, a rate without noise and a bias without noise."""
    n, dt = 4, 0.1
    F = np.eye(n)
    F[0, 1] = F[1, 2] = F[2, 3] = dt
    Q, R, P0 = np.diag([1e-8, 1e-6, 0.0, 0.0]), np.array([[0.01]]), np.diag([0.04, 0.04, 1e-4, 1e-6])
    H = np.eye(1, n)
    rng = np.random.default_rng(12)
    x = rng.standard_normal((runs, n)) * np.sqrt(np.diag(P0))
    flt = make_filter(name, **settings)
    b = flt.init(Gaussian(np.zeros((runs, n)), P0), generators((runs,)))
    tr = Transition(Linear(F), Q)
    for _ in range(epochs):
        x = x @ F.T + rng.standard_normal((runs, n)) * np.sqrt(np.diag(Q))
        z = x[:, :1] + 0.1 * rng.standard_normal((runs, 1))
        b, _ = flt.step(b, tr, Measurement(z, Linear(H), R))
    mean, P = flt.estimate(b)
    e = (x - mean)[..., None]
    return (e.mT @ np.linalg.pinv(P, hermitian=True) @ e).mean() / n, b


BAND = stats.chi2.ppf([1e-3, 1 - 1e-3], 16 * 4) / (16 * 4)


@pytest.mark.parametrize("name", GAUSSIAN)
def test_no_collapse_over_1800_epochs(name):
    """Three times as long as a filter without marginal weights takes to collapse, with a tenth of the default particles.

    The band is that of a right covariance, 99.8 %, and 15 % of noise."""
    nees, b = slow_biases(name, 1800, particles=200 if name != "rqmc_gpf" else 128)
    assert BAND[0] < nees < 1.15 * BAND[1]
    assert not b.health.frozen
    assert (b.health.fallbacks < 40).all()


def test_without_marginal_weights_the_covariance_collapses():
    """What the default is for: docs/mathematics/filters.md#gaussian-particles, G.3, erratum 58."""
    nees, _ = slow_biases("gpf", 600, particles=100, marginal=False, matching="none")
    assert nees > 3.0


def test_pf_is_kept_alive_by_its_roughening():
    with_it, b = slow_biases("pf", 300, particles=300)
    assert with_it < 3.0
    assert (b.ess > 0.02).all()
    _, b = slow_biases("pf", 300, particles=300, roughening=0.0, matched=False)
    assert all(len(np.unique(biases)) == 1 for biases in b.x[..., 3])  # each run is left with one value


@pytest.mark.parametrize("batch", [(), (3,)])
def test_pf_adds_the_noise_exactly_and_copies_without_loss(batch):
    p = linear(17, 4, 2, batch, steps=1, missing=0.0)
    p.Q[..., 2:, :] = p.Q[..., :, 2:] = 0.0
    flt = make_filter("pf", particles=64, resample=1.0)
    b = flt.init(Gaussian(p.x, p.P), generators(batch))
    after = flt.predict(b, Transition(Linear(p.F, p.c), p.Q))
    got = flt.estimate(after)
    np.testing.assert_allclose(got.mean, (p.F @ p.x[..., None])[..., 0] + p.c, atol=1e-12)
    np.testing.assert_allclose(got.cov, p.F @ p.P @ p.F.mT + p.Q, atol=1e-12)
    w = np.random.default_rng(0).dirichlet(np.ones(64), size=batch)
    rows = np.ones(batch, dtype=bool)
    target = flt.estimate(after._replace(log_w=np.log(w)))
    renewed = flt.renewed(after, w, rows)[0].reshape(*batch, 64, 4)
    np.testing.assert_allclose(renewed.mean(axis=-2), target.mean, atol=1e-12)
    apart = renewed - target.mean[..., None, :]
    np.testing.assert_allclose(apart.mT @ apart / 64, target.cov, atol=1e-12)
    copies = make_filter("pf", particles=64, roughening=0.0, matched=False).renewed(after, w, rows)[0]
    assert len(np.unique(copies.reshape(-1, 64, 4)[0], axis=0)) < 60


@pytest.mark.parametrize("name", ["upf", "hepf"])
def test_the_kernel_leaves_the_moments(name):
    """x_i and P_i = kernel V together have the mean and covariance of the weighted draws."""
    p = linear(18, 4, 2, (3,), steps=5, missing=0.0)
    flt = make_filter(name, particles=100, kernel=0.3)
    b = flt.init(Gaussian(p.x, p.P), generators((3,)))
    np.testing.assert_allclose(flt.estimate(b).cov, p.P, atol=1e-12)
    for z in p.z:
        b, _ = flt.step(b, Transition(Linear(p.F, p.c), p.Q), Measurement(z, Linear(p.H, p.d), p.R))
        V = flt.estimate(b).cov
        np.testing.assert_allclose(b.P, np.broadcast_to(0.3 * V[:, None], b.P.shape), atol=1e-12)


@pytest.mark.parametrize("name", [*GAUSSIAN, *CLOUDS])
def test_reproducible_alone_and_in_a_batch_to_the_bit(name):
    """Draws depend on key and epoch alone; stepping twice from one belief is the same step."""
    rng = np.random.default_rng(3)
    x, P, z = rng.standard_normal((5, 4)), spd(rng, 5, 4), rng.standard_normal((3, 5, 2))
    flt = make_filter(name, particles=64)
    tr, R = Transition(swing, 0.05 * np.eye(4)), 0.5 * np.eye(2)

    def play(runs, own):
        b = flt.init(Gaussian(x[runs], P[runs]), own)
        for z_k in z:
            first, _ = flt.step(b, tr, Measurement(z_k[runs], look, R))
            b, _ = flt.step(b, tr, Measurement(z_k[runs], look, R))
            np.testing.assert_array_equal(flt.estimate(first).mean, flt.estimate(b).mean)
        return flt.estimate(b), b.key

    whole, keys = play(slice(0, 5), generators((5,)))
    again, _ = play(slice(0, 5), generators((5,)))
    np.testing.assert_array_equal(whole.mean, again.mean)
    for i, own in enumerate(generators((5,))):
        alone, key = play(i, own)
        assert key == keys[i]
        np.testing.assert_allclose(alone.mean, whole.mean[i], rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(alone.cov, whole.cov[i], rtol=1e-12, atol=1e-13)
    other, _ = play(slice(0, 5), generators((5,), seed=1))
    assert (other.mean != whole.mean).all()


@pytest.mark.parametrize("name", [*GAUSSIAN, *CLOUDS])
def test_memory_changes_nothing(name):
    p = linear(19, 4, 2, (3,), steps=4, missing=0.0)
    rng_of = lambda: generators((3,))  # noqa: E731
    widest = []

    def f(x):
        widest.append(x.shape[-2] if x.ndim == 3 else 1)
        return swing(x)

    def play(memory_mb):
        widest.clear()
        flt = make_filter(name, particles=64, memory_mb=memory_mb)
        b = flt.init(Gaussian(p.x, p.P), rng_of())
        for z in p.z:
            b, _ = flt.step(b, Transition(f, p.Q), Measurement(z, look, p.R))
        return flt.estimate(b), max(widest)

    (whole, most), (sliced, few) = play(100.0), play(0.008)
    np.testing.assert_allclose(sliced.mean, whole.mean, rtol=0, atol=1e-12)
    np.testing.assert_allclose(sliced.cov, whole.cov, rtol=0, atol=1e-12)
    if name not in ("cgpf", "ugpf"):  # their f meets sigma points alone
        assert few == 5 < 64 <= most


@pytest.mark.parametrize("name", ["gpf", "rqmc_gpf"])
def test_too_few_particles_that_count_is_the_kalman_step_and_is_counted(name):
    flt, ckf = make_filter(name, particles=64), make_filter("ckf")
    x, me = (
        Gaussian(np.zeros((2, 3)), np.eye(3)),
        Measurement(np.array([[0.1, 0.0], [9.0, 9.0]]), Linear(np.eye(2, 3)), np.eye(2)),
    )
    b, innovation = flt.correct(flt.init(x, generators((2,))), me)
    expected, expected_innovation = ckf.correct(ckf.init(x), me)
    np.testing.assert_array_equal(b.health.fallbacks, [0, 1])
    np.testing.assert_array_equal(flt.diagnostics(b)["fallbacks"], [0.0, 1.0])
    np.testing.assert_allclose(b.mean[1], expected.mean[1], atol=1e-14)
    assert np.abs(b.mean[0] - expected.mean[0]).max() > 1e-6
    np.testing.assert_allclose(innovation.cov, expected_innovation.cov, atol=1e-14)
    assert flt.diagnostics(b)["ess"][0] > 0.1 > flt.diagnostics(b)["ess"][1] >= 0.0


@pytest.mark.parametrize("name", CLOUDS)
def test_a_cloud_far_from_the_fix_is_moved_as_one(name):
    """The Kalman result of its moments, to rounding; counted."""
    flt, ckf = make_filter(name, particles=64), make_filter("ckf")
    x = Gaussian(np.zeros((2, 3)), np.diag([1.0, 2.0, 3.0]))
    me = Measurement(np.array([[0.1, 0.0], [30.0, -30.0]]), Linear(np.eye(2, 3)), 0.1 * np.eye(2))
    b, _ = flt.correct(flt.init(x, generators((2,))), me)
    expected, _ = ckf.correct(ckf.init(x), me)
    assert b.health.fallbacks[1] == 1
    np.testing.assert_allclose(flt.estimate(b).mean[1], expected.mean[1], atol=1e-11)
    np.testing.assert_allclose(flt.estimate(b).cov[1], expected.cov[1], atol=1e-11)


@pytest.mark.parametrize("n", [3, 12, 15])
@pytest.mark.parametrize("name", [*GAUSSIAN, *CLOUDS])
def test_any_number_of_states(name, n):
    flt = make_filter(name, particles=128)
    b = flt.init(Gaussian(np.zeros((2, n)), np.eye(n)), generators((2,)))
    b, _ = flt.step(b, Transition(swing, 0.01 * np.eye(n)), Measurement(np.ones((2, 2)), look, np.eye(2)))
    assert np.isfinite(flt.estimate(b).cov).all()
    assert (np.linalg.eigvalsh(flt.estimate(b).cov) > 0.0).all()


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("gpf", {"particles": 0}, "particles = 0; allowed: an even whole number >= 2 with matching = 'pairs'"),
        ("gpf", {"particles": 101}, "particles = 101"),
        ("gpf", {"particles": 2.5}, "particles = 2.5"),
        ("gpf", {"matching": "pair"}, "unknown matching 'pair'; did you mean 'pairs'"),
        ("gpf", {"likelihood": "student"}, "unknown likelihood 'student'"),
        ("gpf", {"min_ess": 1.0}, "min_ess = 1.0"),
        ("gpf", {"memory_mb": 0.0}, "memory_mb = 0.0"),
        ("rqmc_gpf", {"points": "sobel"}, "unknown points 'sobel'; did you mean 'sobol'"),
        ("cgpf", {"widen": 0.9}, "widen = 0.9; allowed: a number >= 1"),
        ("ugpf", {"alpha": 0.0}, "alpha = 0.0"),
        ("pf", {"roughening": 1.0}, "roughening = 1.0"),
        ("pf", {"resample": 1.5}, "resample = 1.5"),
        ("pf", {"min_ess": -0.1}, "min_ess = -0.1"),
        ("upf", {"kernel": 0.0}, "kernel = 0.0"),
        ("upf", {"kappa": np.inf}, "kappa = inf"),
    ],
)
def test_values_are_checked(name, settings, message):
    with pytest.raises(ValueError, match=message):
        make_filter(name, **settings)


@pytest.mark.parametrize("name", [*GAUSSIAN, *CLOUDS])
def test_too_few_particles_for_the_states_and_no_randomness_are_refused(name):
    prior = Gaussian(np.zeros(10), np.eye(10))
    with pytest.raises(ValueError, match="particles = 20 for 10 states with matching = 'pairs'; allowed: at least 22"):
        make_filter(name, particles=20).init(prior, np.random.default_rng(0))
    with pytest.raises(ValueError, match="rng = None: a particle filter draws from numpy Generators"):
        make_filter(name).init(prior)
