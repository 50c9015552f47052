import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.testing import assert_allclose, assert_array_equal
from oracles.courses import IDENTITY, ONE_SECOND_UNKNOWN, STATIC, SWAY, actions_of, make, play, truths, vector

from sins_env import attitude
from sins_env.envs import register
from sins_env.envs.rendering import sensor_floor
from sins_env.specs import IMU_PRESETS


def attitudes(env_id=SWAY, *, seed):
    """True attitudes from the start to the end of the last epoch."""
    return [truth["q_nb"] for truth in truths(make(env_id, reveal_truth=True), IDENTITY, 25, seed)]


@pytest.mark.parametrize("env_id", [SWAY, STATIC])
@pytest.mark.parametrize(
    "settings",
    [
        {},
        ONE_SECOND_UNKNOWN,
        {"imu": "thesis-markov", "prior": "thesis"},
        {"misalignment_deg": (1.0, 1.0, 10.0), "heading_deg": None, "reveal_truth": True},
        {"imu": "mems", "vibration": True, "motion": "random"},
        {"render_mode": "rgb_array"},
    ],
    ids=str,
)
def test_check_env(env_id, settings):
    check_env(make(env_id, **settings))


@pytest.mark.parametrize("env_id", [SWAY, STATIC])
def test_defaults_make_an_environment(env_id):
    env = gymnasium.make(env_id)
    assert (env.unwrapped.task.duration_s, env.unwrapped.task.coarse_s) == (360.0, 0.0)
    unknown = gymnasium.make(env_id, start="unknown").unwrapped.task
    assert (unknown.duration_s, unknown.coarse_s) == (480.0, 120.0)
    assert env.spec.max_episode_steps is None


def test_registration_is_idempotent():
    before = dict(gymnasium.registry)
    register()
    assert dict(gymnasium.registry) == before


BAD_ACTIONS = {
    "nan": [np.nan, 0, 0, 0],
    "one nan": [1.0, 0, 0, np.nan],
    "inf": [np.inf, 0, 0, 0],
    "minus inf": [0.5, 0, -np.inf, 0],
    "zero": [0.0, 0, 0, 0],
}


@pytest.mark.parametrize("bad", BAD_ACTIONS.values(), ids=BAD_ACTIONS)
def test_a_bad_action_is_a_failed_epoch_of_its_row_only(bad):
    good = np.array([[0.9, 0.1, 0.0, -0.2]] * 3)
    spoilt = good.copy()
    spoilt[1] = bad
    course = play(vector(3), [good, spoilt, good], seed=1)
    plain = play(vector(3), [good, good, good], seed=1)
    _, reward, over, info = course[2]
    assert_array_equal(info["failed"], [False, True, False])
    assert reward[1] == -180.0
    assert np.isfinite(info["errors"]["phi"]).all()
    assert not over.any()
    for k in (1, 2, 3):
        keep = [0, 1, 2] if k != 2 else [0, 2]
        assert_array_equal(course[k][1][keep], plain[k][1][keep])
        assert_array_equal(course[k][3]["errors"]["phi"][keep], plain[k][3]["errors"]["phi"][keep])
        for key in course[k][0]:
            assert_array_equal(course[k][0][key], plain[k][0][key])
    assert play(make(), [np.array(bad)], seed=0)[1][1] == -180.0


def test_actions_are_normalised_and_both_signs_are_the_same_attitude():
    q = np.array([[0.5, -0.1, 0.3, 0.7]])
    rewards = [play(vector(1), [a * q], seed=1)[1][1][0] for a in (1.0, -1.0, 0.01, 1e-200, 1e200)]
    assert_allclose(rewards, rewards[0], rtol=1e-12)


@pytest.mark.parametrize("shape", [(3,), (2, 4), ()])
def test_actions_of_the_wrong_shape(shape):
    env = make()
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"allowed: \(4,\)"):
        env.step(np.ones(shape))
    rows = vector(3)
    rows.reset(seed=0)
    with pytest.raises(ValueError, match=r"allowed: \(3, 4\)"):
        rows.step(np.ones(shape))


@pytest.mark.parametrize(
    "action",
    [[10**400, 0, 0, 0], [1j, 0, 0, 0], np.ones(4) + 0j, ["1", "0", "0", "0"], [[1.0], [2.0, 3.0]], {}, object()],
    ids=["huge", "complex", "complex array", "text", "ragged", "dict", "object"],
)
def test_actions_that_are_no_numbers(action):
    env = make()
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"^action = .*; allowed: numbers, \(4,\), the quaternion q_nb"):
        env.step(action)
    _, reward, *_ = env.step(np.array([1, 0, 0, 0], dtype=object))  # numbers all the same
    assert np.isfinite(reward)


@pytest.mark.parametrize(("seed", "options"), [("1", None), (-1, None), (1.0, None), (0, 3), (0, "record")])
def test_seeds_and_options_of_another_type(seed, options):
    with pytest.raises(ValueError, match=r"^(seed|options) = .*; allowed: None, "):
        make().reset(seed=seed, options=options)


