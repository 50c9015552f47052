import numpy as np
import pymap3d
import pytest
from numpy.testing import assert_allclose

from sins_env import earth

WGS84 = earth.get("wgs84")
THESIS = earth.get("thesis")
LATITUDES = np.radians([-89.0, -60.0, -34.2, 0.0, 1e-3, 39.96, 45.0, 80.0, 89.9])


def ecef(model, latitude, longitude, height):
    """Textbook position of a point above the ellipsoid, written apart from the code under test."""
    N = model.a / np.sqrt(1.0 - model.f * (2.0 - model.f) * np.sin(latitude) ** 2)
    p = (N + height) * np.cos(latitude)
    z = (N * (1.0 - model.f) ** 2 + height) * np.sin(latitude)
    return np.stack([p * np.cos(longitude), p * np.sin(longitude), z], axis=-1)


def test_constants():
    assert (WGS84.a, 1 / WGS84.f, WGS84.rate) == (6378137.0, pytest.approx(298.257223563), 7.292115e-5)
    assert (THESIS.a, 1 / THESIS.f) == (6378096.0, pytest.approx(295.0))  # 000 section 2.2.2
    assert WGS84.e2 == pytest.approx(0.00669437999014, abs=1e-14)


@pytest.mark.parametrize("model", [WGS84, THESIS], ids=["wgs84", "thesis"])
@pytest.mark.parametrize("height", [0.0, 380.0, 9000.0])
def test_radii_are_derivatives_of_the_position(model, height):
    R_M, R_N = earth.radii(model, LATITUDES)
    h, longitude = 1e-5, 0.7
    north = ecef(model, LATITUDES + h, longitude, height) - ecef(model, LATITUDES - h, longitude, height)
    east = ecef(model, LATITUDES, longitude + h, height) - ecef(model, LATITUDES, longitude - h, height)
    assert_allclose(np.linalg.norm(north, axis=-1) / (2 * h), R_M + height, rtol=1e-8)
    assert_allclose(np.linalg.norm(east, axis=-1) / (2 * h), (R_N + height) * np.cos(LATITUDES), rtol=1e-8)


def test_radii_agree_with_pymap3d():
    R_M, R_N = earth.radii(WGS84, np.radians(39.96))
    assert_allclose(R_M, pymap3d.rcurve.meridian(39.96), rtol=1e-9)
    assert_allclose(R_N, pymap3d.rcurve.transverse(39.96), rtol=1e-9)


@pytest.mark.parametrize(
    ("latitude_deg", "height", "value"),
    [
        (0.0, 0.0, 9.7803253359),
        (90.0, 0.0, 9.8321849379),  # WGS-84, TR8350.2
        (45.0, 0.0, 9.80619777),
        (45.0, 1000.0, 9.80619777 - 3.086e-3),
        (-45.0, 0.0, 9.80619777),
        (34.246048, 380.0, 9.7955),  # ../shared/data/README.md
    ],
)
def test_gravity(latitude_deg, height, value):
    tolerance = 5e-5 if height == 380.0 else 1e-8
    assert earth.gravity(WGS84, np.radians(latitude_deg), height) == pytest.approx(value, abs=tolerance)


def test_gravity_has_the_free_air_gradient_outside_the_bracket():
    g = earth.gravity(WGS84, LATITUDES[:, None], np.array([0.0, 1000.0]))
    assert_allclose(g[:, 0] - g[:, 1], 3.086e-3, rtol=1e-9)  # erratum 2: inside, it is 9.78 times as much


@pytest.mark.parametrize("longitude_deg", [-170.0, 0.0, 108.9])
@pytest.mark.parametrize("latitude_deg", [-45.0, 0.0, 39.96, 80.0])
def test_ecef_to_enu_against_pymap3d(latitude_deg, longitude_deg):
    C = earth.ecef_to_enu(np.radians(latitude_deg), np.radians(longitude_deg))
    u = np.array([0.3, -1.2, 2.0])
    assert_allclose(C @ u, pymap3d.ecef2enuv(*u, latitude_deg, longitude_deg), atol=1e-12)
    assert_allclose(C @ C.T, np.eye(3), atol=1e-15)


@pytest.mark.parametrize("latitude_deg", [-60.0, 0.0, 39.96])
def test_displace_against_pymap3d(latitude_deg):
    pos = np.array([np.radians(latitude_deg), np.radians(116.3), 50.0])
    offset = np.array([0.02, -0.03, 0.03])
    latitude, longitude, height = pymap3d.enu2geodetic(*offset, latitude_deg, 116.3, 50.0)
    moved = earth.displace(WGS84, pos, offset)
    assert_allclose(moved[:2], np.radians([latitude, longitude]), rtol=0, atol=1e-14)  # 6e-8 m
    assert_allclose(moved[2], height, atol=1e-7)


def test_rate_and_transport_are_batched():
    rate = earth.rate_n(WGS84, LATITUDES)
    assert_allclose(np.linalg.norm(rate, axis=-1), WGS84.rate)
    assert_allclose(rate[:, 2], WGS84.rate * np.sin(LATITUDES))
    v = np.array([10.0, -20.0, 3.0])
    R_M, R_N = earth.radii(WGS84, LATITUDES)
    omega = earth.transport_matrix(WGS84, LATITUDES, 100.0) @ v
    by_hand = [20.0 / (R_M + 100.0), 10.0 / (R_N + 100.0), 10.0 * np.tan(LATITUDES) / (R_N + 100.0)]
    assert_allclose(omega, np.stack(by_hand, axis=-1), rtol=1e-12)


@pytest.mark.parametrize("latitude_deg", [89.91, -89.91, 1e6, np.nan, np.inf])
def test_latitude_guard(latitude_deg):
    with pytest.raises(ValueError, match=r"allowed: -89\.9 to 89\.9 deg"):
        earth.check_latitude(np.radians(latitude_deg))


def test_latitude_within_the_guard_is_returned():
    assert earth.check_latitude(np.radians(-89.9)) == np.radians(-89.9)


def test_unknown_model():
    with pytest.raises(ValueError, match="did you mean 'wgs84'"):
        earth.get("wgs-84")
