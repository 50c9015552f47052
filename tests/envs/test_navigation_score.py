"""Scores of attitude, velocity and position together, on a world that is nothing but one true state."""

import dataclasses
import itertools

import numpy as np
import pymap3d
import pytest
from gymnasium import spaces
from numpy.testing import assert_allclose, assert_array_equal
from oracles.courses import make

from sins_env import attitude, earth
from sins_env.envs.base import EpisodeEnv, EpisodeVectorEnv
from sins_env.envs.reward import WORST_PHI, WORST_POS, WORST_VEL, score_navigation
from sins_env.envs.spaces import navigation_action_space
from sins_env.sensors.gps import FIELDS
from sins_env.types import NavState
from sins_env.worlds.world import EpochData

WGS84 = earth.EARTHS["wgs84"]
PLACE = np.array([np.radians(52.0), np.radians(179.9999), 300.0])
TRUTH = NavState(attitude.from_euler(0.5, 0.1, -0.3)[None], np.array([[30.0, -4.0, 1.0]]), PLACE[None])


class Fixed:
    """Every run stands in the same state for ever."""

    scored = True

    fields = FIELDS

    def __init__(self, scored=True):
        self.task = dataclasses.replace(make(duration=1.0).task, navigate=True)
        self.scored = scored

    def reset(self, rngs, options):
        self.runs = len(rngs)
        return self._truth(), self._truth()

    def _truth(self):
        return NavState(*(np.repeat(part, self.runs, axis=0) for part in TRUTH))

    def epoch(self, k):
        zeros = np.zeros((self.runs, 3))
        increments = np.zeros((self.runs, self.task.n_sub, 3))
        fix = {"gps_vel": zeros, "gps_pos": zeros, "gps_valid": np.zeros((self.runs, 1), np.int8)}
        return EpochData({"dtheta": increments, "dvel": increments, **fix}, self._truth())


@dataclasses.dataclass(frozen=True)
class FixedSettings:
    scored: bool = True


class FixedEnv(EpisodeEnv):
    env_id = "SINS/Fixed-v0"
    settings = FixedSettings
    world = staticmethod(lambda env_id, settings: Fixed(settings.scored))


class FixedVectorEnv(EpisodeVectorEnv):
    single = FixedEnv


def action(phi=(0, 0, 0), vel=(0, 0, 0), pos=(0, 0, 0), scale=1.0):
    """The truth with errors: rad, m/s, and latitude rad, longitude rad, height m."""
    q = attitude.multiply(attitude.misalignment_quaternion(np.array(phi, dtype=float)), TRUTH.q_nb[0])
    return np.concatenate([scale * q, TRUTH.vel[0] + vel, PLACE + pos])


def score(*actions):
    batch = np.array(actions)
    truth = NavState(*(np.repeat(part, len(batch), axis=0) for part in TRUTH))
    return score_navigation(batch, truth, WGS84)[:2]


def test_the_space_is_that_of_the_estimate():
    box = navigation_action_space()
    assert isinstance(box, spaces.Box)
    assert box.shape == (10,)
    assert box.contains(action())
    assert FixedEnv().action_space == box
    assert FixedVectorEnv(3).action_space.shape == (3, 10)


def test_the_truth_scores_full_marks():
    errors, reward = score(action())
    assert all(np.abs(part).max() < 1e-7 for part in errors.values())
    assert -1e-6 < reward[0] <= 0


def test_reward_of_each_part():
    deg = np.radians(2.0)
    metres = 30.0 / (float(earth.radii(WGS84, PLACE[0])[0]) + PLACE[2])
    errors, reward = score(
        action(phi=(0, 0, deg)), action(vel=(3, 0, 4)), action(pos=(metres, 0, 40)), action(scale=9.0)
    )
    assert_allclose(reward, [-2.0, -5.0, -5.0, 0.0], atol=1e-6)
    assert_allclose(errors["phi"][0], [0, 0, deg], atol=1e-12)
    assert_allclose(errors["vel"][1], [3, 0, 4], atol=1e-12)
    assert_allclose(errors["pos"][2], [0, 30, 40], atol=1e-6)
    assert score(action((0, 0, deg), (3, 0, 4), (metres, 0, 40)))[1][0] == pytest.approx(-12.0, abs=1e-6)


