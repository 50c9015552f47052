"""The adaptive-noise block against closed forms and Monte Carlo."""

import numpy as np
import pytest
from oracles.problems import spd
from scipy import stats

from solvers.blocks import noise
from solvers.types import Gaussian, Innovation


@pytest.mark.parametrize("b", [0.9, 0.98, 1.0])
@pytest.mark.parametrize("k0", [0, 7])
def test_fading_memory_is_the_normalised_exponential_mean(b, k0):
    """theta = sum b^(k - j) Lambda_j / sum b^(k - j), the told value standing for the first k0."""
    rng = np.random.default_rng(0)
    told, new = rng.standard_normal(3), rng.standard_normal((60, 3))
    theta = told
    for i, value in enumerate(new):
        theta = theta + noise.memory_weight(k0 + i + 1, b) * (value - theta)
        past = np.vstack([np.tile(told, (k0, 1)), new[: i + 1]])
        weights = b ** np.arange(len(past))[::-1]
        np.testing.assert_allclose(theta, weights @ past / weights.sum(), rtol=0, atol=1e-12)


@pytest.mark.parametrize("b", [0.9, 0.98, 1.0])
def test_limited_memory_is_the_recursion_of_the_paper(b):
    """# 002 (75-81): theta = b theta + d_m Lambda_k - d_m b^m Lambda_(k - m), fading before."""
    m = 9
    new = np.random.default_rng(1).standard_normal((60, 3))
    ring = np.zeros((m, 3))
    d_m = 1 / m if b == 1.0 else (1 - b) / (1 - b**m)
    for k, value in enumerate(new, start=1):
        if k <= m:
            d = 1 / k if b == 1.0 else (1 - b) / (1 - b**k)
            theta = value if k == 1 else (1 - d) * theta + d * value  # noqa: F821  set when k is 1
        else:
            theta = b * theta + d_m * value - d_m * b**m * new[k - m - 1]
        ring[k % m] = value
        np.testing.assert_allclose(noise.window_weights(k, m, b) @ ring, theta, rtol=0, atol=1e-12)


def test_damped_statistics_are_unbiased_positive_and_far_less_scattered():
    """Corrections drawn from their own covariance leave the noise as it is on average; 4 standard errors."""
    rng = np.random.default_rng(2)
    runs = 40_000
    now = Gaussian(np.zeros(3), np.diag([1.0, 0.04, 0.0]))
    spent = 9.0 * spd(rng, 3)
    step = rng.standard_normal((runs, 3)) @ np.linalg.cholesky(spent).T
    one = np.ones(runs)
    moved = Gaussian(step, np.broadcast_to(spent, (runs, 3, 3)))
    plain, damped = (noise.statistic(now, moved, one, damp) for damp in (False, True))
    for found in (plain, damped):
        error = found.cov.std(axis=0) / np.sqrt(runs)
        assert (np.abs(found.cov.mean(axis=0) - now.cov) <= 4 * error + 1e-15).all()
        assert (np.abs(found.mean.mean(axis=0)) <= 4 * found.mean.std(axis=0) / np.sqrt(runs) + 1e-15).all()
    assert noise.variances(damped.cov).min() >= -1e-15
    assert noise.variances(plain.cov).min() < 0.0
    spread = noise.variances(damped.cov).std(axis=0)
    np.testing.assert_allclose(spread, np.sqrt(2.0) * np.diag(now.cov), rtol=0.03)
    np.testing.assert_allclose(noise.variances(plain.cov).std(axis=0), np.sqrt(2.0) * np.diag(spent), rtol=0.03)


def test_damping_leaves_alone_what_is_no_larger_than_the_noise():
    now = Gaussian(np.zeros(2), np.diag([4.0, 9.0]))
    moved = Gaussian(np.array([1.0, -2.0]), np.diag([3.9, 8.9]))
    for a, c in zip(
        noise.statistic(now, moved, np.ones(()), True), noise.statistic(now, moved, np.ones(()), False), strict=True
    ):
        np.testing.assert_array_equal(a, c)