@pytest.mark.parametrize("env_id", [SWAY, STATIC])
def test_the_truth_scores_full_marks(env_id):
    previous, *others = attitudes(env_id, seed=2)
    env = make(env_id, reveal_truth=True)
    env.reset(seed=2)
    for truth in others:
        _, reward, _, _, info = env.step(truth)
        assert -1e-6 < reward <= 0
        assert np.abs(info["errors"]["phi"]).max() < 1e-7
        assert_array_equal(info["truth"]["q_nb"], truth)
        moved = attitude.rotation_angle(attitude.multiply(attitude.conjugate(previous), truth))
        assert (moved > 1e-3) == (env_id == SWAY)
        previous = truth


def test_errors_and_reward_of_a_known_misalignment():
    env = make(reveal_truth=True)
    env.reset(seed=2)
    phi = np.radians([2.0, -1.0, 30.0])
    computed = attitude.multiply(attitude.misalignment_quaternion(phi), attitudes(seed=2)[1])
    _, reward, _, _, info = env.step(computed)
    assert_allclose(info["errors"]["phi"], phi, atol=1e-14)
    trace = np.trace(attitude.misalignment_dcm(phi))
    assert reward == pytest.approx(-np.degrees(np.arccos((trace - 1) / 2)), rel=1e-12)


def test_k_steps_and_the_terminal_observation():
    course = play(make(), actions_of(1, 25)[:, 0], seed=0)
    assert [c[2] for c in course] == [False] * 25 + [True]
    assert type(course[-1][2]) is bool
    assert_allclose([c[0]["t"][0] for c in course], [*(0.1 * np.arange(1, 26)), 2.5])
    for obs, *_ in course[:-1]:
        assert np.abs(obs["dvel"]).max(axis=0).all()
        assert obs["gps_valid"] == 1
    last = course[-1][0]
    assert all(not last[key].any() for key in ("dtheta", "dvel", "gps_vel", "gps_pos", "gps_valid"))


def test_stepping_beyond_the_end_or_before_the_start():
    env = make()
    with pytest.raises(RuntimeError, match=r"step\(\) before reset\(\)"):
        env.step(IDENTITY)
    play(env, [IDENTITY] * 25, seed=0)
    with pytest.raises(RuntimeError, match=r"after the end of the episode"):
        env.step(IDENTITY)


def test_observations_are_in_their_space():
    env = vector(4, imu="mems", gps={"heavy_tail_dof": 1.0, "vel_std_mps": 1e3, "pos_std_m": 1e6})
    for obs, *_ in play(env, actions_of(4, 25), seed=0):
        assert env.observation_space.contains(obs)


@pytest.mark.parametrize("imu", [*sorted(IMU_PRESETS), {"gyro_bias_deg_h": 3.0}], ids=str)
def test_the_sensors_leave_motion_and_fixes_as_they_were(imu):
    plain, other = (play(make(imu=i, reveal_truth=True), [IDENTITY] * 25, seed=7) for i in ("perfect", imu))
    for (obs, _, _, info), (obs1, _, _, info1) in zip(plain, other, strict=True):
        assert_array_equal(obs["gps_vel"], obs1["gps_vel"])
        assert_array_equal(obs["gps_pos"], obs1["gps_pos"])
        assert_array_equal(info["truth"]["q_nb"], info1["truth"]["q_nb"])
    assert_array_equal(plain[0][3]["start"]["q_nb"], other[0][3]["start"]["q_nb"])


def test_the_receiver_leaves_the_sensors_as_they_were():
    plain, other = (make(gps=g).reset(seed=7)[0] for g in ("thesis", {"contamination": 0.5, "rate_hz": 1.0}))
    assert_array_equal(plain["dtheta"], other["dtheta"])
    assert_array_equal(plain["dvel"], other["dvel"])


def test_render():
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    assert first.dtype == np.uint8
    assert first.shape == (480, 960, 3)
    for _ in range(5):
        env.step(np.full(4, np.nan))
    env.step(attitudes(seed=0)[6])
    second = env.render()
    assert second.std() > 10
    assert np.any(first != second)
    assert make().render() is None


def test_the_bound_that_render_draws():
    """docs/mathematics/bound.md#rules-of-thumb: 20.6 and 358 arcsec for 100 ug and 0.02 deg/h at 39.96 deg."""
    level, azimuth = np.degrees(sensor_floor(make().task)) * 3600
    assert level == pytest.approx(20.6, abs=0.1)
    assert azimuth == pytest.approx(358, abs=1)


def test_vibration_and_heading_reach_the_world():
    shaken, quiet = (make(vibration=v).reset(seed=0)[0]["dvel"] for v in (True, False))
    assert np.abs(shaken - quiet).max() > 1e-3
    headings = make(heading_deg=120.0, reveal_truth=True, env_id=STATIC).reset(seed=0)[1]["truth"]["q_nb"]
    assert np.degrees(attitude.to_euler(attitude.to_dcm(headings))[0]) == pytest.approx(120.0)
