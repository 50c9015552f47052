"""The inflation against the dense forms of the source, and when it exists."""

import numpy as np
import pytest
from oracles.problems import spd

from solvers.filters.hinfinity.inflation import admissible, inflate, largest, reciprocal_deviations


def case(seed, batch=(5,), n=4):
    rng = np.random.default_rng(seed)
    D, weight = spd(rng, *batch, n), rng.uniform(0.2, 2.0, (*batch, n))
    weight[..., 1] = 0.0  # a state outside L
    top = np.array(
        [
            np.linalg.eigvalsh(np.diag(w) @ d @ np.diag(w))[-1]
            for d, w in zip(D.reshape(-1, n, n), weight.reshape(-1, n), strict=True)
        ]
    )
    return D, weight, top.reshape(batch)


@pytest.mark.parametrize("batch", [(), (1,), (2, 3)])
def test_inflation_is_the_inverse_of_the_information_left(batch):
    D, weight, top = case(1, batch)
    for share in (0.0, 0.1, 0.9, 0.999):
        theta = share / top
        P = inflate(D, weight, np.asarray(theta))
        for i in np.ndindex(batch):
            L = np.diag(weight[i])
            np.testing.assert_allclose(
                P[i], np.linalg.inv(np.linalg.inv(D[i]) - theta[i] * L.T @ L), rtol=1e-10, atol=1e-12
            )
        np.testing.assert_array_equal(P, P.mT)
    np.testing.assert_array_equal(inflate(D, weight, np.zeros(batch)), D)
    np.testing.assert_allclose(largest(D, weight), top, rtol=1e-13)


def test_inflation_is_the_source_s_indefinite_form():
    """# 000 (4.3.14-15): P = P- - [Pxy P-] R_e^-1 [Pxy P-]', R_e = [[Pyy, Pxy'], [Pxy, P- - gamma^2 I]], with L = I."""
    rng = np.random.default_rng(2)
    P, H, R = spd(rng, 4), rng.standard_normal((2, 4)), spd(rng, 2)
    Pxy, Pyy, gamma2 = P @ H.T, H @ P @ H.T + R, 30.0
    block = np.block([[Pyy, Pxy.T], [Pxy, P - gamma2 * np.eye(4)]])
    both = np.hstack([Pxy, P])
    D = P - Pxy @ np.linalg.inv(Pyy) @ Pxy.T
    expected = P - both @ np.linalg.inv(block) @ both.T
    np.testing.assert_allclose(inflate(D, np.ones(4), np.asarray(1.0 / gamma2)), expected, atol=1e-13)


def test_gamma_is_raised_just_enough_and_only_where_it_must():
    D, weight, top = case(3)
    cap = 3.0 * top.max()
    theta = np.array([0.0, 0.5, 1.0, 1.5, 0.9]) / top  # fine, fine, does not exist, does not, beyond the cap
    used, lowered = admissible(D, weight, theta, cap)
    must = theta > 1.0 / top - 1.0 / cap
    np.testing.assert_array_equal(lowered, must)
    assert must[2:4].all()
    assert not must[:2].any()
    np.testing.assert_array_equal(used[~must], theta[~must])
    reached = largest(inflate(D, weight, used), weight)
    np.testing.assert_allclose(reached[must], cap, rtol=1e-9)
    assert (reached[~must] <= cap).all()


def test_beyond_the_cap_nothing_is_inflated():
    D, weight, top = case(4, ())
    used, lowered = admissible(D, weight, np.asarray(1e-3), 0.5 * float(top))
    assert used == 0.0
    assert lowered
    used, lowered = admissible(D, weight, np.asarray(0.0), 0.5 * float(top))
    assert lowered is None
    assert used == 0.0


def test_runs_that_are_not_finite_harm_no_other():
    D, weight, top = case(5)
    D[2] = np.nan
    theta = 2.0 / top
    theta[2] = 1.0
    used, lowered = admissible(D, weight, theta, 1e3)
    np.testing.assert_array_equal(lowered, [True, True, False, True, True])
    assert np.isfinite(inflate(D, weight, used)[[0, 1, 3, 4]]).all()
    assert np.isnan(largest(D, weight)[2])


def test_a_state_known_exactly_stays_out_of_L():
    P = np.diag([4.0, 0.0, 0.25])
    np.testing.assert_array_equal(reciprocal_deviations(P), [0.5, 0.0, 2.0])
