"""What a replay refuses, and what it says then."""

import gymnasium
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles import recorded as files
from oracles.replays import REPLAY, make, play, stacked, vector


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (10, "window 10 does not exist; allowed: 0 to 9"),
        (-1, "window -1 does not exist"),
        (8, "window 10 does not exist"),  # rows 8, 9, 10
        ([0, 1, 12], "window 12 does not exist"),
        ([0, 1], "one whole number, or a list of 3"),
        (1.5, "one whole number"),
        ("first", "one whole number"),
        ([[1], [2, 3], 4], "one whole number, or a list of 3"),
        ([1.0, 2.0, 3.0], "one whole number, or a list of 3"),
        (True, "one whole number"),
    ],
)
def test_bad_window_options(parked, given, message):
    with pytest.raises(ValueError, match=message):
        vector(parked, 3, window=(0.0, 1.0), stride=1.0).reset(options={"window": given})


def test_unknown_reset_option(parked):
    with pytest.raises(ValueError, match="unknown reset option 'windw'; did you mean 'window'"):
        make(parked).reset(options={"windw": 0})


def test_told_fixes(parked, driven):
    assert make(parked, gps={"vel_std_mps": 0.01}).task.gps.vel_std_mps == 0.01
    assert make(parked, gps="dgps").task.gps.rate_hz == 10.0
    thinned = make(parked, gps={"rate_hz": 2.0})
    valid = stacked(play(thinned, seed=0)[0][:-1], "gps_valid")[:, 0]
    assert_array_equal(np.flatnonzero(valid), np.arange(4, 100, 5))
    told = make(driven, epoch=0.05).task.gps
    assert told.rate_hz == pytest.approx(1.0)
    assert_allclose(told.lever_arm_m, [-0.528, -0.985, 2.021])
    named = make(driven, epoch=0.05, gps="thesis").task.gps
    assert (named.vel_std_mps, named.rate_hz) == (0.1, told.rate_hz)
    assert named.lever_arm_m == told.lever_arm_m


def test_fixes_between_epochs_are_refused_with_what_fits(driven):
    fits = r"begins at 0\.05 s modulo 0\.1 s or epochs of 0\.05 s"
    with pytest.raises(ValueError, match=rf"fix at 0\.95 s is 0\.05 s off .* {fits}"):
        make(driven, window=(0.0, 10.0))
    with pytest.raises(ValueError, match=r"begins at 0\.05 s modulo 0\.1 s"):
        make(driven, window=(0.02, 10.0))


@pytest.mark.parametrize(("shift", "fits"), [(0.0024, True), (0.0026, False)])
def test_half_a_sample_is_the_limit(tmp_path, shift, fits):
    t = np.arange(0.95, 11.9, 1.0)[:11]
    llh, vel = np.full((11, 3), 34.0), np.ones((11, 3))
    path = files.increments(tmp_path / "x.npz", gnss_t_imu_s=t + shift, gnss_llh_deg_m=llh, gnss_vel_enu_mps=vel)
    if fits:
        observations, _, _ = play(make(path, epoch=0.05, window=(0.05, 11.0)), seed=0)
        assert stacked(observations, "gps_valid").sum() == 11
    else:
        with pytest.raises(ValueError, match=r"is 0\.0024 s off|is 0\.0026 s off"):
            make(path, epoch=0.05, window=(0.05, 11.0))


def test_without_a_reference_nothing_is_scored(tmp_path):
    path = files.counts(tmp_path / "bare.npz", ref_q_b2n_wxyz=None, ref_t_s=None)
    _, rewards, infos = play(make(path), seed=0)
    assert not np.any(rewards)
    for info in infos[1:]:
        assert info["scored"] is False
        assert_array_equal(info["errors"]["phi"], 0.0)
        assert info["failed"] is False
    for bad in ([np.nan] * 4, [0.0] * 4, [1.0, np.inf, 0.0, 0.0]):
        _, rewards, infos = play(make(path, render_mode="rgb_array"), np.array(bad), seed=0)
        assert all(info["failed"] is True for info in infos[1:])
        assert not np.any(rewards)
        assert_array_equal([info["errors"]["phi"] for info in infos[1:]], 0.0)
    for settings in ({"start": "told"}, {"reveal_truth": True}):
        with pytest.raises(ValueError, match="has no reference"):
            make(path, **settings)


