"""What the options of sensors tell a replay."""

from argparse import Namespace

import pytest
from oracles import made

from sins_env.cli.verbs.sensors import sensor_settings
from sins_env.worlds.replay_settings import ReplaySettings


def told(**given):
    return sensor_settings(Namespace(**{"imu": None, "gps": None, "fix_std": None, "aid": [], "outage": [], **given}))


def test_options_become_settings():
    assert told() == {}
    assert told(imu="mems", gps="dgps") == {"imu": "mems", "gps": "dgps"}
    assert told(imu="mems,scale_ppm=3", outage=[[1.0, 2.0]]) == {
        "imu": {"preset": "mems", "scale_ppm": 3},
        "gps": {"outages_s": [[1.0, 2.0]]},
    }
    assert told(gps="dgps", outage=[[1.0, 2.0]]) == {"gps": {"preset": "dgps", "outages_s": [[1.0, 2.0]]}}
    assert told(
        fix_std="factor=2", aid=["odometer:calibrated,noise_mps=0.1", "dvl", "height:off", "depth,noise_cm=3"]
    ) == {
        "fix_std": {"factor": 2},
        "aids": {
            "odometer": {"preset": "calibrated", "noise_mps": 0.1},
            "dvl": {},
            "height": "off",
            "depth": {"noise_cm": 3},
        },
    }
    for given, text in (
        ({"aid": ["odomter"]}, "did you mean 'odometer'"),
        ({"aid": ["odometer:calibratd"]}, "did you mean 'calibrated'"),
        ({"aid": ["dvl:noise_mp=1"]}, "did you mean 'noise_mps'"),
        ({"fix_std": "factr=2"}, "did you mean 'factor'"),
    ):
        with pytest.raises(ValueError, match=text):
            told(**given)
    with pytest.raises(ValueError, match="did you mean 'mems'"):
        told(imu="mesm")


def test_a_preset_keeps_the_rate_and_the_lever_arm_of_the_recording_unless_told():
    recording = made.recording()
    fixes = [
        ReplaySettings(recording="x", gps=gps).fixes(recording)
        for gps in (
            None,
            "thesis",
            {"preset": "thesis", "pos_std_m": 3.0},
            {"preset": "thesis", "lever_arm_cm": [0, 0, 50]},
        )
    ]
    assert {one.rate_hz for one in fixes} == {1.0}
    assert [one.lever_arm_m for one in fixes] == [tuple(recording.lever_arm)] * 3 + [(0.0, 0.0, 0.5)]
    assert [one.pos_std_m for one in fixes[1:]] == [10.0, 3.0, 10.0]
    assert fixes[2].vel_std_mps == 0.1
