"""What a replay refuses, and what it says then."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles import made
from oracles import recorded as files
from oracles.replays import REPLAY, make, play, stacked, vector

from sins_env.recordings import load


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


@pytest.mark.parametrize("shift", [0.0, 0.013, -0.0437])
def test_fixes_between_the_ends_of_epochs_have_an_age(tmp_path, shift):
    """Each fix appears once, in the epoch in which it was made, and the end of the epoch less its age is its stamp."""
    stamps = np.arange(0.95, 11.9, 1.0)[:11] + shift
    vel = np.column_stack([stamps, -stamps, 0 * stamps])
    path = files.increments(
        tmp_path / "x.npz", gnss_t_imu_s=stamps, gnss_llh_deg_m=np.full((11, 3), 34.0), gnss_vel_enu_mps=vel
    )
    env = make(path, window=(0.0, 11.0))
    observations, _, _ = play(env, seed=0)
    valid = stacked(observations, "gps_valid")[:, 0] == 1
    ends = stacked(observations, "t")[valid, 0]
    age = stacked(observations, "gps_age")
    assert_allclose(ends - age[valid, 0], stamps[:11], atol=1e-9)
    assert age.min() >= 0.0
    assert age.max() < 0.1
    assert not age[~valid].any()
    assert_allclose(stacked(observations, "gps_vel")[valid, 0], stamps, atol=1e-12)
    assert env.observation_space.contains(observations[0])
    withheld = make(path, window=(0.0, 11.0), gps={"outages_s": [[2.95 + shift - 1e-6, 2.95 + shift]]})
    assert stacked(play(withheld, seed=0)[0], "gps_valid").sum() == 10


def test_a_second_fix_in_an_epoch_is_delivered_late(tmp_path):
    stamps = np.array([0.53, 0.57, 1.91, 1.95, 2.05, 3.0])
    path = files.increments(
        tmp_path / "x.npz",
        gnss_t_imu_s=stamps,
        gnss_llh_deg_m=np.full((6, 3), 34.0),
        gnss_vel_enu_mps=np.repeat(stamps[:, None], 3, axis=1),
    )
    observations, _, _ = play(make(path, epoch=0.1, window=(0.0, 11.0)), seed=0)
    valid = stacked(observations, "gps_valid")[:, 0] == 1
    assert_allclose(stacked(observations, "t")[valid, 0], [0.6, 0.7, 2.0, 2.1, 3.0])
    assert_allclose(stacked(observations, "gps_age")[valid, 0], [0.03, 0.17, 0.05, 0.05, 0.0], atol=1e-9)
    assert make(path, window=(0.0, 11.0)).task.epoch_s == 0.1


def test_fixes_on_epochs_have_no_age(driven):
    assert "gps_age" not in make(driven, epoch=0.05, window=(0.05, 11.0)).reset(seed=0)[0]
    assert "gps_age" in make(driven, window=(0.0, 10.0)).reset(seed=0)[0]


@pytest.mark.parametrize(
    ("epoch", "samples"), [(None, 10), (0.1, 10), (0.105, 10), (0.001, 1), (0.0961538, 10), (0.25, 25)]
)
def test_an_epoch_is_a_wish(parked, epoch, samples):
    env = make(parked, epoch=epoch, coarse=0.33, window=("+1", 5.05))
    assert (env.task.n_sub, env.task.epoch_s) == (samples, pytest.approx(samples / 100, rel=1e-15))
    assert env.task.coarse_s == pytest.approx(0.33, abs=0.5 * env.task.epoch_s)
    assert 0 <= 5.05 - env.task.duration_s < env.task.epoch_s
    assert env.episode.world.windows.starts == pytest.approx([1.0])


def test_fast_fixes_make_shorter_epochs(tmp_path):
    stamps = np.arange(0.5, 11.0, 0.05)
    many = len(stamps)
    path = files.increments(
        tmp_path / "x.npz",
        gnss_t_imu_s=stamps,
        gnss_llh_deg_m=np.full((many, 3), 34.0),
        gnss_vel_enu_mps=np.ones((many, 3)),
    )
    assert make(path).task.epoch_s == 0.05


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
    """Without a window the longest part is played; the bridge that the error offers works."""
    tags = 0.005 * np.arange(2400)
    tags[1000:] += 0.15
    path = files.increments(tmp_path / "gap.npz", imu_t_s=tags)
    offer = r"IMU samples are missing from 4\.995 s on, inside the window from 4 s; allowed: .*, or bridge = 0\.2 s"
    with pytest.raises(ValueError, match=offer):
        make(path, epoch=0.05, window=(4.0, 2.0))
    assert make(path, epoch=0.05, window=(4.0, 2.0), bridge=0.2).task.num_epochs == 40
    assert make(path, epoch=0.05, window=(1.0, 3.0)).task.num_epochs == 60
    assert make(path, epoch=0.05, window=(5.15, 3.0)).task.num_epochs == 60
    assert make(path, epoch=0.05).episode.world.windows.starts == pytest.approx([5.15])
    with pytest.raises(
        ValueError, match=r"allowed: windows without a gap$"
    ):  # nothing tells the error of such a bridge
        make(made.recording(samples=600, gaps=[slice(100, 500)]), epoch=0.05, window=(1000.0, 3.0))


def test_dates_need_a_recording_with_dates(parked):
    with pytest.raises(
        ValueError, match=r"start = '2026-06-01T10:00:00Z', and the clock of parked has no date; allowed"
    ):
        make(parked, window=("2026-06-01T10:00:00Z", 5.0))
    with pytest.raises(ValueError, match=r"time = 'noon'; allowed: a date with a time, such as"):
        make(parked, window=("noon", 5.0))
    dated = replace(load(parked), t0=1464343218.0, scale="GPS", reference=None)
    env = make(dated, window=("2026-06-01T10:00:02Z", 5.0))
    assert env.episode.world.windows.starts == pytest.approx([1464343220.0])


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
        ({"gps": {"spoof_mps2": 0.1, "spoof_s": 5.0}}, "spoof_mps2 = 0.1 in a replay; allowed: in a simulation only"),
        ({"gps": {"outages_s": [[2, 1]]}}, "outages_s"),
        ({"gps": {"rate_hz": 3.0}}, "fixes must fall on the ends of epochs"),
        ({"n_sub": 30}, "n_sub = 30; allowed: 10 for epochs of 0.1 s at 100 Hz"),
        ({"bridge": -1.0}, "bridge = -1.0; allowed: a number of seconds, 0 to 60"),
        ({"epoch": "0.1"}, "epoch = '0.1'; allowed: a positive number of seconds"),
        ({"stride": [90]}, r"stride = \[90\]; allowed: a positive number"),
        ({"epoch": -1.0}, "epoch = -1.0; allowed: a positive number"),
        (
            {"window": (8.0, 3.0)},
            "window from 8 to 11 s of parked; allowed: within 0 to 10 s, which samples and",
        ),
        ({"window": (-1.0, 3.0)}, "allowed: within 0 to 10 s"),
        ({"window": (1.0, 0.25)}, "window length = 0.2 s with epochs of 0.1 s"),
        ({"window": (1.0, 0.2)}, "at least 3"),
        ({"window": 3.0}, r"window = 3.0; allowed: \(start, length\)"),
        ({"window": (0.0, np.nan)}, "allowed:"),
        ({"window": [[1], [2, 3]]}, r"window = \[\[1\], \[2, 3\]\]; allowed: \(start, length\)"),
        ({"reveal_truth": "x"}, "reveal_truth = 'x'; allowed: True or False"),
        ({"prior": {}}, r"unknown prior \{\}; allowed: matched, thesis"),
        ({"n_sub": "10"}, "n_sub = '10'; allowed: a whole number"),
        ({"duration": "5"}, "duration = '5'; allowed: a finite number of seconds"),
        ({"duration": 5.0, "window": (1.0, 5.0)}, r"duration = 5 with a window; allowed: window = \(start, length\)"),
        ({"duration": 0.25}, "duration = 0.2 s with epochs of 0.1 s"),
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
