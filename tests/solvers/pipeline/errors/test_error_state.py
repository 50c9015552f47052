"""The error model against the difference of two strapdown runs, and against an ODE solver on
docs/mathematics/error_models.md#alignment-model."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from sins_env import attitude, earth
from sins_env.prior import matched_prior
from sins_env.specs import GpsSpec, ImuSpec
from sins_env.trajectory import Sway
from sins_env.types import NavState, Site
from sins_env.units import ARCSEC, DEG, DEG_PER_H, UG
from solvers.pipeline import strapdown as S
from solvers.pipeline.aiding.gps import Fix
from solvers.pipeline.errors.alignment import STATES, AlignmentErrors, first_order
from solvers.pipeline.errors.model import ACCEL_UNIT, GYRO_UNIT

SITE = Site(39.96 * DEG, 116.3 * DEG)
MODEL = earth.get("wgs84")


def difference(phi_deg, gyro_deg_h=(0, 0, 0), accel_ug=(0, 0), duration=60, exact=True):
    """(predicted, actual) phi (3,) and dV (2,) after two INS runs, one of which starts off and has biased sensors.

    The ten states leave out the error of the vertical velocity, which the aligner slaves to the fixes; here it is held so
    that it vanishes in mid-epoch.
    """
    trajectory = Sway(SITE, 0.1, 30)
    truth = NavState(*(part[0] for part in trajectory.reset([np.random.default_rng(1)])))
    phi, dvel = np.array(phi_deg) * DEG, np.array([0.2, -0.1, 0.0])
    eps, nabla = np.array(gyro_deg_h) * DEG_PER_H, np.array([*accel_ug, 0.0]) * UG
    mechanisation = S.Strapdown(MODEL, 0.1, 30, SITE.pos, hold_position=True)
    right = mechanisation.start(NavState(truth.q_nb, truth.vel, SITE.pos))
    turned = attitude.multiply(attitude.misalignment_quaternion(phi), truth.q_nb)
    wrong = mechanisation.start(NavState(turned, truth.vel + dvel, SITE.pos))
    x = np.concatenate([dvel[:2], phi, nabla[:2] / ACCEL_UNIT, eps / GYRO_UNIT])
    errors, drift, dt = AlignmentErrors(exact), 0.0, 0.1 / 30
    for first in range(0, round(duration / 0.1), 50):
        motion = trajectory.chunk(first, 50)
        for dtheta, dv in zip(motion.dtheta[0], motion.dvel[0], strict=True):
            vel = np.array([*wrong.nav.vel[:2], right.nav.vel[2] - 0.5 * drift])
            start, before = wrong._replace(nav=wrong.nav._replace(vel=vel)), right.nav.vel[2]
            right, _ = mechanisation.advance(right, dtheta, dv)
            wrong, epoch = mechanisation.advance(start, dtheta + eps * dt, dv + nabla * dt)
            drift = (wrong.nav.vel[2] - vel[2]) - (right.nav.vel[2] - before)
            x = errors.transition(epoch, np.zeros((10, 10))).f(x)
    return x, attitude.misalignment(wrong.nav.q_nb, right.nav.q_nb), (wrong.nav.vel - right.nav.vel)[:2]


CASES = [
    ((10, -8, 60), (0, 0, 0), (0, 0)),
    ((10, -8, 60), (1, -2, 1.5), (1000, -2000)),
    ((3, 3, 10), (1, -2, 1.5), (1000, -2000)),
    ((-1, 1, -170), (1, 1, 1), (100, 100)),
]


@pytest.mark.parametrize(("phi", "gyro", "accel"), CASES)
def test_predicts_the_difference_of_two_ins(phi, gyro, accel):
    x, actual_phi, actual_dv = difference(phi, gyro, accel)
    left = attitude.wrap(x[2:5] - actual_phi)
    assert np.abs(left).max() < 0.02 * ARCSEC  # measured 0.003; docs/mathematics/error_models.md#verification
    assert np.abs(x[:2] - actual_dv).max() < 1e-5


def test_first_order_model_does_not():
    x, actual_phi, actual_dv = difference((10, -8, 60), exact=False)
    assert np.abs(x[2:5] - actual_phi).max() > 10 * ARCSEC
    assert np.abs(x[:2] - actual_dv).max() > 0.1


def test_first_order_matrix_agrees_to_second_order():
    rng = np.random.default_rng(0)
    for tilt in (1e-2, 1e-3):
        phi = np.array([*(tilt * rng.standard_normal(2)), 2.0])
        exact = attitude.misalignment_dcm(phi)
        approximate = np.reshape(first_order(phi, np.sin(phi), np.cos(phi)), (3, 3))
        assert np.abs(approximate - exact).max() < 4 * tilt**2


def an_epoch(seed, batch=()):
    rng = np.random.default_rng(seed)

    def draw(*shape):
        return rng.standard_normal((*batch, *shape))

    C = attitude.to_dcm(attitude.normalize(draw(4)))
    vel = 20 * draw(3)
    transport = earth.transport_matrix(MODEL, SITE.latitude)
    force = np.array([0.3, -0.2, 9.8]) + 0.1 * draw(3)
    rate_en = np.matmul(transport, vel[..., None])[..., 0]
    slope = earth.gravity_slope(MODEL, SITE.latitude)
    return S.EpochMotion(0.1, C, 0.1 * force, vel, earth.rate_n(MODEL, SITE.latitude), rate_en, transport, slope)


def derivative(x, m, body):
    """docs/mathematics/error_models.md#alignment-model, exact form, written out with matrices and np.cross."""
    dv, phi = np.array([x[0], x[1], 0.0]), x[2:5]
    nabla, eps = np.array([x[5], x[6], 0.0]) * ACCEL_UNIT, x[7:10] * GYRO_UNIT
    C_b = m.C if body else np.eye(3)
    C = attitude.misalignment_dcm(phi)
    f = m.dvel_n / m.dt
    d_en = m.transport @ dv
    w_in = m.rate_ie + m.rate_en
    phi_dot = np.linalg.solve(attitude.misalignment_rate_matrix(phi), w_in - C @ w_in + C @ d_en - C_b @ eps)
    dv_dot = f - C.T @ (f - C_b @ nabla) - np.cross(2 * m.rate_ie + m.rate_en, dv) - np.cross(d_en, m.vel - dv)
    return np.concatenate([dv_dot[:2], phi_dot, np.zeros(5)])


