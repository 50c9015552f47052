"""A recording to navigate on: what is asked for, the truth between stamps, and fixes withheld."""

import numpy as np
import pymap3d
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.testing import assert_allclose, assert_array_equal
from oracles import recorded as files
from oracles.replays import make, play, stacked, vector

from sins_env import attitude
from sins_env.envs.spaces import navigation_action_space
from sins_env.recordings import Recording, Reference, load, reference_at
from sins_env.specs import IMU_PRESETS
from sins_env.types import Site

NAVIGATE = {"mode": "navigate", "epoch": 0.05}


def estimates(path, window, offset=(0.0, 0.0, 0.0)):
    """Actions that are the reference, but for a position that is metres off, by pymap3d."""
    env = make(path, **NAVIGATE, window=window, reveal_truth=True)
    _, _, infos = play(env, navigation_action_space().low, seed=0)
    truths = [info["truth"] for info in infos[1:]]
    rows = []
    for one in truths:
        lat, lon, h = pymap3d.enu2geodetic(*offset, *one["pos"], deg=False)
        rows.append(np.concatenate([one["q_nb"], one["vel"], [lat, lon, h]]))
    return rows, truths


def test_both_modes(driven):
    align, navigate = make(driven, epoch=0.05), make(driven, **NAVIGATE)
    assert (align.task.navigate, align.action_space.shape) == (False, (4,))
    assert (navigate.task.navigate, navigate.action_space.shape) == (True, (10,))
    assert (make(driven, coarse=None, window=(0.05, 9.0), start="told").task.coarse_s) == 0.0
    many = vector(driven, 3, **NAVIGATE)
    assert (many.action_space.shape, many.single_action_space.shape) == ((3, 10), (10,))
    assert_allclose(navigate.task.gps.lever_arm_m, [-0.528, -0.985, 2.021])
    assert navigate.task.gps.rate_hz == pytest.approx(1.0)


def test_the_reference_is_the_best_estimate(driven):
    window = (1.0, 3.0)
    rows, truths = estimates(driven, window, (3.0, -4.0, 0.5))
    ref = load(driven).reference
    assert_allclose([t["pos"] for t in truths], ref.pos[20:80], atol=1e-15)
    assert_allclose([t["vel"] for t in truths], ref.vel[20:80], atol=1e-15)
    env = make(driven, **NAVIGATE, window=window)
    env.reset(seed=0)
    for row in rows:
        _, reward, _, _, info = env.step(row)
        assert_allclose(info["errors"]["pos"], [3.0, -4.0, 0.5], atol=2e-5)
        assert_allclose(info["errors"]["vel"], 0.0, atol=1e-15)
        assert reward == pytest.approx(-np.sqrt(25.25) / 10, abs=1e-5)


def test_rows_equal_single_runs(driven):
    settings = {**NAVIGATE, "start": "told", "window": (0.2, 1.0), "stride": 0.35}
    many, one = vector(driven, 3, **settings), make(driven, **settings)
    actions = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 10))
    batch = play(many, actions, seed=11)
    for row in range(3):
        _, rewards, infos = play(one, actions[row], seed=11 + row)
        assert_array_equal(np.stack(batch[1])[:, row], rewards)
        for kind in ("phi", "vel", "pos"):
            assert_array_equal([i["errors"][kind][row] for i in batch[2][1:]], [i["errors"][kind] for i in infos[1:]])
        assert_array_equal(batch[2][0]["start"]["pos"][row], infos[0]["start"]["pos"])


def test_the_told_position_is_drawn_from_the_prior(driven):
    env = vector(driven, 1000, **NAVIGATE, start="told", window=(0.2, 1.0), gps={"pos_std_m": 7.0})
    _, info = env.reset(seed=0)
    place = load(driven).reference.pos[3]
    off = np.array(pymap3d.geodetic2enu(*info["start"]["pos"].T, *place, deg=False))
    assert env.unwrapped.task.prior.position_std_m == 7.0
    assert np.all(np.abs(off.std(axis=1) / 7.0 - 1) < 3.5 / np.sqrt(2000))
    assert np.all(np.abs(off.mean(axis=1)) < 3.5 * 7.0 / np.sqrt(1000))
    aligned = vector(driven, 2, epoch=0.05, start="told", window=(0.2, 1.0))
    assert_array_equal(aligned.reset(seed=0)[1]["start"]["pos"], [place, place])


