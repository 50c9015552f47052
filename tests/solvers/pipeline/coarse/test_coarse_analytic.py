"""Analytic coarse alignment: exact on exact data, and with the first-order errors of
docs/mathematics/coarse_alignment.md#analytic-methods on others."""

import gymnasium
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

import sins_env  # noqa: F401
import solvers
from sins_env import attitude
from solvers.pipeline.coarse.analytic import from_means
from solvers.pipeline.coarse.fits import by_svd

G, RATE = 9.8, 7.292115e-5
FORMS = pytest.mark.parametrize("form", [1, 2, 3])
LATITUDE = np.radians(45.78)  # of the thesis
DEG_H = np.radians(1.0) / 3600.0


def known(latitude):
    """f_n and omega_ie in n of a base at rest."""
    return np.array([0.0, 0.0, G]), RATE * np.array([0.0, np.cos(latitude), np.sin(latitude)])


def attitudes(shape):
    return Rotation.random(int(np.prod(shape)), rng=np.random.default_rng(4)).as_matrix().reshape(*shape, 3, 3)


def disturbed(form, accel_n, gyro_n, latitude=LATITUDE):
    """C_hat C' (3, 3) for errors (3,) of force and rate given in n: the same for every attitude, so one is enough."""
    C = attitudes((1,))[0]
    force_n, rate_n = known(latitude)
    return from_means(form, C.T @ (force_n + accel_n), C.T @ (rate_n + gyro_n), force_n, rate_n) @ C.T


def first_order(form, accel_n, gyro_n, latitude=LATITUDE):
    """C_hat C' - I by hand, rows E, N, U: R_n D = dR of the rows of R, expanded to first order. Form 3: the turn of form 2."""
    (a_E, a_N, a_U), (w_E, w_N, w_U) = accel_n / G, gyro_n / (RATE * np.cos(latitude))
    t = np.tan(latitude)
    east = np.array([w_N - t * a_N + a_U, -w_E + t * a_E, -a_E])
    if form == 1:
        return np.array([east, [w_E - t * a_E, w_N - t * a_N, w_U - t * a_U], [a_E, a_N, a_U]])
    D = np.array([east, [-east[1], east[0] + a_U, -a_N], [a_E, a_N, a_U]])
    return D if form == 2 else 0.5 * (D - D.T)


@FORMS
@pytest.mark.parametrize("latitude", [0.0, 45.78, -60.0, 89.9])
def test_exact_on_exact_data(form, latitude):
    C, (force_n, rate_n) = attitudes((2, 50)), known(np.radians(latitude))
    found = from_means(form, force_n @ C, rate_n @ C, force_n, rate_n)
    assert_allclose(found, C, atol=1e-10 if abs(latitude) < 80 else 1e-7)


@FORMS
@pytest.mark.parametrize("seed", range(3))
def test_first_order_errors(form, seed):
    rng = np.random.default_rng(seed)
    accel, gyro = 1e-5 * G * rng.standard_normal(3), 1e-4 * RATE * rng.standard_normal(3)
    found, expected = disturbed(form, accel, gyro) - np.eye(3), first_order(form, accel, gyro)
    assert_allclose(found, expected, atol=1e-6)  # second order: the errors are up to 4e-4
    phi = attitude.misalignment_from_dcm(by_svd(found + np.eye(3)))
    tilt = 0.5 * (expected - expected.T)
    assert_allclose(phi, [tilt[1, 2], tilt[2, 0], tilt[0, 1]], atol=1e-6)


@FORMS
def test_azimuth_and_level_errors(form):
    """All forms: phi_U = -eps_E / (omega_ie cos L) + tan L nabla_E / g. Only form 1 takes gyro error into level."""
    accel, gyro = 1e-5 * G * np.array([1.0, -2.0, 0.5]), 0.001 * DEG_H * np.array([5.0, 3.0, -4.0])
    phi = attitude.misalignment_from_dcm(by_svd(disturbed(form, accel, gyro)))
    level = RATE * np.cos(LATITUDE)
    assert phi[2] == pytest.approx(-gyro[0] / level + np.tan(LATITUDE) * accel[0] / G, abs=1e-6)
    assert phi[1] == pytest.approx(accel[0] / G, abs=1e-7)
    up = 0.5 * (gyro[2] / level - np.tan(LATITUDE) * accel[2] / G + accel[1] / G) if form == 1 else 0.0
    assert phi[0] == pytest.approx(-accel[1] / G + up, abs=1e-6)


@pytest.mark.parametrize(("form", "expected"), [(1, 9e-3), (2, 2e-3), (3, 0.0)])
def test_how_far_from_a_rotation(form, expected):
    """docs/mathematics/coarse_alignment.md#analytic-methods, for 0.1 deg/h east and up and -1 mg north at 45.78 deg:
    largest element of C'C - I
    (8.6e-3 and 2.2e-3)."""
    C = disturbed(form, np.array([0.0, -1e-3 * G, 0.0]), 0.1 * DEG_H * np.array([1.0, 0.0, 1.0]))
    assert np.abs(C.T @ C - np.eye(3)).max() == pytest.approx(expected, rel=0.1, abs=1e-14)
    assert_allclose(by_svd(C) @ by_svd(C).T, np.eye(3), atol=1e-14)


def test_spread_of_the_azimuth_from_white_gyro_noise():
    """N / (sqrt(T) omega_ie cos L): 0.19 deg for 0.005 deg/sqrt(h) and 60 s. 400 runs have a standard error of 3.5 %."""
    settings = {
        "imu": {"arw_deg_sqrt_h": 0.005},
        "gps": "perfect",
        "start": "unknown",
        "coarse": 59.9,
        "duration": 60.0,
    }
    env = gymnasium.make_vec("SINS/AlignStatic-v0", num_envs=400, n_sub=1, **settings)
    obs, _ = env.reset(seed=8)
    solver = solvers.make("coarse_analytic3")
    solver.reset(env.unwrapped.task, None, 400)
    over = [False]
    while not over[0]:
        obs, _, _, over, info = env.step(solver.step(obs))
    expected = 0.005 / np.sqrt(60 / 3600) * DEG_H / (RATE * np.cos(env.unwrapped.task.site.latitude))
    assert info["errors"]["phi"][:, 2].std(ddof=1) == pytest.approx(expected, rel=0.12)


@FORMS
def test_a_swaying_base_is_not_at_rest(form):
    """The limit of the method: the mean of 60 s of sway is neither the attitude at their end nor the earth's rate."""
    env = gymnasium.make_vec("SINS/AlignSway-v0", num_envs=20, start="unknown", coarse=60.0, duration=60.1)
    obs, _ = env.reset(seed=3)
    solver = solvers.make(f"coarse_analytic{form}")
    solver.reset(env.unwrapped.task, None, 20)
    for _ in range(600):
        obs, _, _, _, info = env.step(solver.step(obs))
    assert np.sqrt(np.mean(np.degrees(info["errors"]["phi"][:, 2]) ** 2)) > 5.0