@pytest.mark.parametrize("body", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_epoch_map_solves_the_differential_equation(seed, body):
    """Against an adaptive integrator: the error of one epoch is of second order and below 1e-3 of any posterior sigma."""
    m = an_epoch(seed)
    x = np.random.default_rng(seed + 100).standard_normal(10) * [1, 1, 0.2, 0.2, 1, 1, 1, 1, 1, 1]
    truth = solve_ivp(lambda t, y: derivative(y, m, body), (0, m.dt), x, rtol=1e-12, atol=1e-14).y[:, -1]
    step = AlignmentErrors(body_biases=body).transition(m, np.zeros((10, 10))).f(x)
    np.testing.assert_allclose(step[:2], truth[:2], atol=2e-9)
    np.testing.assert_allclose(step[2:5], truth[2:5], atol=2e-11)
    np.testing.assert_array_equal(step[5:], x[5:])


@pytest.mark.parametrize("batch", [(), (1,), (7,), (2, 3)])
def test_batches_and_points(batch):
    m = an_epoch(3, batch)
    f = AlignmentErrors().transition(m, np.zeros((10, 10))).f
    rng = np.random.default_rng(9)
    points = rng.standard_normal((*batch, 5, 10))
    whole = f(points)
    assert whole.shape == points.shape
    for p in range(5):
        np.testing.assert_allclose(f(points[..., p, :]), whole[..., p, :], rtol=1e-14, atol=1e-15)
    for index in np.ndindex(*batch):
        one = m._replace(C=m.C[index], dvel_n=m.dvel_n[index], vel=m.vel[index], rate_en=m.rate_en[index])
        alone = AlignmentErrors().transition(one, np.zeros((10, 10))).f(points[index])
        np.testing.assert_allclose(alone, whole[index], rtol=1e-14, atol=1e-15)


def test_prior_is_selected_and_scaled():
    prior = matched_prior(
        ImuSpec(gyro_bias_deg_h=0.02, accel_bias_ug=100, arw_deg_sqrt_h=0.01, vrw_ug_sqrt_hz=5),
        GpsSpec(),
        0.1,
        (1, 2, 15),
    )
    mean, P = AlignmentErrors().prior(prior.P0, (4,))
    assert mean.shape == (4, 10)
    std = np.sqrt(np.diagonal(P[2]))
    np.testing.assert_allclose(std, [0.2, 0.2, DEG, 2 * DEG, 15 * DEG, 0.1, 0.1, 0.02, 0.02, 0.02])
    Q = np.sqrt(np.diagonal(AlignmentErrors().noise(prior)))
    np.testing.assert_allclose(Q[:2], 5 * UG * np.sqrt(0.1))
    np.testing.assert_allclose(Q[2:5], 0.01 / 60 * DEG * np.sqrt(0.1))
    assert not Q[5:].any()


def test_lever_arm_measurement():
    """h(x) is the INS's antenna velocity minus the true one."""
    rng = np.random.default_rng(2)
    a, x = rng.standard_normal(3), 0.3 * rng.standard_normal((5, 10))
    h = Fix(STATES).measurement(np.zeros(2), np.eye(2), a[None]).h
    for row, value in zip(x, h(x), strict=True):
        true_arm = attitude.misalignment_dcm(row[2:5]).T @ a
        np.testing.assert_allclose(value, (row[:2] + a[:2] - true_arm[:2]), atol=1e-15)
