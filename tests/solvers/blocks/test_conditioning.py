import numpy as np
import pytest
import scipy.stats
from oracles.problems import spd

from solvers.blocks.conditioning import condition, condition_affine, gain, log_likelihood, nis
from solvers.blocks.moments import Affine, linear_moments
from solvers.types import Gaussian, Innovation, Linear, Moments


def problem(batch, n, m, seed=0):
    rng = np.random.default_rng(seed)
    P, H, R = spd(rng, *batch, n), rng.standard_normal((m, n)), spd(rng, m)
    x = Gaussian(rng.standard_normal((*batch, n)), P)
    predicted = Moments(x.mean @ H.T, H @ P @ H.T + R, P @ H.T)
    return x, predicted, H, R, rng.standard_normal((*batch, m))


@pytest.mark.parametrize("batch", [(), (1,), (7,), (2, 3)])
@pytest.mark.parametrize("m", [1, 2, 3, 6])
def test_condition_is_bayes_rule_in_information_form(batch, m):
    x, predicted, H, R, z = problem(batch, 6, m)
    after, innovation, repaired = condition(x, predicted, z)
    assert repaired is None
    for i in np.ndindex(batch):
        information = np.linalg.inv(x.cov[i]) + H.T @ np.linalg.inv(R) @ H
        P = np.linalg.inv(information)
        mean = P @ (np.linalg.inv(x.cov[i]) @ x.mean[i] + H.T @ np.linalg.inv(R) @ z[i])
        np.testing.assert_allclose(after.cov[i], P, atol=1e-11)
        np.testing.assert_allclose(after.mean[i], mean, atol=1e-11)
    np.testing.assert_array_equal(after.cov, after.cov.mT)
    np.testing.assert_allclose(innovation.residual, z - predicted.mean)
    np.testing.assert_array_equal(innovation.cov, predicted.cov)


@pytest.mark.parametrize("known", [False, True])
@pytest.mark.parametrize(("batch", "m"), [((), 2), ((5,), 1), ((2, 3), 3), ((4,), 6)])
def test_an_affine_measurement_has_the_bits_of_its_moments(batch, m, known):
    """In one kernel, with H, offset and R of each run or of all, and with a value that is not that of the map."""
    x, _, H, R, z = problem(batch, 6, m)
    rng = np.random.default_rng(1)
    every = np.broadcast_to(R, (*batch, m, m)).copy(), rng.standard_normal((*batch, m, 6))
    for noise, matrix, offset in ((R, H, None), (every[0], every[1], rng.standard_normal((*batch, m)))):
        h = Affine(Linear(matrix, offset), rng.standard_normal((*batch, m)) if known else None)
        y = linear_moments(h.map, x, None, h.value)
        expected = condition(x, y._replace(cov=y.cov + noise), z)
        after, innovation, repaired = condition_affine(x, h, noise, z)
        assert repaired is expected[2] is None
        for one, other in zip((*after, *innovation), (*expected[0], *expected[1]), strict=True):
            np.testing.assert_array_equal(one, other)


def test_an_affine_measurement_with_a_singular_covariance_is_repaired():
    """Two readings of one sensor in one run; the others keep their bits."""
    x, _, H, R, z = problem((3,), 4, 2)
    H, noise = np.broadcast_to(H, (3, 2, 4)).copy(), np.broadcast_to(R, (3, 2, 2)).copy()
    H[1, 1], noise[1] = H[1, 0], 0.04
    after, innovation, repaired = condition_affine(x, Affine(Linear(H)), noise, z)
    assert repaired.tolist() == [False, True, False]
    assert np.isfinite(after.cov).all()
    for i in (0, 2):
        alone, seen, none = condition_affine(Gaussian(x.mean[i], x.cov[i]), Affine(Linear(H[i])), noise[i], z[i])
        assert none is None
        for one, other in zip((*after, *innovation), (*alone, *seen), strict=True):
            np.testing.assert_array_equal(one[i], other)


def test_gain():
    _, predicted, *_ = problem((4,), 5, 2)
    K, W, _ = gain(predicted)
    np.testing.assert_allclose(K, predicted.cross @ np.linalg.inv(predicted.cov), atol=1e-13)
    np.testing.assert_allclose(W.mT @ W, K @ predicted.cov @ K.mT, atol=1e-13)


@pytest.mark.parametrize("m", [1, 2, 3])
def test_nis_and_log_likelihood(m):
    _, predicted, *_ = problem((3,), 5, m)
    r = np.random.default_rng(9).standard_normal((3, m))
    innovation = Innovation(r, predicted.cov)
    for i in range(3):
        S = predicted.cov[i]
        assert nis(innovation)[i] == pytest.approx(r[i] @ np.linalg.inv(S) @ r[i])
        logpdf = scipy.stats.multivariate_normal(cov=S).logpdf(r[i])
        assert log_likelihood(innovation)[i] == pytest.approx(logpdf)
    assert nis(Innovation(r[0], predicted.cov[0])).shape == ()


@pytest.mark.parametrize("known", [[0], [1], [0, 2], [1, 3]])
def test_what_is_known_exactly_leaves_the_gain_of_the_rest(known):
    """Wherever it stands: a zero row of S before others must not move their pivots."""
    rng = np.random.default_rng(sum(known))
    S, cross = spd(rng, 5), rng.standard_normal((3, 5))
    S[known, :] = S[:, known] = cross[:, known] = 0.0
    rest = [i for i in range(5) if i not in known]
    K, W, repaired = gain(Moments(np.zeros(5), S, cross))
    expected = cross[:, rest] @ np.linalg.inv(S[np.ix_(rest, rest)])
    np.testing.assert_allclose(K[:, rest], expected, atol=1e-12)
    np.testing.assert_array_equal(K[:, known], 0.0)
    np.testing.assert_allclose(W.T @ W, expected @ cross[:, rest].T, atol=1e-12)
    assert repaired


def test_what_is_known_exactly_gets_no_gain():
    """A noiseless measurement of a state without variance: S = 0 for it, and the other states do not care."""
    P = np.diag([0.0, 2.0])
    x = Gaussian(np.array([[1.0, 1.0], [1.0, 1.0]]), np.stack([P, np.eye(2)]))
    predicted = Moments(x.mean, x.cov + np.diag([0.0, 1.0]), x.cov)
    after, innovation, repaired = condition(x, predicted, np.array([[5.0, 4.0], [5.0, 4.0]]))
    np.testing.assert_allclose(nis(innovation), [9 / 3, 16 + 9 / 2])
    np.testing.assert_array_equal(repaired, [True, False])
    np.testing.assert_allclose(after.mean, [[1.0, 3.0], [5.0, 2.5]], atol=1e-9)
    np.testing.assert_allclose(after.cov, [np.diag([0.0, 2 / 3]), np.diag([0.0, 0.5])], atol=1e-9)


def test_a_lost_run_does_not_touch_the_others():
    x, predicted, _, _, z = problem((3,), 4, 2)
    clean, _, _ = condition(x, predicted, z)
    z[1] = np.nan
    predicted.cov[2] = np.nan
    after, _, _ = condition(x, predicted, z)
    np.testing.assert_array_equal(after.mean[0], clean.mean[0])
    np.testing.assert_array_equal(after.cov[:2], clean.cov[:2])
    assert np.isnan(after.mean[1:]).all()
    assert np.isnan(after.cov[2]).all()
