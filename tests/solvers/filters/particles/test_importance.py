"""Particles: densities against scipy, resampling against the textbook's loop, moments against numpy.cov."""

import numpy as np
import pytest
from oracles.problems import spd
from scipy import integrate, stats

from solvers.filters.particles import importance as im
from solvers.types import Gaussian, Linear, NoiseLaw

T, MIX = NoiseLaw(dof=3.0), NoiseLaw(share=0.2, factor=10.0)


def test_log_density_against_scipy():
    rng = np.random.default_rng(0)
    R, v = spd(rng, 3, 2), 3.0 * rng.standard_normal((3, 50, 2))
    for i in range(3):
        normal, wide = (stats.multivariate_normal(cov=c * R[i]) for c in (1.0, 10.0))
        np.testing.assert_allclose(im.log_density(v, R)[i], normal.logpdf(v[i]), rtol=1e-12)
        np.testing.assert_allclose(
            im.log_density(v, R, T)[i], stats.multivariate_t(shape=R[i], df=3.0).logpdf(v[i]), rtol=1e-12
        )
        mixed = np.log(0.8 * normal.pdf(v[i]) + 0.2 * wide.pdf(v[i]))
        np.testing.assert_allclose(im.log_density(v, R, MIX)[i], mixed, rtol=1e-10)
    np.testing.assert_array_equal(im.log_density(v, R[0])[0], im.log_density(v[:1], R[:1])[0])  # one R for all runs


def test_a_direction_known_exactly_does_not_count():
    v = np.array([[1.0, 5.0]])
    assert im.log_density(v, np.diag([4.0, 0.0]))[0] == pytest.approx(
        stats.norm.logpdf(1.0, scale=2.0) - 0.5 * np.log(2 * np.pi)
    )


@pytest.mark.parametrize("residual", [0.3, 2.0, 9.0])
def test_stand_in_is_the_expected_precision(residual):
    """Without a prior: E[1 / s^2] over the scale s^2, given the residual, by quadrature or Bayes' rule."""
    r, R = np.array([residual, -0.5 * residual]), np.diag([1.0, 2.0])
    squared = r @ np.linalg.solve(R, r)

    def joint(lam):  # lam = chi^2(3) / 3 times the density of r given it
        return stats.chi2.pdf(3.0 * lam, 3.0) * lam * np.exp(-0.5 * lam * squared)

    expected = integrate.quad(lambda lam: lam * joint(lam), 0, 30)[0] / integrate.quad(joint, 0, 30)[0]
    np.testing.assert_allclose(im.stand_in(r, np.zeros((2, 2)), R, T), R / expected, rtol=3e-5)
    p = np.array([0.8, 0.2]) * [stats.multivariate_normal(cov=c * R).pdf(r) for c in (1.0, 10.0)]
    expected = (p[0] + p[1] / 10.0) / p.sum()
    np.testing.assert_allclose(im.stand_in(r, np.zeros((2, 2)), R, MIX), R / expected, rtol=1e-12)
    assert im.stand_in(r, np.zeros((2, 2)), R, None) is R


def textbook_systematic(w, u):
    """Arulampalam et al. (2002), algorithm 2."""
    M, c, i, out = len(w), np.cumsum(w), 0, []
    c[-1] = 1.0
    for j in range(M):
        while (j + u) / M >= c[i]:
            i += 1
        out.append(i)
    return out


def test_systematic_is_the_textbook_loop():
    rng = np.random.default_rng(2)
    w = rng.dirichlet(np.full(40, 0.2), size=(2, 5))
    u = rng.random((2, 5))
    got = im.systematic(w, u)
    for i in np.ndindex(2, 5):
        np.testing.assert_array_equal(got[i], textbook_systematic(w[i], u[i]))
        copies = np.bincount(got[i], minlength=40)
        assert (np.abs(copies - 40 * w[i]) < 1.0).all()


def test_systematic_is_unbiased_and_survives_lost_runs():
    w = np.random.default_rng(3).dirichlet(np.ones(10))
    u = (np.arange(2000) + 0.5) / 2000
    copies = np.array([np.bincount(row, minlength=10) for row in im.systematic(np.tile(w, (2000, 1)), u)])
    np.testing.assert_allclose(copies.mean(axis=0), 10 * w, atol=2e-3)
    with np.errstate(invalid="ignore"):
        got = im.systematic(np.stack([w, np.full(10, np.nan)]), np.array([0.5, 0.5]))
    np.testing.assert_array_equal(got[0], im.systematic(w, np.array(0.5)))


