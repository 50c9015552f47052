"""Sensors in the words and units of datasheets, as dicts, files and texts."""

import json

import numpy as np
import pytest

from sins_env import specs
from sins_env.reading.datasheets import in_own_units, read_sensor, told
from sins_env.sensors import aids
from sins_env.sensors.allan import gauss_markov
from sins_env.sensors.dvl import DvlSpec
from sins_env.sensors.odometer import OdometerSpec
from sins_env.specs import GPS_PRESETS, IMU_PRESETS, gps_spec, imu_spec
from sins_env.units import UNITS

#: Pairs of one quantity in two units; the numbers are from datasheets, or hand-made from definitions.
SAME_IMU = [
    ({"arw_deg_s_sqrt_hz": 0.005}, {"arw_deg_sqrt_h": 0.3}),  # sqrt(3600 s) = 60
    ({"gyro_noise_density_deg_h_sqrt_hz": 18.0}, {"arw_deg_sqrt_h": 0.3}),
    ({"angle_random_walk_rad_s_sqrt_hz": 8.726646e-5}, {"arw_deg_sqrt_h": 0.3}),
    ({"vrw_mps_sqrt_h": 0.0588399}, {"vrw_ug_sqrt_hz": 100.0}),  # 1e-4 * 9.80665 * 60
    ({"accel_noise_density_mg_sqrt_hz": 0.1}, {"vrw_ug_sqrt_hz": 100.0}),
    ({"velocity_random_walk_mps2_sqrt_hz": 9.80665e-4}, {"vrw_ug_sqrt_hz": 100.0}),
    ({"gyro_bias_repeatability_deg_s": 0.2}, {"gyro_bias_deg_h": 720.0}),
    ({"accel_turn_on_bias_mg": 16.0}, {"accel_bias_ug": 16000.0}),
    ({"scale_factor_percent": 0.03}, {"scale_ppm": 300.0}),
    ({"misalignment_mrad": 1.0}, {"misalignment_arcsec": 206.264806}),
    ({"misalignment_deg": 0.05}, {"misalignment_arcsec": 180.0}),
    ({"gyro_markov_h": 0.5}, {"gyro_markov_s": 1800.0}),
    # K sqrt(T) / sqrt(2) with T = 200 s: K = 1 deg/h/sqrt(h)
    (
        {"gyro_markov_s": 200.0, "rate_random_walk_deg_h_sqrt_h": 1.0},
        {"gyro_markov_s": 200.0, "gyro_markov_deg_h": 1 / 6},
    ),
]


@pytest.mark.parametrize(("theirs", "ours"), SAME_IMU)
def test_units_of_datasheets(theirs, ours):
    found, want = (
        [getattr(imu_spec(one, IMU_PRESETS["tactical"]), f) for f in specs.ImuSpec.__dataclass_fields__]
        for one in (theirs, ours)
    )
    np.testing.assert_allclose(found, want, rtol=1e-6)


def test_other_sensors_have_other_units_too():
    wheel = OdometerSpec.of({"mounting_deg": 0.5, "lever_arm_cm": [0, -120, -80], "pulse_mm": 40.625})
    assert wheel.mounting_mrad == pytest.approx(8.72664626)
    assert wheel.lever_arm_m == pytest.approx((0.0, -1.2, -0.8))
    assert wheel.pulse_m == pytest.approx(1.95 / 48)
    assert DvlSpec.of({"preset": "water", "current_kn": 0.5, "current_h": 1}).current_mps == pytest.approx(
        0.257222, rel=1e-5
    )
    assert gps_spec({"vel_std_cm_s": [3, 3, 5], "outages_min": [[1, 2]]}).outages_s == ((60.0, 120.0),)
    assert gps_spec({"vel_std_cm_s": [3, 3, 5]}).vel_std_mps == pytest.approx((0.03, 0.03, 0.05))


@pytest.mark.parametrize(
    ("word", "sigma", "unit"), [("gyro", "gyro_markov_deg_h", "deg_h"), ("accel", "accel_markov_ug", "ug")]
)
def test_bias_instability_is_the_top_of_the_wandering_bias(word, sigma, unit):
    spec = imu_spec({"preset": "mems", f"{word}_bias_instability_{unit}": 6.0})
    tau = np.geomspace(50.0, 5000.0, 2000)
    top = gauss_markov(getattr(spec, sigma), getattr(spec, f"{word}_markov_s"), tau).max()
    assert top == pytest.approx(6.0, rel=1e-5)


