import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from sins_env import attitude

RNG = np.random.default_rng(3)
BATCHES = [(), (1,), (7,), (2, 3)]


def random_q(shape, seed=0):
    q = np.random.default_rng(seed).standard_normal((*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def scipy(q):
    return Rotation.from_quat(q.reshape(-1, 4), scalar_first=True)


def same_rotation(q, p, atol=1e-14):
    assert_allclose(np.abs(np.sum(q * p, axis=-1)), 1.0, atol=atol)


@pytest.mark.parametrize("batch", BATCHES)
def test_products_and_matrices_against_scipy(batch):
    q, p = random_q(batch, 1), random_q(batch, 2)
    same_rotation(attitude.multiply(q, p).reshape(-1, 4), (scipy(q) * scipy(p)).as_quat(scalar_first=True))
    assert_allclose(attitude.to_dcm(q).reshape(-1, 3, 3), scipy(q).as_matrix(), atol=1e-15)
    assert_allclose(attitude.left_matrix(q) @ p[..., None], attitude.multiply(q, p)[..., None])
    assert_allclose(attitude.right_matrix(p) @ q[..., None], attitude.multiply(q, p)[..., None])
    assert attitude.multiply(q, p).shape == (*batch, 4)


def test_hamilton_not_the_other_convention():
    i, j, k = np.eye(4)[1:]
    assert_allclose(attitude.multiply(i, j), k)


@pytest.mark.parametrize("batch", BATCHES)
def test_dcm_round_trip(batch):
    q = random_q(batch, 4)
    back = attitude.from_dcm(attitude.to_dcm(q))
    assert_allclose(back, np.where(q[..., :1] < 0, -q, q), atol=1e-14)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("angle", [np.pi, np.pi - 1e-9, np.pi / 2, 1e-9, 0.0])
def test_from_dcm_where_a_naive_formula_divides_by_zero(axis, angle):
    rotvec = angle * np.eye(3)[axis]
    q = attitude.from_dcm(Rotation.from_rotvec(rotvec).as_matrix())
    same_rotation(q, attitude.from_rotvec(rotvec))


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-8, 1e-4, 1.0, 3.0, 7.0])
def test_from_rotvec_against_scipy(size):
    rotvec = size * np.array([0.36, -0.48, 0.8])
    same_rotation(attitude.from_rotvec(rotvec), Rotation.from_rotvec(rotvec).as_quat(scalar_first=True))
    assert_allclose(attitude.from_rotvec(rotvec)[1:], np.sin(size / 2) * np.array([0.36, -0.48, 0.8]), rtol=1e-14)


def test_nose_points_east_at_heading_90():
    C = attitude.to_dcm(attitude.from_euler(np.pi / 2, 0.0, 0.0))
    assert_allclose(C @ [0.0, 1.0, 0.0], [1.0, 0.0, 0.0], atol=1e-15)  # forward is East
    up = attitude.to_dcm(attitude.from_euler(0.0, 0.1, 0.0)) @ [0.0, 1.0, 0.0]
    assert up[2] > 0  # pitch: nose up
    right = attitude.to_dcm(attitude.from_euler(0.0, 0.0, 0.1)) @ [1.0, 0.0, 0.0]
    assert right[2] < 0  # roll: right side down


@pytest.mark.parametrize("batch", BATCHES)
def test_euler_against_the_printed_matrix_and_back(batch):
    rng = np.random.default_rng(5)
    psi, gamma = rng.uniform(-np.pi, np.pi, (2, *batch))
    theta = rng.uniform(-1.5, 1.5, batch)
    q = attitude.from_euler(psi, theta, gamma)
    euler = np.stack([-psi, theta, gamma], axis=-1).reshape(-1, 3)
    same_rotation(q.reshape(-1, 4), Rotation.from_euler("ZXY", euler).as_quat(scalar_first=True))
    cs, ss = np.cos(psi), np.sin(psi)
    ct, st, cg, sg = np.cos(theta), np.sin(theta), np.cos(gamma), np.sin(gamma)
    printed = [  # docs/mathematics/frames.md#euler-angles
        [cg * cs + sg * ss * st, ss * ct, sg * cs - cg * ss * st],
        [-cg * ss + sg * cs * st, cs * ct, -sg * ss - cg * cs * st],
        [-sg * ct, st, cg * ct],
    ]
    C = np.moveaxis(np.array(printed), (0, 1), (-2, -1))
    assert_allclose(attitude.to_dcm(q), C, atol=1e-15)
    for found, given in zip(attitude.to_euler(C), (psi, theta, gamma), strict=True):
        assert_allclose(attitude.wrap(found - given), 0.0, atol=1e-13)


@pytest.mark.parametrize("pitch", [np.pi / 2, -np.pi / 2])
@pytest.mark.parametrize("psi", [0.0, 0.4, -2.0])
def test_euler_at_the_singularity_keeps_the_rotation(pitch, psi):
    C = attitude.to_dcm(attitude.from_euler(psi, pitch, 0.0))
    heading, found, roll = attitude.to_euler(C)
    assert roll == 0.0
    assert_allclose([found, heading], [pitch, psi], atol=1e-12)