def test_check_env(driven):
    """Angles, metres and quaternions have one bound each: "symmetric and normalized" is all that may be said."""
    with pytest.warns(UserWarning, match="symmetric and normalized") as found:
        check_env(make(driven, **NAVIGATE, window=(0.2, 1.0)))
    assert all("symmetric and normalized" in str(one.message) for one in found)


def circle(t):
    """A car on a circle of 20 m at 0.25 rad/s: attitude, ECEF-true position by pymap3d, velocity E, N, U."""
    radius, rate = 20.0, 0.25
    east, north = radius * np.sin(rate * t), radius * np.cos(rate * t)
    pos = np.stack(pymap3d.enu2geodetic(east, north, 0.1 * t, 0.59, 1.9, 400.0, deg=False), axis=-1)
    vel = np.stack([rate * north, -rate * east, np.full_like(t, 0.1)], axis=-1)
    return attitude.from_euler(np.pi / 2 + rate * t, 0 * t, 0 * t), vel, pos


def test_positions_between_stamps():
    """At 1 Hz the line cuts the corner by 16 cm; the cubic by a^(2) t^4 / 384 = 0.2 mm."""
    stamps, t = np.arange(0.0, 30.5), np.linspace(0.0, 30.0, 997)
    q, vel, pos = circle(stamps)
    nothing = np.zeros((10, 3))
    one = Recording(
        "circle", 10.0, 0.0, nothing, nothing, Site(0.59, 1.9, 400.0), None, None, Reference(stamps, q, vel, pos)
    )
    _, _, exact = circle(t)

    def away(reference):
        found = reference_at(
            Recording(
                *(getattr(one, n) for n in ("name", "rate_hz", "t0", "dtheta", "dvel", "site")), None, None, reference
            ),
            t,
        ).pos
        return np.abs(np.array(pymap3d.geodetic2enu(*found.T, *exact.T, deg=False))).max()

    assert away(one.reference) < 4e-4
    assert 0.1 < away(one.reference._replace(vel=None)) < 0.2
    assert_allclose(reference_at(one, stamps).pos, pos, atol=1e-15)


def test_fixes_are_withheld(driven):
    settings = {**NAVIGATE, "window": (0.5, 10.0)}
    plain = stacked(play(make(driven, **settings), navigation_action_space().low, seed=0)[0], "gps_valid")[:, 0]
    env = make(driven, **settings, gps={"outages_s": [[2.45, 5.45], [8.0, 8.4]]})
    observations, _, _ = play(env, navigation_action_space().low, seed=0)
    t, valid = stacked(observations, "t")[:, 0], stacked(observations, "gps_valid")[:, 0]
    assert_allclose(t[plain == 1], np.arange(0.45, 10.0))
    assert_allclose(t[valid == 1], [0.45, 1.45, 2.45, 6.45, 7.45, 8.45, 9.45])
    assert not stacked(observations, "gps_pos")[valid == 0].any()
    assert env.task.gps.outages_s == ()  # a surprise


def test_without_a_reference_nothing_is_scored(tmp_path):
    path = files.increments(tmp_path / "bare.npz", ref_q_b2n_wxyz=None, ref_t_s=None)
    _, rewards, infos = play(make(path, **NAVIGATE), navigation_action_space().low, seed=0)
    assert not np.any(rewards)
    assert infos[1]["scored"] is False
    assert_array_equal(infos[1]["errors"]["pos"], 0.0)


def test_all_of_a_recording_begins_where_fixes_end_epochs(driven):
    """Fixes at 0.95 s + n: epochs of 0.1 s begin at 0.05 s."""
    env = make(driven, mode="navigate")
    assert env.episode.world.windows.starts == pytest.approx([0.05])
    assert stacked(play(env, navigation_action_space().low, seed=0)[0], "gps_valid").sum() == 12


@pytest.mark.parametrize("recorded", ["navgrade_car_gps.npz"], indirect=True)
def test_the_driven_car(recorded):
    env = make(recorded, **NAVIGATE, coarse=68.0, imu="navgrade-car", reveal_truth=True)
    assert env.task.imu == IMU_PRESETS["navgrade-car"]
    observations, _, infos = play(env, navigation_action_space().low, seed=0)
    assert stacked(observations, "gps_valid").sum() == 135
    ref = load(recorded).reference
    found = [info["truth"]["pos"] for info in infos[1:]]
    assert len(found) == 2727
    assert_allclose(found, ref.pos, atol=1e-15)