def test_a_field_by_its_own_name_keeps_its_bits():
    value = 0.1 + 0.2
    assert imu_spec({"arw_deg_sqrt_h": value}).arw_deg_sqrt_h == value
    assert imu_spec({"preset": "mems"}) == IMU_PRESETS["mems"]


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"arw_deg_min": 1}, "arw_deg_s_sqrt_hz"),  # the units that there are
        ({"gyro_bias_instabilty_deg_h": 1}, "did you mean 'gyro_bias_instability_deg_h'"),
        ({"vrw_m_s_sqrt_h": 1}, "did you mean 'vrw_mps_sqrt_h'"),
        ({"gyro_biass": 1}, "did you mean 'gyro_bias_deg_h'"),  # the field, not the unit of the nearest length
        ({"gyr_bias_deg_s": 1}, "did you mean 'gyro_bias_deg_s'"),
        ({"gyro_bias_instability_s": 1}, "gyro_bias_instability_deg_h"),  # a time is none
        ({"arw_deg_s_sqrt_hz": -0.1}, "not negative.*given as arw_deg_s_sqrt_hz = -0.1"),
        ({"arw_deg_s_sqrt_hz": "1"}, "a finite number"),
        ({"arw_deg_sqrt_h": 1, "arw_rad_sqrt_s": 1}, "both tell arw_deg_sqrt_h; allowed: one"),
        ({"gyro_bias_instability_deg_h": 1, "rate_random_walk_deg_h_sqrt_h": 1}, "both tell gyro_markov_deg_h"),
    ],
)
def test_what_does_not_fit_is_said(given, text):
    with pytest.raises(ValueError, match=text):
        imu_spec(given)


def test_texts_of_the_command_line():
    assert told("navigation", IMU_PRESETS) == "navigation"
    assert told("navigation, arw_deg_sqrt_h=0.002", IMU_PRESETS) == {"preset": "navigation", "arw_deg_sqrt_h": 0.002}
    assert told("vel_std_mps=[0.1,0.1,0.2],pos_std_m=2", GPS_PRESETS) == {
        "vel_std_mps": [0.1, 0.1, 0.2],
        "pos_std_m": 2,
    }
    assert told("track=water", ()) == {"track": "water"}
    for text, match in (
        ("navigtion", "did you mean 'navigation'"),
        ("mems,arw_deg_sqrt_h", "NAME=VALUE"),
        ("mems,gyro_bias_deg_h=1,gyro_bias_deg_h=2", "twice"),
        ("", "allowed: mems"),
    ):
        with pytest.raises(ValueError, match=match):
            told(text, IMU_PRESETS)


def test_files(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.json").write_text(json.dumps({"preset": "mems", "gyro_bias_deg_s": 0.01}))
    (tmp_path / "mine.yaml").write_text("gyro_bias_deg_s: 1e-2\npreset: mems\n")
    assert told("mine.yaml", IMU_PRESETS) == told("mine.json", IMU_PRESETS)
    assert imu_spec(told("mine.json,scale_ppm=7", IMU_PRESETS)).scale_ppm == 7.0
    (tmp_path / "list.yaml").write_text("- 1\n")
    with pytest.raises(ValueError, match=r"list.yaml: a list; allowed: an object"):
        told("list.yaml", IMU_PRESETS)
    with pytest.raises(FileNotFoundError, match=r"no file 'gone.yaml'"):
        told("gone.yaml", IMU_PRESETS)


def test_imu_files_of_kalibr(tmp_path):
    """The example of the wiki of Kalibr; 1.6968e-04 rad/s/sqrt(Hz) is 0.5833 deg/sqrt(h)."""
    text = (
        "accelerometer_noise_density: 2.0000e-3\naccelerometer_random_walk: 3.0000e-3\n"
        "gyroscope_noise_density: 1.6968e-04\ngyroscope_random_walk: 1.9393e-05\nrostopic: /imu0\nupdate_rate: 200.0\n"
    )
    (tmp_path / "imu.yaml").write_text(text)
    (tmp_path / "nested.yaml").write_text("imu0:\n" + "".join(f"  {line}\n" for line in text.splitlines()))
    spec = imu_spec(read_sensor(tmp_path / "imu.yaml"))
    assert imu_spec(read_sensor(tmp_path / "nested.yaml")) == spec
    assert spec.arw == pytest.approx(1.6968e-4)
    assert spec.arw_deg_sqrt_h == pytest.approx(0.5833, rel=1e-4)
    assert spec.vrw == pytest.approx(2e-3)
    drive = np.radians(spec.gyro_markov_deg_h / 3600) * np.sqrt(2 / spec.gyro_markov_s)
    assert drive == pytest.approx(1.9393e-5)
    assert spec.accel_markov_ug * 9.80665e-6 * np.sqrt(2 / spec.accel_markov_s) == pytest.approx(3e-3)


def test_every_unit_of_a_field_finds_that_field():
    """No two fields of a specification begin alike and have one kind of unit, so that no name is ambiguous."""
    for cls in (specs.ImuSpec, specs.GpsSpec, *(one.specification for one in aids.known().values())):
        own = dict.fromkeys(cls.__dataclass_fields__, 1.0)
        for field in own:
            ends = [unit for unit in UNITS if field.endswith(f"_{unit}")]
            if ends:
                unit = max(ends, key=len)
                stem, (kind, size) = field.removesuffix(f"_{unit}"), UNITS[unit]
                for other, (of, step) in UNITS.items():
                    if of == kind:
                        assert in_own_units({f"{stem}_{other}": 2.0}, own, "it").values == {
                            field: 2.0 * (step / size) if other != unit else 2.0
                        }