def test_position_errors_are_metres_across_the_date_line():
    """Against the ECEF displacement; the second estimate gives the same place as 180.0002 deg and as -179.9998 deg."""
    far = np.array([np.radians(1e-4), np.radians(3e-4), 5.0])
    errors, _ = score(action(pos=far), action(pos=far - [0, 2 * np.pi, 0]))
    expected = pymap3d.geodetic2enu(
        *np.degrees((PLACE + far)[:2]), PLACE[2] + 5.0, *np.degrees(PLACE[:2]), PLACE[2], deg=True
    )
    assert_allclose(errors["pos"][0], expected, atol=1e-3)
    assert_allclose(errors["pos"][1], errors["pos"][0], atol=1e-6)


def test_offset_undoes_displace():
    rng = np.random.default_rng(0)
    pos = rng.uniform([-1.5, -np.pi, -1e3], [1.5, np.pi, 1e4], (50, 3))
    metres = rng.normal(0, 1e3, (50, 3))
    assert_allclose(earth.offset(WGS84, pos, earth.displace(WGS84, pos, metres)), metres, atol=1e-6)


@pytest.mark.parametrize("huge", [1e4, 1e154, 1.7e308])
def test_huge_estimates_have_finite_scores(huge):
    errors, reward = score(action(vel=(huge, 0, 0)), action(pos=(huge, -huge, 0)), action(pos=(0, 0, -huge)))
    assert_array_equal(reward, -1000.0)
    for name, worst in (("phi", WORST_PHI), ("vel", WORST_VEL), ("pos", WORST_POS)):
        assert (np.abs(errors[name]) <= worst).all()


BAD = {
    "nan attitude": (0, np.nan),
    "nan velocity": (5, np.nan),
    "inf position": (8, np.inf),
    "minus inf height": (9, -np.inf),
    "zero quaternion": (slice(0, 4), 0.0),
}


@pytest.mark.parametrize(("where", "value"), BAD.values(), ids=BAD)
def test_a_bad_action_is_a_failed_epoch_of_its_row_only(where, value):
    env = FixedVectorEnv(3)
    env.reset(seed=0)
    actions = np.array([action(vel=(1, 0, 0))] * 3)
    actions[1, where] = value
    _, reward, _, _, info = env.step(actions)
    assert_array_equal(info["failed"], [False, True, False])
    assert_allclose(reward, [-1.0, -1000.0, -1.0], atol=1e-6)
    for name, worst in (("phi", WORST_PHI), ("vel", WORST_VEL), ("pos", WORST_POS)):
        assert_array_equal(info["errors"][name][1], worst)
        assert np.abs(info["errors"][name][[0, 2]]).max() < 1.1
    alone = FixedEnv()
    alone.reset(seed=0)
    _, reward, _, _, info = alone.step(actions[1])
    assert reward == -1000.0
    assert info["failed"] is True


def test_without_a_reference_there_are_no_errors():
    env = FixedEnv(scored=False)
    env.reset(seed=0)
    _, reward, _, _, info = env.step(action(vel=(5, 5, 5)))
    assert reward == 0.0
    assert info["scored"] is False
    assert {name: part.any() for name, part in info["errors"].items()} == {"phi": False, "vel": False, "pos": False}


def test_actions_of_the_wrong_shape():
    env = FixedEnv()
    env.reset(seed=0)
    with pytest.raises(
        ValueError, match=r"shape \(4,\); allowed: \(10,\), the quaternion q_nb, scalar first, then v_n"
    ):
        env.step(np.ones(4))


def test_render_draws_the_position_too():
    env = FixedEnv(render_mode="rgb_array")
    env.reset(seed=0)
    images = [env.render()]
    for error in (5.0, 50.0):
        env.step(action(pos=(0, 0, error)))
        images.append(env.render())
    assert images[0].shape == (480, 960, 3)
    assert all(np.any(a != b) for a, b in itertools.pairwise(images))