def test_gaps(tmp_path):
    tags = 0.005 * np.arange(2400)
    tags[1000:] += 0.05
    path = files.increments(tmp_path / "gap.npz", imu_t_s=tags)
    with pytest.raises(ValueError, match=r"IMU samples are missing from 4\.995 s on, inside the window from 4 s"):
        make(path, epoch=0.05, window=(4.0, 2.0))
    assert make(path, epoch=0.05, window=(1.0, 3.0)).task.num_epochs == 60
    assert make(path, epoch=0.05, window=(5.05, 3.0)).task.num_epochs == 60


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"windw": (0, 1)}, "unknown setting of SINS/Replay-v0 'windw'; did you mean 'window'"),
        ({"start": "tld"}, "unknown start 'tld'; did you mean 'told'"),
        ({"mode": "navgate"}, "unknown mode 'navgate'; did you mean 'navigate'"),
        (
            {"mode": "navigate"},
            "mode = 'navigate' on parked, whose reference is short of them; allowed: a reference with",
        ),
        ({"prior": "machted"}, "did you mean 'matched'"),
        ({"imu": "rlg-kar"}, "did you mean 'rlg-car'"),
        ({"gps": {"vel_std": 0.1}}, "unknown setting of GpsSpec 'vel_std'; did you mean"),
        ({"gps": {"jump_mps": 1.0}}, "jump_mps = 1 in a replay; allowed: in a simulation only"),
        ({"gps": {"outages_s": [[2, 1]]}}, "outages_s"),
        ({"gps": {"rate_hz": 3.0}}, "fixes must fall on the ends of epochs"),
        ({"n_sub": 30}, "n_sub = 30; allowed: 10 for epochs of 0.1 s at 100 Hz"),
        (
            {"epoch": 0.105},
            "epoch = 0.105 s is 10.5 samples of 100 Hz; allowed: whole samples, for instance 0.1 s",
        ),
        ({"epoch": 0.001}, "for instance 0.01 s"),
        ({"epoch": "0.1"}, "epoch = '0.1'; allowed: a positive number of seconds"),
        ({"stride": [90]}, r"stride = \[90\]; allowed: a positive number"),
        ({"epoch": -1.0}, "epoch = -1.0; allowed: a positive number"),
        (
            {"window": (8.0, 3.0)},
            "window from 8 to 11 s of parked; allowed: within 0 to 10 s, which samples and",
        ),
        ({"window": (-1.0, 3.0)}, "allowed: within 0 to 10 s"),
        ({"window": (1.0, 0.25)}, "window length = 0.25 s with epochs of 0.1 s"),
        ({"window": (1.0, 0.2)}, "at least 3"),
        ({"window": 3.0}, r"window = 3.0; allowed: \(start, length\)"),
        ({"window": (0.0, np.nan)}, "allowed:"),
        ({"window": [[1], [2, 3]]}, r"window = \[\[1\], \[2, 3\]\]; allowed: \(start, length\)"),
        ({"reveal_truth": "x"}, "reveal_truth = 'x'; allowed: True or False"),
        ({"prior": {}}, r"unknown prior \{\}; allowed: matched, thesis"),
        ({"n_sub": "10"}, "n_sub = '10'; allowed: a whole number"),
        ({"duration": "5"}, "duration = '5'; allowed: a finite number of seconds"),
        ({"duration": 5.0, "window": (1.0, 5.0)}, r"duration = 5 with a window; allowed: window = \(start, length\)"),
        ({"duration": 0.25}, "duration = 0.25 s with epochs of 0.1 s"),
        ({"duration": 11.0}, "window from 0 to 11 s of parked; allowed: within 0 to 10 s"),
        ({"stride": 0.0}, "stride = 0.0; allowed: a positive number"),
        ({"coarse": 20.0}, "allowed: coarse shorter than the window length"),
        ({"coarse": 3.0, "start": "told"}, "coarse = 3.0 with start = 'told'; allowed: 0"),
        ({"misalignment_deg": (1, 1, 1)}, "misalignment_deg with start = 'unknown'"),
        ({"misalignment_deg": (1, 1), "start": "told"}, "allowed: three finite numbers"),
        ({"start": "told", "window": (0.0, 3.0)}, "allowed: within 0.1 to 10 s"),
    ],
)
def test_bad_settings(parked, settings, message):
    with pytest.raises(ValueError, match=message):
        make(parked, **settings)


def test_a_rate_that_is_not_the_recordings(driven):
    with pytest.raises(ValueError, match=r"GpsSpec\.rate_hz = 5; allowed: 1, the recording's own"):
        make(driven, epoch=0.05, gps={"rate_hz": 5.0})


def test_a_recording_is_needed():
    with pytest.raises(ValueError, match="recording = ''; allowed: the path of a recording"):
        gymnasium.make(REPLAY)
    for bad in (5, None, ["a.npz"], b"a.npz"):
        with pytest.raises(ValueError, match=r"^recording = .*; allowed: the path of a recording"):
            gymnasium.make(REPLAY, recording=bad)
    with pytest.raises(FileNotFoundError, match=r"no recording 'nowhere\.npz'"):
        gymnasium.make(REPLAY, recording="nowhere.npz")


def test_the_rate_of_the_fixes_is_the_recordings(driven, tmp_path):
    """Each fix once more half a second later, at 2 Hz."""
    assert make(driven).task.gps.rate_hz == pytest.approx(1.0)
    raw = np.load(driven)
    twice = {name: np.repeat(raw[name], 2, axis=0) for name in ("gnss_llh_deg_m", "gnss_vel_enu_mps")}
    twice["gnss_t_imu_s"] = np.add.outer(raw["gnss_t_imu_s"], [0.0, 0.5]).ravel()
    assert make(
        files.increments(tmp_path / "twice.npz", **twice), accept="held_fixes"
    ).task.gps.rate_hz == pytest.approx(2.0)
