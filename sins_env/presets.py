"""Presets: the fields of named sensors, for :class:`sins_env.specs.ImuSpec` and :class:`sins_env.specs.GpsSpec`.

See docs/mathematics/simulation.md#presets.
"""

from __future__ import annotations

from typing import Any

Fields = dict[str, Any]

# 000 section 2.5.3: "white noise of 50e-6 g" is read as the standard deviation of a sample at 100 Hz, 5 ug/sqrt(Hz).
_THESIS: Fields = {
    "gyro_bias_deg_h": 0.02,
    "arw_deg_sqrt_h": 0.01,
    "accel_bias_ug": 100.0,
    "vrw_ug_sqrt_hz": 5.0,
}

IMU: dict[str, Fields] = {
    "perfect": {},
    "thesis-white": _THESIS,
    # The accelerometers have a Gauss-Markov bias and no constant one.
    "thesis-markov": {
        **_THESIS,
        "gyro_markov_deg_h": 0.1,
        "gyro_markov_s": 3600.0,
        "accel_bias_ug": 0.0,
        "accel_markov_ug": 100.0,
        "accel_markov_s": 900.0,
    },
    # The sensors of 000 chapter 6, with the pulse weights of the recording rlg_parked_car.npz.
    "rlg-car": {
        "gyro_bias_deg_h": 0.01,
        "arw_deg_sqrt_h": 0.005,
        "accel_bias_ug": 100.0,
        "vrw_ug_sqrt_hz": 5.0,
        "gyro_lsb_arcsec": 0.1,
        "accel_lsb_mps": 1.222540875e-3,
    },
    # The sensors as the makers of the recording navgrade_car_gps.npz state them.
    "navgrade-car": {
        "gyro_bias_deg_h": 0.05,
        "arw_deg_sqrt_h": 0.001,
        "accel_bias_ug": 1000.0,
        "vrw_ug_sqrt_hz": 10.0,
    },
    "navigation": {
        "gyro_bias_deg_h": 0.005,
        "arw_deg_sqrt_h": 0.002,
        "accel_bias_ug": 30.0,
        "vrw_ug_sqrt_hz": 10.0,
        "scale_ppm": 5.0,
        "misalignment_arcsec": 5.0,
    },
    "tactical": {
        "gyro_bias_deg_h": 1.0,
        "arw_deg_sqrt_h": 0.1,
        "gyro_markov_deg_h": 0.3,
        "gyro_markov_s": 600.0,
        "accel_bias_ug": 1000.0,
        "vrw_ug_sqrt_hz": 100.0,
        "accel_markov_ug": 50.0,
        "accel_markov_s": 600.0,
        "scale_ppm": 300.0,
        "misalignment_arcsec": 60.0,
    },
    "mems": {
        "gyro_bias_deg_h": 20.0,
        "arw_deg_sqrt_h": 0.3,
        "gyro_markov_deg_h": 5.0,
        "gyro_markov_s": 200.0,
        "accel_bias_ug": 5000.0,
        "vrw_ug_sqrt_hz": 150.0,
        "accel_markov_ug": 100.0,
        "accel_markov_s": 200.0,
        "scale_ppm": 1000.0,
        "misalignment_arcsec": 200.0,
    },
}

GPS: dict[str, Fields] = {
    "perfect": {"vel_std_mps": 0.0, "pos_std_m": 0.0},
    "thesis": {"vel_std_mps": 0.1, "pos_std_m": 10.0, "rate_hz": 10.0},
    "dgps": {"vel_std_mps": 0.03, "pos_std_m": (0.5, 0.5, 1.0), "rate_hz": 10.0},
}
