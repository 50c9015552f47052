"""What every estimator is told, and that none can change it for the others."""

import copy
import json
import pickle
from dataclasses import asdict

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from sins_env import presets
from sins_env.prior import PRIORS
from sins_env.specs import GPS_PRESETS, IMU_PRESETS, gps_spec, imu_spec

SPREAD = (1.0, 1.0, 15.0)


def told(prior="matched", imu="thesis-white", gps="dgps"):
    return PRIORS[prior](imu_spec(imu), gps_spec(gps), 0.1, SPREAD)


@pytest.mark.parametrize("through", [lambda p: p, copy.copy, copy.deepcopy, lambda p: pickle.loads(pickle.dumps(p))])
@pytest.mark.parametrize("name", ["P0", "Q", "R"])
def test_the_arrays_of_a_prior_cannot_be_changed(name, through):
    prior = told()
    kept = getattr(prior, name).copy()
    array = getattr(through(prior), name)
    with pytest.raises(ValueError, match="read-only"):
        array[0, 0] = 1.0
    with pytest.raises(ValueError, match="read-only"):
        array *= 2.0
    assert_array_equal(getattr(prior, name), kept)


@pytest.mark.parametrize("prior", PRIORS)
@pytest.mark.parametrize("gps", GPS_PRESETS)
def test_priors_hold_plain_numbers(prior, gps):
    values = asdict(told(prior, gps=gps))
    assert "np." not in repr(values)
    flat = [v for value in values.values() for v in (value if isinstance(value, tuple) else (value,))]
    assert {type(v) for v in flat} == {float}
    assert json.loads(json.dumps(values)) == {k: list(v) if isinstance(v, tuple) else v for k, v in values.items()}


def test_every_preset_is_a_spec():
    assert IMU_PRESETS.keys() == presets.IMU.keys()
    assert GPS_PRESETS.keys() == presets.GPS.keys()
    for name, fields in presets.IMU.items():
        assert imu_spec(name) == imu_spec(fields) == imu_spec({"preset": name})
    for name, fields in presets.GPS.items():
        assert gps_spec(name) == gps_spec(fields) == gps_spec({"preset": name})


def test_a_dict_changes_its_preset():
    changed = imu_spec({"preset": "mems", "gyro_bias_deg_h": np.float64(7)})
    assert changed.gyro_bias_deg_h == 7.0
    assert changed.accel_bias_ug == IMU_PRESETS["mems"].accel_bias_ug
