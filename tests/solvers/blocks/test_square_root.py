import numpy as np
import pytest
from oracles.problems import spd

from solvers.blocks.square_root import FLOOR, cholesky, indefinite, semidefinite_root, svd_root, symmetrize, tria

ROOTS = [cholesky, svd_root, semidefinite_root]


@pytest.fixture
def rng():
    return np.random.default_rng(1)


@pytest.mark.parametrize("root", ROOTS)
@pytest.mark.parametrize("batch", [(), (1,), (7,), (2, 3)])
def test_root_squares_to_the_covariance(root, batch, rng):
    P = spd(rng, *batch, 6)
    S, repaired = root(P)
    assert repaired is None
    np.testing.assert_allclose(S @ S.mT, P, rtol=0, atol=1e-13)


@pytest.mark.parametrize("shape", [(4, 4), (3, 4, 9), (2, 3, 5, 5)])
def test_tria_is_lower_with_positive_diagonal(shape, rng):
    M = rng.standard_normal(shape)
    S = tria(M)
    np.testing.assert_allclose(S @ S.mT, M @ M.mT, atol=1e-12)
    assert (np.tril(S) == S).all()
    assert (np.diagonal(S, axis1=-2, axis2=-1) > 0).all()


def test_repair_touches_the_indefinite_items_only(rng):
    P = spd(rng, 2, 4, 5)
    U = np.linalg.qr(rng.standard_normal((5, 5)))[0]
    P[0, 2] = U @ np.diag([1.0, 2.0, 3.0, 4.0, -1e-6]) @ U.T
    P[1, 3, 0, 0] = np.nan
    S, repaired = cholesky(P)
    expected = np.zeros((2, 4), dtype=bool)
    expected[0, 2] = True
    np.testing.assert_array_equal(repaired, expected)
    assert np.isnan(S[1, 3]).any()
    np.testing.assert_allclose(S[0, 2] @ S[0, 2].T, P[0, 2], atol=1e-5)
    assert (S[0, 2] == np.tril(S[0, 2])).all()
    for i in np.ndindex(2, 4):
        if i not in {(0, 2), (1, 3)}:
            np.testing.assert_array_equal(S[i], cholesky(P[i])[0])
            np.testing.assert_allclose(S[i], np.linalg.cholesky(P[i]), atol=1e-14)


def test_repair_does_not_depend_on_units(rng):
    P = np.array([[1.0, 1.1, 0.2], [1.1, 1.0, 0.1], [0.2, 0.1, 2.0]])
    units = np.array([1e-8, 1e5, 1.0])
    S, _ = cholesky(P)
    scaled, repaired = cholesky(units[:, None] * P * units)
    assert repaired
    np.testing.assert_allclose(scaled, units[:, None] * S, rtol=1e-5, atol=1e-5 * units.max() * FLOOR)
    correlation = S @ S.T / np.sqrt(np.outer(np.diag(S @ S.T), np.diag(S @ S.T)))
    assert np.linalg.eigvalsh(correlation)[0] > 0.5 * FLOOR


@pytest.mark.parametrize("dead", [[2], [0, 3], [0, 1, 2, 3]])
def test_zero_variance_is_a_repair_and_stays_zero(dead, rng):
    P = spd(rng, 4)
    P[dead] = 0.0
    P[:, dead] = 0.0
    S, repaired = cholesky(P)
    assert repaired.shape == ()
    assert repaired
    np.testing.assert_allclose(S @ S.T, P, atol=1e-11)
    np.testing.assert_array_equal(S[dead], 0.0)


def test_eigen_root_takes_a_singular_covariance_as_it_is(rng):
    P = np.stack([np.diag([1.0, 0.0, 2.0]), np.ones((3, 3))])
    S, repaired = svd_root(P)
    assert repaired is None
    np.testing.assert_allclose(S @ S.mT, P, atol=1e-14)