def test_wrap():
    assert_allclose(attitude.wrap(np.array([-np.pi, np.pi, 3.5 * np.pi, 0.1])), [-np.pi, -np.pi, -np.pi / 2, 0.1])


def test_skew():
    v, u = RNG.standard_normal((2, 5, 3))
    assert_allclose((attitude.skew(v) @ u[..., None])[..., 0], np.cross(v, u))


@pytest.mark.parametrize("batch", BATCHES)
def test_misalignment_is_the_composed_rotation(batch):
    """n becomes c by right-handed turns about U, then the new E, then the new N; C_n^c is the transpose."""
    phi = np.random.default_rng(6).uniform(-1.4, 1.4, (*batch, 3))
    turned = Rotation.from_euler("ZXY", phi[..., [2, 0, 1]].reshape(-1, 3))
    C = attitude.misalignment_dcm(phi)
    assert_allclose(C.reshape(-1, 3, 3), np.swapaxes(turned.as_matrix(), -1, -2), atol=1e-15)
    assert_allclose(attitude.to_dcm(attitude.misalignment_quaternion(phi)), C, atol=1e-15)
    assert_allclose(attitude.misalignment_from_dcm(C), phi, atol=1e-14)


def test_misalignment_of_two_attitudes():
    phi = np.array([[0.02, -0.01, 0.3], [1.0, 2.5, -3.0]])
    q = random_q((2,), 7)
    computed = attitude.multiply(attitude.from_dcm(attitude.misalignment_dcm(phi)), q)
    assert_allclose(attitude.misalignment(computed, q), phi, atol=1e-14)
    q = random_q((500,), 8)
    np.testing.assert_array_equal(attitude.misalignment(q, q), 0.0)


def test_azimuth_misalignment_is_the_heading_error():
    q = attitude.from_euler(0.5, 0.0, 0.0)
    computed = attitude.multiply(attitude.misalignment_quaternion(np.array([0.0, 0.0, 0.01])), q)
    assert_allclose(attitude.to_euler(attitude.to_dcm(computed))[0], 0.51, atol=1e-14)


def test_rate_matrix_against_finite_differences():
    """omega_nc^c = C_w phi_dot, where d/dt C_n^c = -[omega x] C_n^c."""
    rng = np.random.default_rng(8)
    phi, rate = rng.uniform(-1.2, 1.2, (20, 3)), rng.standard_normal((20, 3))
    h = 1e-6
    plus, minus = (attitude.misalignment_dcm(phi + s * h * rate) for s in (1, -1))
    omega = -(plus - minus) / (2 * h) @ np.swapaxes(attitude.misalignment_dcm(phi), -1, -2)
    vee = np.stack([omega[:, 2, 1], omega[:, 0, 2], omega[:, 1, 0]], axis=-1)
    assert_allclose((attitude.misalignment_rate_matrix(phi) @ rate[..., None])[..., 0], vee, atol=1e-8)


@pytest.mark.parametrize("angle", [0.0, 1e-12, 1e-6, 0.3, np.pi - 1e-9, np.pi])
def test_rotation_angle(angle):
    q = attitude.from_rotvec(angle * np.array([0.6, 0.0, -0.8]))
    assert_allclose(attitude.rotation_angle(q), angle, rtol=1e-12)
    assert_allclose(attitude.rotation_angle(-q), angle, rtol=1e-12)


def test_rotation_angle_of_nothing_is_nan():
    angles = attitude.rotation_angle(np.array([[np.nan, 0, 0, 0], [1.0, 0, 0, np.nan], [1.0, 0, 0, 0]]))
    assert np.isnan(angles[:2]).all()
    assert angles[2] == 0.0


@pytest.mark.parametrize("apart", [1e-9, 0.2, 3.0])
def test_slerp_against_scipy(apart):
    from scipy.spatial.transform import Slerp

    q0 = random_q((), 9)
    q1 = attitude.multiply(q0, attitude.from_rotvec(apart * np.array([0.6, 0.0, 0.8])))
    w = np.linspace(0.0, 1.0, 11)
    found = attitude.slerp(np.tile(q0, (11, 1)), np.tile(-q1, (11, 1)), w)  # -q1: the same attitude
    expected = Slerp([0, 1], scipy(np.stack([q0, q1])))(w).as_quat(scalar_first=True)
    same_rotation(found, expected)
    parts = attitude.multiply(attitude.conjugate(np.tile(q0, (11, 1))), found)
    assert_allclose(attitude.rotation_angle(parts), w * apart, rtol=1e-6, atol=1e-16)
    assert_allclose(found[0], q0, rtol=0, atol=0)
    assert_allclose(found[-1], q1, rtol=0, atol=0)
