"""Feedback: the corrected attitude, its covariance and the Jacobian of the reset, by finite differences."""

import numpy as np

from sins_env import attitude
from solvers.pipeline import feedback

RNG = np.random.default_rng(4)
PHI = 0.4 * RNG.standard_normal((6, 3))
HAT = PHI + 0.05 * RNG.standard_normal((6, 3))


def test_correction_by_the_true_misalignment_is_exact():
    q = attitude.normalize(RNG.standard_normal((6, 4)))
    computed = attitude.multiply(attitude.misalignment_quaternion(PHI), q)
    left = attitude.multiply(feedback.corrected(computed, PHI), attitude.conjugate(q))
    assert attitude.rotation_angle(left).max() < 1e-14


def test_what_remains_is_the_error_of_the_corrected_attitude():
    q = attitude.normalize(RNG.standard_normal((6, 4)))
    computed = attitude.multiply(attitude.misalignment_quaternion(PHI), q)
    np.testing.assert_allclose(
        attitude.misalignment(feedback.corrected(computed, HAT), q), feedback.remaining(PHI, HAT), atol=1e-14
    )


def test_jacobian_against_differences():
    J = feedback.reset_jacobian(PHI, HAT)
    for i in range(3):
        step = np.zeros(3)
        step[i] = 1e-6
        column = (feedback.remaining(PHI + step, HAT) - feedback.remaining(PHI - step, HAT)) / 2e-6
        np.testing.assert_allclose(J[..., i], column, atol=1e-9)


def test_covariance_of_the_correction_by_sampling():
    """200,000 draws about phi: the covariance of what remains after the correction by phi."""
    phi, P = np.array([0.02, -0.03, 0.6]), np.diag([1e-4, 2e-4, 9e-4]) + 5e-5
    draws = np.random.default_rng(1).multivariate_normal(phi, P, 200_000)
    sampled = np.cov(feedback.remaining(draws, phi).T)
    np.testing.assert_allclose(feedback.corrected_covariance(phi, P), sampled, atol=4 * 9e-4 * np.sqrt(2 / 200_000))


def test_reset_maps_move_velocity_and_attitude_only():
    x_hat = np.concatenate([RNG.standard_normal((6, 2)), HAT, RNG.standard_normal((6, 5))], axis=-1)
    g, jacobian = feedback.reset_maps(x_hat, slice(2, 5), slice(0, 2))
    moved = g(x_hat)
    np.testing.assert_allclose(moved[:, :5], 0, atol=1e-14)
    np.testing.assert_array_equal(moved[:, 5:], x_hat[:, 5:])
    points = x_hat[:, None] + 0.01 * RNG.standard_normal((6, 4, 10))
    np.testing.assert_allclose(g(points)[:, 2], feedback_of_one(points[:, 2], x_hat), atol=1e-14)
    J = jacobian(x_hat)
    np.testing.assert_array_equal(J[:, :2, :2], np.tile(np.eye(2), (6, 1, 1)))
    np.testing.assert_allclose(J[:, 2:5, 2:5], feedback.reset_jacobian(HAT, HAT))
    assert jacobian(points).shape == (6, 4, 10, 10)


def feedback_of_one(x, x_hat):
    return np.concatenate([x[:, :2] - x_hat[:, :2], feedback.remaining(x[:, 2:5], x_hat[:, 2:5]), x[:, 5:]], axis=-1)