@pytest.mark.parametrize("weighted", [False, True])
def test_moments_against_numpy(weighted):
    rng = np.random.default_rng(4)
    x, w = rng.standard_normal((3, 60, 4)), rng.dirichlet(np.ones(60), size=3)
    got = im.cloud_moments(x, w if weighted else None)
    for i in range(3):
        weights = w[i] if weighted else np.full(60, 1 / 60)
        np.testing.assert_allclose(got.mean[i], np.average(x[i], axis=0, weights=weights), atol=1e-14)
        np.testing.assert_allclose(got.cov[i], np.cov(x[i].T, aweights=weights, bias=True), atol=1e-13)
    for h in (Linear(rng.standard_normal((2, 4)), np.ones(2)), lambda x: np.sin(x[..., :2])):
        y = im.through(h, x, 1.0)
        prior, images = im.cloud_images(h, x, y, w)
        whole = [np.cov(np.hstack([x[i], y[i]]).T, aweights=w[i], bias=True) for i in range(3)]
        np.testing.assert_allclose(images.mean, (w[..., None] * y).sum(axis=-2), atol=1e-14)
        np.testing.assert_allclose(images.cross, [c[:4, 4:] for c in whole], atol=1e-13)
        np.testing.assert_allclose(images.cov, [c[4:, 4:] for c in whole], atol=1e-13)
        np.testing.assert_allclose(prior.cov, [c[:4, :4] for c in whole], atol=1e-13)


def test_fit_gives_the_moments_asked_for():
    rng = np.random.default_rng(5)
    x, w = rng.standard_normal((2, 3, 50, 4)), rng.dirichlet(np.ones(50), size=(2, 3))
    target = Gaussian(rng.standard_normal((2, 3, 4)), spd(rng, 2, 3, 4))
    for weights in (None, w):
        moved, repaired = im.fit(x, target, weights)
        got = im.cloud_moments(moved, weights)
        assert repaired is None
        np.testing.assert_allclose(got.mean, target.mean, atol=1e-13)
        np.testing.assert_allclose(got.cov, target.cov, atol=1e-12)
    same, _ = im.fit(x, im.cloud_moments(x, w), w)
    np.testing.assert_allclose(same, x, atol=1e-12)  # the smallest map: none
    singular = Gaussian(np.ones(4), np.diag([1.0, 0.0, 2.0, 0.0]))
    y = x[0, 0] * np.array([1.0, 0.0, 1.0, 0.0])
    moved, _ = im.fit(y, singular)
    np.testing.assert_allclose(im.cloud_moments(moved).cov, singular.cov, atol=1e-12)


def test_slices_bound_what_the_model_sees_and_change_nothing():
    seen = []

    def g(x):
        seen.append(x.shape)
        return np.sin(x[..., :2]) + x[..., 2:4] ** 2

    x = np.random.default_rng(6).standard_normal((3, 101, 5))
    whole = g(x)
    seen.clear()
    limit = 10 * im.TEMPORARIES * 3 * 5 * 8 / 1e6
    np.testing.assert_array_equal(im.through(g, x, limit), whole)
    assert seen[0] == (3, 10, 5)
    assert len(seen) == 11
    seen.clear()
    im.through(g, x, 1e-9)
    assert len(seen) == 101  # never less than one particle


@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
def test_linear_functions_need_no_slices(batch):
    rng = np.random.default_rng(7)
    g = Linear(rng.standard_normal((*batch, 2, 4)), rng.standard_normal((*batch, 2)))
    x = rng.standard_normal((*batch, 9, 4))
    got = im.through(g, x, 1e-9)
    for i in np.ndindex(*batch, 9):
        b = i[:-1]
        np.testing.assert_allclose(got[i], g.matrix[b] @ x[i] + g.offset[b], atol=1e-14)


def test_bandwidth():
    assert im.bandwidth(1000, 1) == pytest.approx(1.0592 * 1000**-0.2, rel=1e-4)  # Silverman's rule of thumb
    assert im.bandwidth(2000, 10) == pytest.approx(0.537, abs=1e-3)
