"""The 15-state model against the difference of two strapdown runs, and against an ODE solver on
docs/mathematics/error_models.md#navigation-model."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sins_env import attitude, earth
from sins_env.prior import matched_prior
from sins_env.specs import GpsSpec, ImuSpec
from sins_env.types import NavState
from sins_env.units import DEG, DEG_PER_H, UG
from solvers.blocks.moments import tangent
from solvers.pipeline import strapdown as S
from solvers.pipeline.aiding.gps import Fix
from solvers.pipeline.errors.model import ACCEL_UNIT, GYRO_UNIT
from solvers.pipeline.errors.navigation import DP, DV, PHI, STATES, NavigationErrors

MODEL = earth.get("wgs84")
START = np.array([34.2 * DEG, 108.9 * DEG, 380.0])


def increments(epochs, n_sub=10, epoch=0.1):
    """A manoeuvre of accelerations and turns, as increments of a rate and a force that change slowly in the body."""
    t = (np.arange(epochs * n_sub) + 0.5) * epoch / n_sub
    rate = np.stack([0.02 * np.sin(0.2 * t), 0.03 * np.sin(0.13 * t), -0.05 * np.sin(0.07 * t)], axis=-1)
    force = np.stack([0.5 * np.sin(0.11 * t), 1.2 * np.cos(0.05 * t), 9.80 + 0.2 * np.sin(0.3 * t)], axis=-1)
    shape = (epochs, n_sub, 3)
    return (rate * epoch / n_sub).reshape(shape), (force * epoch / n_sub).reshape(shape)


def difference(phi_deg, gyro_deg_h, accel_ug, seconds, speed=40.0):
    """(predicted, actual) errors (9,): phi rad, velocity m/s, position m, of an INS that starts off and has biased sensors."""
    phi, eps, nabla = np.array(phi_deg) * DEG, np.array(gyro_deg_h) * DEG_PER_H, np.array(accel_ug) * UG
    dv, dp = np.array([0.2, -0.1, 0.05]), np.array([10.0, -5.0, 3.0])
    q = attitude.from_euler(0.3, 0.05, -0.02)
    right = NavState(q, np.array([speed * np.sin(0.3), speed * np.cos(0.3), 0.0]), START)
    wrong = NavState(
        attitude.multiply(attitude.misalignment_quaternion(phi), q), right.vel + dv, earth.displace(MODEL, START, dp)
    )
    ins = S.Strapdown(MODEL, 0.1, 10, START, hold_position=False)
    a, b, errors = ins.start(right), ins.start(wrong), NavigationErrors()
    x = np.concatenate([phi, dv, dp, eps / GYRO_UNIT, nabla / ACCEL_UNIT])
    for dtheta, dvel in zip(*increments(round(seconds / 0.1)), strict=True):
        a, _ = ins.advance(a, dtheta, dvel)
        b, motion = ins.advance(b, dtheta + 0.01 * eps, dvel + 0.01 * nabla)
        x = errors.transition(motion, np.zeros((15, 15))).f(x)
    apart = attitude.misalignment(b.nav.q_nb, a.nav.q_nb)
    return x[:9], np.concatenate([apart, b.nav.vel - a.nav.vel, -earth.offset(MODEL, b.nav.pos, a.nav.pos)])


@pytest.mark.parametrize(
    ("phi", "gyro", "accel", "metres"),
    [
        ((3, 3, 10), (1, 1, 1), (1000, 1000, 1000), 0.016),
        ((10, -8, 60), (1, -2, 1.5), (1000, -2000, 500), 0.016),
        ((-1, 1, -170), (1, 1, 1), (100, 100, 100), 0.5),  # the INS is 8 km off: second order in position
    ],
)
def test_predicts_the_difference_of_two_ins(phi, gyro, accel, metres):
    """100 s; a prototype reached 5e-8 deg, 6e-4 m/s and 0.016 m."""
    predicted, actual = difference(phi, gyro, accel, 100.0)
    assert np.abs(attitude.wrap(predicted - actual)[PHI]).max() < 2e-6 * DEG  # measured 1e-6: 0.004 arcsec
    assert np.abs(predicted - actual)[DV].max() < 5e-5  # measured 1.3e-5
    assert np.abs(predicted - actual)[DP].max() < metres  # measured 0.003, 0.003 and 0.2


def test_the_gradient_of_gravity_counts_after_five_minutes():
    """A prototype without the term in latitude: 0.017 m/s and 1.3 m after 300 s."""
    predicted, actual = difference((3, 3, 10), (1, 1, 1), (1000, 1000, 1000), 300.0)
    assert np.abs(predicted - actual)[DV].max() < 1.7e-3
    assert np.abs(predicted - actual)[DP].max() < 1.3  # measured 0.97 E: second order in a position error of kilometres


def an_epoch(seed, batch=()):
    rng = np.random.default_rng(seed)
    C = attitude.to_dcm(attitude.normalize(rng.standard_normal((*batch, 4))))
    vel = 60 * rng.standard_normal((*batch, 3))
    latitude = 0.6 + 0.01 * rng.standard_normal(batch)
    transport = earth.transport_matrix(MODEL, latitude, 400.0)
    force = np.array([0.3, -0.2, 9.8]) + rng.standard_normal((*batch, 3))
    rate_en = np.matmul(transport, vel[..., None])[..., 0]
    place = earth.rate_n(MODEL, latitude), rate_en, transport, earth.gravity_slope(MODEL, latitude)
    return S.EpochMotion(0.1, C, 0.1 * force, vel, *place), latitude


def derivative(x, m, latitude):
    """docs/mathematics/error_models.md#navigation-model in the form of 001, latitude, longitude and height in place
    of metres; v is the true velocity in the terms
    with a position error."""
    phi, dv, eps, nabla = x[PHI], x[DV], x[9:12] * GYRO_UNIT, x[12:] * ACCEL_UNIT
    R_M, R_N = earth.radii(MODEL, latitude)
    R_M, R_N = R_M + 400.0, R_N + 400.0
    c, t = np.cos(latitude), np.tan(latitude)
    dL, dh = x[7] / R_M, x[8]
    v = m.vel - dv
    C = attitude.misalignment_dcm(phi)
    f = m.dvel_n / m.dt
    d_ie = np.array([0.0, -m.rate_ie[2], m.rate_ie[1]]) * dL
    d_en = np.array(
        [
            -dv[1] / R_M + dh * v[1] / R_M**2,
            dv[0] / R_N - dh * v[0] / R_N**2,
            dv[0] * t / R_N + dL * v[0] / c**2 / R_N - dh * v[0] * t / R_N**2,
        ]
    )
    d_g = np.array([0.0, 0.0, 3.086e-6 * dh - 9.78 * 5.279e-3 * np.sin(2 * latitude) * dL])
    w_in = m.rate_ie + m.rate_en
    phi_dot = np.linalg.solve(attitude.misalignment_rate_matrix(phi), w_in - C @ w_in + C @ (d_ie + d_en) - m.C @ eps)
    dv_dot = f - C.T @ (f - m.C @ nabla) - np.cross(2 * m.rate_ie + m.rate_en, dv) - np.cross(2 * d_ie + d_en, v) + d_g
    dL_dot = dv[1] / R_M - dh * v[1] / R_M**2
    dl_dot = dv[0] / c / R_N + dL * v[0] * t / c / R_N - dh * v[0] / c / R_N**2
    scale_dot = np.array(
        [m.vel[2] / R_N - t * m.vel[1] / R_M, m.vel[2] / R_M]
    )  # of metres per radian, as the INS moves
    dp_dot = np.array([dl_dot * R_N * c, dL_dot * R_M, dv[2]]) + np.append(scale_dot * x[6:8], 0.0)
    return np.concatenate([phi_dot, dv_dot, dp_dot, np.zeros(6)])


def errors_of(rng, *batch):
    return rng.standard_normal((*batch, 15)) * np.repeat([0.3, 1.0, 500.0, 1.0, 1.0], 3)


@pytest.mark.parametrize("seed", range(6))
def test_epoch_map_solves_the_differential_equation(seed):
    m, latitude = an_epoch(seed)
    x = errors_of(np.random.default_rng(seed + 100))
    truth = solve_ivp(lambda t, y: derivative(y, m, latitude), (0, m.dt), x, rtol=1e-12, atol=1e-14).y[:, -1]
    step = NavigationErrors().transition(m, np.zeros((15, 15))).f(x)
    moved = np.abs(truth - x)
    np.testing.assert_allclose(step[PHI], truth[PHI], atol=1e-9 * m.dt)
    np.testing.assert_allclose(step[DV], truth[DV], atol=2e-7 * m.dt)
    np.testing.assert_allclose(step[DP], truth[DP], atol=1e-6)
    assert np.abs(step - truth)[:9].max() < 1e-4 * moved[:9].max()
    np.testing.assert_array_equal(step[9:], x[9:])


def test_jacobian_at_zero_is_the_textbook_matrix():
    """The tangent at zero error, term by term: tilt, biases, Coriolis, curvature, gravity."""
    m, latitude = an_epoch(1)
    f = NavigationErrors().transition(m, np.zeros((15, 15))).f
    _, J = tangent(f, np.zeros(15), np.full(15, 1.0))
    A = np.stack(
        [(derivative(h, m, latitude) - derivative(-h, m, latitude)) / 2e-4 for h in 1e-4 * np.eye(15)], axis=-1
    )
    np.testing.assert_allclose(J, np.eye(15) + A * m.dt + A @ A * m.dt**2 / 2, rtol=0, atol=2e-6)
    np.testing.assert_allclose(J[DV, PHI], attitude.skew(m.dvel_n), atol=1e-5)  # dv' = f x phi


@pytest.mark.parametrize("batch", [(), (1,), (7,), (2, 3)])
@pytest.mark.parametrize("position", [True, False])
def test_batches_and_points(batch, position):
    m, _ = an_epoch(3, batch)
    model = NavigationErrors(position)
    n = model.states.size
    f = model.transition(m, np.zeros((n, n))).f
    points = errors_of(np.random.default_rng(9), *batch, 5)[..., STATES.places(model.states)]
    whole = f(points)
    assert whole.shape == points.shape
    for p in range(5):
        np.testing.assert_allclose(f(points[..., p, :]), whole[..., p, :], rtol=1e-14, atol=1e-15)
    for index in np.ndindex(*batch):
        one = S.EpochMotion(m.dt, *(part[index] for part in m[1:]))
        alone = model.transition(one, np.zeros((n, n))).f(points[index])
        np.testing.assert_allclose(alone, whole[index], rtol=1e-14, atol=1e-15)


def test_without_position_it_is_the_same_model():
    """Where there is no position error and the base barely moves, the other twelve states do the same."""
    m, _ = an_epoch(4)
    x = errors_of(np.random.default_rng(1))
    x[DP] = 0.0
    x[DV] = 0.0
    kept = STATES.places(NavigationErrors(position=False).states)
    with_position = NavigationErrors().transition(m, np.zeros((15, 15))).f(x)
    without = NavigationErrors(position=False).transition(m, np.zeros((12, 12))).f(x[kept])
    np.testing.assert_allclose(without, with_position[kept], atol=1e-15)


def test_prior_noise_and_units():
    prior = matched_prior(
        ImuSpec(gyro_bias_deg_h=0.02, accel_bias_ug=100, arw_deg_sqrt_h=0.01, vrw_ug_sqrt_hz=5),
        GpsSpec(),
        0.5,
        (1, 2, 15),
    )
    mean, P = NavigationErrors().prior(prior.P0, (4,))
    assert mean.shape == (4, 15)
    std = np.sqrt(np.diagonal(P[2]))
    np.testing.assert_allclose(std, [DEG, 2 * DEG, 15 * DEG, *[0.2] * 3, *[10.0] * 3, *[0.02] * 3, *[0.1] * 3])
    Q, q = NavigationErrors().noise(prior), (5 * UG) ** 2
    np.testing.assert_allclose(Q[DV, DV], q * 0.5 * np.eye(3))
    np.testing.assert_allclose(Q[DP, DP], q * 0.5**3 / 3 * np.eye(3))
    np.testing.assert_allclose(Q[DV, DP], q * 0.5**2 / 2 * np.eye(3))
    np.testing.assert_array_equal(Q, Q.T)
    np.testing.assert_allclose(np.sqrt(np.diagonal(Q))[PHI], 0.01 / 60 * DEG * np.sqrt(0.5))
    assert not Q[9:].any()


def test_lever_arm_measurement():
    """h(x) is the INS's antenna minus the true one, in velocity and place."""
    rng = np.random.default_rng(2)
    arm, x = rng.standard_normal((2, 3)), errors_of(rng, 5)
    h = Fix(STATES).measurement(np.zeros(6), np.eye(6), arm).h
    for row, value in zip(x, h(x), strict=True):
        true = arm @ attitude.misalignment_dcm(row[PHI])
        np.testing.assert_allclose(value, np.concatenate([row[DV] + arm[0] - true[0], row[DP] + arm[1] - true[1]]))


def test_corrected_takes_the_errors_away():
    rng = np.random.default_rng(5)
    x = errors_of(rng, 4)
    q = attitude.normalize(rng.standard_normal((4, 4)))
    true = NavState(q, rng.standard_normal((4, 3)), np.broadcast_to(START, (4, 3)))
    wrong = NavState(
        attitude.multiply(attitude.misalignment_quaternion(x[:, PHI]), q),
        true.vel + x[:, DV],
        earth.displace(MODEL, true.pos, x[:, DP]),
    )
    right = NavigationErrors().corrected(MODEL, wrong, x)
    assert attitude.rotation_angle(attitude.multiply(right.q_nb, attitude.conjugate(q))).max() < 1e-14
    np.testing.assert_allclose(right.vel, true.vel, atol=1e-14)
    assert np.abs(earth.offset(MODEL, true.pos, right.pos)).max() < 0.1  # second order of a kilometre