def test_eigen_root_reports_indefinite_and_loses_non_finite():
    P = np.stack([np.diag([1.0, -0.1]), np.eye(2), np.diag([np.nan, 1.0]), -np.eye(2)])
    S, repaired = svd_root(P)
    np.testing.assert_array_equal(repaired, [True, False, False, False])
    np.testing.assert_array_equal(np.isfinite(S).all(axis=(-2, -1)), [True, True, False, False])


@pytest.mark.parametrize("bad", [-np.eye(2), np.full((2, 2), np.inf), np.full((2, 2), np.nan)])
def test_nothing_to_save_gives_nan_and_no_repair(bad):
    S, repaired = cholesky(np.stack([bad, np.eye(2)]))
    assert repaired is None
    assert not np.isfinite(S[0]).all()
    np.testing.assert_array_equal(S[1], np.eye(2))


def test_symmetrize():
    P = np.array([[[1.0, 4.0], [2.0, 3.0]]])
    np.testing.assert_array_equal(symmetrize(P), [[[1.0, 3.0], [3.0, 3.0]]])


UNITS = np.array([1e-8, 1e5, 1.0, 1e3])


def test_semidefinite_root_takes_what_is_singular_in_any_unit(rng):
    A = rng.standard_normal((4, 2))
    P = np.stack([spd(rng, 4), A @ A.T, np.diag([1.0, 0.0, 2.0, 0.0]), np.zeros((4, 4)), spd(rng, 4)])
    P[4, 2] = P[4, :, 2] = 0.0
    P = UNITS[:, None] * P * UNITS
    S, repaired = semidefinite_root(P)
    assert repaired is None
    unit = 1.0 / UNITS
    np.testing.assert_allclose(unit[:, None] * (S @ S.mT) * unit, unit[:, None] * P * unit, atol=1e-14)
    np.testing.assert_array_equal(S[0], cholesky(P[0])[0])
    np.testing.assert_allclose(S[0], np.linalg.cholesky(P[0]), rtol=1e-13)
    for i in range(5):
        alone, _ = semidefinite_root(P[i])
        np.testing.assert_allclose(alone @ alone.T, S[i] @ S[i].T, rtol=1e-13, atol=0)


def test_semidefinite_root_of_a_diagonal_is_the_square_root(rng):
    d = rng.random((3, 5)) * [1, 0, 1, 0, 1]
    S, repaired = semidefinite_root(d[..., None] * np.eye(5))
    assert repaired is None
    np.testing.assert_array_equal(S, np.sqrt(d)[..., None] * np.eye(5))


@pytest.mark.parametrize("bad", [np.diag([1.0, -0.1]), np.array([[1.0, 2.0], [2.0, 1.0]])])
def test_semidefinite_root_reports_what_is_indefinite_and_loses_what_is_not_finite(bad):
    S, repaired = semidefinite_root(np.stack([np.eye(2), bad, np.full((2, 2), np.nan), np.zeros((2, 2))]))
    np.testing.assert_array_equal(repaired, [False, True, False, False])
    np.testing.assert_array_equal(np.isfinite(S).all(axis=(-2, -1)), [True, True, False, True])


@pytest.mark.parametrize("batch", [(), (4,), (2, 3)])
def test_indefinite_finds_negative_eigenvalues_beyond_rounding(batch, rng):
    P = spd(rng, *batch, 4)
    assert indefinite(P) is None
    last = (-1,) * len(batch)
    A = rng.standard_normal((4, 2))
    P[last] = UNITS[:, None] * (A @ A.T) * UNITS  # singular, with eigenvalues of either sign by rounding
    assert indefinite(P) is None
    P[last][0, 0] = -1e-20  # the deviation of this state is 1e-8
    expected = np.zeros(batch, dtype=bool)
    expected[last] = True
    np.testing.assert_array_equal(indefinite(P), expected)
    P[last][1, 1] = np.nan
    assert indefinite(P) is None


def test_indefinite_judges_a_difference_by_what_it_came_from():
    whole, difference = np.diag([1.0, 1.0]), np.diag([-1e-15, 0.5])
    assert indefinite(difference)
    assert indefinite(difference, whole) is None
    assert indefinite(np.diag([-1e-9, 0.5]), whole)
