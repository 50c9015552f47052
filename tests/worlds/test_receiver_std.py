"""Standard deviations of a receiver as the noise of each fix: what is used of them, and what stands in."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles import made
from oracles.replays import make, play, stacked, vector

from sins_env.recordings import findings
from sins_env.worlds.replay_settings import ReplaySettings


def observed(recording, **settings):
    """The standard deviations (10, 6) of the ten fixes of a recording, one a second; None if there are none."""
    observations, _, _ = play(make(recording, **settings), seed=0)
    if "gps_pos_std" not in observations[0]:
        return None
    std = np.concatenate([stacked(observations, f"gps_{part}_std") for part in ("vel", "pos")], axis=1)
    valid = stacked(observations, "gps_valid")[:, 0] == 1
    assert not std[~valid].any()
    return std[valid]


def test_each_fix_has_its_own():
    one = made.recording()
    want = np.concatenate([one.gnss.vel_std, one.gnss.pos_std], axis=1)
    assert_array_equal(observed(one), want)
    rows, _ = vector(one, 2).reset(seed=0)
    assert rows["gps_pos_std"].shape == (2, 3)
    task = make(one).task
    assert_allclose(task.gps.vel_std_mps, np.median(want[:, :3], axis=0))
    assert_allclose(task.gps.pos_std_m, np.median(want[:, 3:], axis=0))
    settings = {"factor": 0.5, "vel_floor_mps": 0.4, "pos_floor_m": 0.9}
    floors = np.repeat([0.4, 0.9], 3)
    assert_allclose(observed(one, fix_std=settings), np.maximum(0.5 * want, floors))


def test_what_is_told_stands_for_the_file():
    one = made.recording()
    for gps in ("dgps", {"preset": "dgps"}, {"vel_std_mps": 1.0, "pos_std_cm": 100.0}):
        assert observed(one, gps=gps) is None
    assert observed(made.recording(std=False)) is None
    mixed = observed(one, gps={"vel_std_cm_s": 20, "outages_s": [[3.5, 4.5]]})
    assert_allclose(mixed[:, :3], 0.2)
    assert_array_equal(mixed[:, 3:], np.delete(one.gnss.pos_std, 3, axis=0))


def test_zeros_are_said_and_the_assumed_noise_stands_in():
    """Case 08: a receiver that writes zeros."""
    one = made.recording()
    std = one.gnss.pos_std.copy()
    std[[2, 5], 1] = 0.0
    part = replace(one, gnss=one.gnss._replace(pos_std=std))
    found = observed(part)
    assert_allclose(found[[2, 5], 3:], [[0.5, 0.5, 1.0]] * 2)  # those of dgps
    assert_array_equal(np.delete(found, [2, 5], axis=0)[:, 3:], np.delete(std, [2, 5], axis=0))
    said = [one for one in findings(part) if one.name == "receiver_std"]
    assert [(f.value, f.wrong, f.span_s) for f in said] == [(2, False, (1003.0, 1006.0))]
    assert "2 of 10 standard deviations of the positions are zero" in str(said[0])
    none = replace(one, gnss=one.gnss._replace(pos_std=0 * std, vel_std=0 * std))
    assert observed(none) is None
    assert [f.value for f in findings(none) if f.name == "receiver_std"] == [10, 10]
    assert not [f for f in findings(one) if f.name == "receiver_std"]


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"factor": 0}, "factor = 0; allowed: a number > 0"),
        ({"pos_flor_m": 1}, "did you mean 'pos_floor_m'"),
        ({"vel_floor_mps": -1}, "vel_floor_mps = -1"),
        (2.0, "a dict of factor"),
    ],
)
def test_wrong_settings(given, text):
    with pytest.raises(ValueError, match=text):
        ReplaySettings(recording="x", fix_std=given)