def test_a_fix_after_several_epochs_speaks_of_their_sum():
    """With F = I, N epochs of Q add up to N Q: the statistic divides by N."""
    now = Gaussian(np.array([0.1]), np.array([[2.0]]))
    moved = Gaussian(np.array([3.0]), np.array([[5.0]]))
    found = noise.statistic(now, moved, np.array(4.0), False)
    np.testing.assert_allclose(found.mean, [0.1 + 3.0 / 4])
    np.testing.assert_allclose(found.cov, [[2.0 + (9.0 - 5.0) / 4]])
    np.testing.assert_allclose(noise.least(moved, np.array(4.0)), [[9.0 / 4]])
    moved = moved._replace(cov=np.array([[10.0]]))  # damped: of a variance of 10, four draws of 2 can be the cause of 8
    found = noise.statistic(now, moved, np.array(4.0), True)
    np.testing.assert_allclose(found.mean, [0.1 + np.sqrt(0.8) * 3.0 / 4])
    np.testing.assert_allclose(found.cov, [[2.0 + 0.8 * (9.0 - 10.0) / 4]])


def test_the_gate_shortens_to_its_edge():
    rng = np.random.default_rng(3)
    S = spd(rng, 5, 2)
    residual = rng.standard_normal((5, 2)) * np.array([0.1, 1.0, 3.0, 10.0, 100.0])[:, None]
    counts, beyond = noise.gated(Innovation(residual, S), 0.999)
    size = np.array([r @ np.linalg.solve(s, r) for r, s in zip(residual, S, strict=True)])
    limit = stats.chi2.ppf(0.999, 2)
    np.testing.assert_array_equal(beyond, size > limit)
    assert 0 < beyond.sum() < 5
    np.testing.assert_array_equal(counts[~beyond], 1.0)
    np.testing.assert_allclose((counts**2 * size)[beyond], limit, rtol=1e-12)
    counts, beyond = noise.gated(Innovation(residual, S), 1.0)
    assert not beyond.any()
    np.testing.assert_array_equal(counts, 1.0)


def test_bounds_are_relative_to_what_was_told_and_zero_stays_zero():
    told = np.array([[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    found = np.diag([1e9, -3.0, 5.0])
    low, high = 1e-2, 1e2
    got = noise.bound(found, told, low, high, "diagonal")
    np.testing.assert_allclose(got, [[400.0, 1.0, 0.0], [1.0, 0.01, 0.0], [0.0, 0.0, 0.0]])  # correlation 0.5 kept
    got = noise.bound(found, told, low, high, "full")
    np.testing.assert_allclose(got, np.diag([400.0, 0.01, 0.0]), atol=1e-12)
    np.testing.assert_array_equal(noise.bound(found, told, low, high, "none"), found)
    np.testing.assert_allclose(noise.bound_mean(np.array([99.0, -0.5, 3.0]), told, 4.0), [4.0, -0.5, 0.0])


def test_a_full_projection_clips_the_eigenvalues_in_told_units():
    rng = np.random.default_rng(4)
    told = np.diag([4.0, 0.25, 9.0])
    sd = np.sqrt(np.diag(told))
    U = np.linalg.qr(rng.standard_normal((3, 3)))[0]
    found = np.outer(sd, sd) * (U @ np.diag([-2.0, 0.5, 700.0]) @ U.T)
    expected = np.outer(sd, sd) * (U @ np.diag([0.1, 0.5, 10.0]) @ U.T)
    np.testing.assert_allclose(noise.bound(found, told, 0.1, 10.0, "full"), expected, atol=1e-12)
    batch = np.stack([found, np.full((3, 3), np.nan)])
    got = noise.bound(batch, told, 0.1, 10.0, "full")
    np.testing.assert_allclose(got[0], expected, atol=1e-12)
    assert np.isnan(got[1]).all()


def test_low_variances_take_the_biased_statistic():
    cov = np.array([[-1.0, 0.3, 0.2], [0.3, 2.0, 0.1], [0.2, 0.1, 0.0]])
    biased = np.full((3, 3), 7.0)
    got = noise.replace_low(cov, biased, np.array([0.1, 0.1, 0.0]))
    np.testing.assert_array_equal(got, [[7.0, 7.0, 7.0], [7.0, 2.0, 0.1], [7.0, 0.1, 0.0]])
