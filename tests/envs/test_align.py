import dataclasses
import functools

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.testing import assert_allclose, assert_array_equal

from sins_env import attitude
from sins_env.envs import register
from sins_env.envs.rendering import sensor_floor
from sins_env.specs import IMU_PRESETS

SWAY, STATIC = "SINS/AlignSway-v0", "SINS/AlignStatic-v0"
SHORT = {"duration": 2.5}  # more than two chunks of ten epochs
ONE_SECOND_UNKNOWN = {"start": "unknown", "coarse": 0.5, "duration": 1.0}
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def make(env_id=SWAY, **settings):
    return gymnasium.make(env_id, **{**SHORT, **settings}).unwrapped


def vector(num_envs, env_id=SWAY, **settings):
    return gymnasium.make_vec(env_id, num_envs, **{**SHORT, **settings})


def actions_of(rows, steps, seed=0):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, rows, 4))


def play(env, actions, seed):
    """(obs, reward, over, info) of reset and of every step."""
    obs, info = env.reset(seed=seed)
    course = [(obs, None, False, info)]
    for action in actions:
        obs, reward, terminated, truncated, info = env.step(action)
        assert not np.any(terminated)
        course.append((obs, reward, truncated, info))
    return course


def leaves(nest, path=()):
    """(path, value) of a nest of dicts without its masks."""
    for key, value in nest.items():
        if key.startswith("_"):
            continue
        if isinstance(value, dict):
            yield from leaves(value, (*path, key))
        else:
            yield (*path, key), value


def assert_row_equals(course, row, single):
    for (obs, reward, over, info), (obs1, reward1, over1, info1) in zip(course, single, strict=True):
        for key in obs1:
            assert_array_equal(obs[key][row], obs1[key], err_msg=key)
        if reward1 is not None:
            assert reward[row] == reward1
            assert over[row] == over1
        wanted = dict(leaves(info1))
        found = dict(leaves(info))
        assert found.keys() == wanted.keys()
        for path, value in wanted.items():
            assert_array_equal(found[path][row], value, err_msg=str(path))


VARIANTS = {
    "white": {},
    "markov": {"imu": "thesis-markov", "prior": "thesis"},
    "random": {"motion": "random", "heading_deg": None, "imu": "tactical"},
    "vibration": {"vibration": True, "imu": "mems", "gps": {"contamination": 0.2, "heavy_tail_dof": 4.0}},
    "rlg": {
        "imu": "rlg-car",
        "n_sub": 10,
        "gps": {"rate_hz": 2.0, "lever_arm_m": [0.5, -1, 2], "jump_mps": 1, "jump_s": 1},
    },
    "unknown": {"start": "unknown", "coarse": 0.5, "imu": "navigation", "heading_deg": None},
    "static": {"env_id": STATIC, "latitude_deg": -60.0, "earth": "thesis"},
    "fixed": {"misalignment_deg": [1, 1, 10], "imu": "perfect", "gps": "perfect"},
}


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("rows", [1, 2, 7, 64])
def test_a_row_equals_the_single_environment_bit_for_bit(variant, rows):
    settings = {**VARIANTS[variant], "reveal_truth": True}
    steps = actions_of(rows, 25)
    course = play(vector(rows, **settings), steps, seed=5)
    single = make(**settings)
    for row in {0, rows // 2, rows - 1}:
        assert_row_equals(course, row, play(single, steps[:, row], seed=5 + row))


def test_a_list_of_seeds_is_taken_as_it_is():
    seeds = [100, 3, 3, 77]
    steps = actions_of(1, 25)
    course = play(vector(4), np.repeat(steps, 4, axis=1), seed=seeds)
    for row, seed in enumerate(seeds):
        assert_row_equals(course, row, play(make(), steps[:, 0], seed=seed))
    assert_array_equal(course[3][0]["dtheta"][1], course[3][0]["dtheta"][2])


def test_later_resets_go_on_drawing_and_rows_agree():
    batch, single = vector(3), make()
    batch.reset(seed=8)
    single.reset(seed=9)
    again, alone = batch.reset()[0], single.reset()[0]
    assert_array_equal(again["dtheta"][1], alone["dtheta"])
    assert np.any(alone["dtheta"] != make().reset(seed=9)[0]["dtheta"])


def test_mixed_seeds_keep_the_rows_without_one():
    batch, single = vector(3), make()
    batch.reset(seed=8)
    single.reset(seed=9)
    obs, _ = batch.reset(seed=[1, None, 2])
    assert_array_equal(obs["dvel"][1], single.reset()[0]["dvel"])
    assert_array_equal(obs["dvel"][0], make().reset(seed=1)[0]["dvel"])


@pytest.mark.parametrize("seeds", [[1, 2], [1, 2, 3, 4]])
def test_wrong_number_of_seeds(seeds):
    with pytest.raises(ValueError, match=rf"{len(seeds)} seeds; allowed: one int, or 3 seeds"):
        vector(3).reset(seed=seeds)


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


@pytest.mark.parametrize("env_id", [SWAY, STATIC])
def test_the_truth_scores_full_marks(env_id):
    env = make(env_id, reveal_truth=True)
    _, info = env.reset(seed=2)
    previous = info["truth"]["q_nb"]
    for _ in range(25):
        truth = env.episode._truth.q_nb[0]
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
    computed = attitude.multiply(attitude.misalignment_quaternion(phi), env.episode._truth.q_nb[0])
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


def test_next_step_autoreset():
    env = vector(2)
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    actions = np.tile(IDENTITY, (2, 1))
    course = play(env, [actions] * 25, seed=4)
    assert course[-1][2].all()
    obs, reward, terminated, truncated, info = env.step(np.full((2, 4), np.nan))  # ignored: this step resets
    assert_array_equal(reward, 0.0)
    assert not (terminated | truncated).any()
    assert "start" in info
    assert "failed" not in info
    assert_allclose(obs["t"], 0.1)
    assert np.any(obs["dtheta"] != course[0][0]["dtheta"])
    single = make()
    play(single, [IDENTITY] * 25, seed=5)
    assert_array_equal(obs["dtheta"][1], single.reset()[0]["dtheta"])
    assert env.step(actions)[1].all()


@pytest.mark.parametrize("settings", [{}, {"reveal_truth": True}, ONE_SECOND_UNKNOWN], ids=str)
def test_infos_are_those_of_gymnasiums_own_vector_environment(settings):
    """Keys, masks, shapes, types and values, over an episode and its autoreset."""
    native = vector(3, **settings)
    assembled = SyncVectorEnv(
        [functools.partial(make, **settings)] * 3, autoreset_mode=AutoresetMode.NEXT_STEP
    )
    steps = actions_of(3, native.unwrapped.task.num_epochs + 2)

    def compare(found, wanted, path=""):
        assert found.keys() == wanted.keys(), path
        for key, value in wanted.items():
            if isinstance(value, dict):
                compare(found[key], value, f"{path}/{key}")
            else:
                assert_array_equal(found[key], value, err_msg=f"{path}/{key}")
                assert found[key].dtype == value.dtype, f"{path}/{key}"

    for left, right in zip(play(native, steps, seed=3), play(assembled, steps, seed=3), strict=True):
        compare(left[0], right[0])
        compare(left[3], right[3])
        assert_array_equal(left[1], right[1])
        assert_array_equal(left[2], right[2])


@pytest.mark.parametrize("rows", [None, 3])
def test_arrays_are_fresh_every_time(rows):
    env = make(reveal_truth=True) if rows is None else vector(rows, reveal_truth=True)
    actions = [IDENTITY if rows is None else np.tile(IDENTITY, (rows, 1))] * 25
    kept = play(env, actions, seed=6)
    spoilt_env = make(reveal_truth=True) if rows is None else vector(rows, reveal_truth=True)
    obs, info = spoilt_env.reset(seed=6)
    for k, action in enumerate(actions, start=1):
        for array in [*obs.values(), *(v for _, v in leaves(info) if isinstance(v, np.ndarray))]:
            array.fill(0)  # whatever a client does to what it was given
        obs, reward, _, _, info = spoilt_env.step(action)
        assert_array_equal(reward, kept[k][1])
        for key in obs:
            assert_array_equal(obs[key], kept[k][0][key])
        for (path, value), (_, wanted) in zip(leaves(info), leaves(kept[k][3]), strict=True):
            assert_array_equal(value, wanted, err_msg=str(path))


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


@pytest.mark.parametrize("phi", [(1.0, 1.0, 10.0), (-3.0, 2.0, 170.0), (0.0, 0.0, 0.0)])
def test_told_start_has_the_misalignment_asked_for(phi):
    env = vector(5, misalignment_deg=phi, heading_deg=None, reveal_truth=True)
    _, info = env.reset(seed=0)
    found = attitude.misalignment(info["start"]["q_nb"], info["truth"]["q_nb"])
    assert_allclose(found, np.tile(np.radians(phi), (5, 1)), atol=1e-13)


def test_told_start_is_drawn_from_the_matched_prior():
    rows = 2000
    env = vector(rows, reveal_truth=True)
    _, info = env.reset(seed=0)
    P0 = env.unwrapped.task.prior.P0
    phi = attitude.misalignment(info["start"]["q_nb"], info["truth"]["q_nb"])
    dv = info["start"]["vel"] - info["truth"]["vel"]
    errors = np.concatenate([phi, dv], axis=1)
    sigma = np.sqrt(np.diag(P0)[:6])
    assert_allclose(sigma, [*np.radians([1, 1, 15]), 0.2, 0.2, 0.2])
    assert np.all(np.abs(errors.std(axis=0) / sigma - 1) < 3 / np.sqrt(2 * rows))
    assert np.all(np.abs(errors.mean(axis=0)) < 3 * sigma / np.sqrt(rows))
    assert np.abs(np.corrcoef(errors.T) - np.eye(6)).max() < 4 / np.sqrt(rows)


def test_sensor_errors_are_drawn_from_the_matched_prior():
    """The mean increments of a still base less the truth are bias and averaged noise."""
    rows = 2000
    env = vector(rows, STATIC, imu={"gyro_bias_deg_h": 0.02, "accel_bias_ug": 100.0}, duration=0.3)
    perfect = vector(1, STATIC, imu="perfect", duration=0.3)
    obs, truth = env.reset(seed=0)[0], perfect.reset(seed=0)[0]
    P0 = np.diag(env.unwrapped.task.prior.P0)
    for key, variance in (("dtheta", P0[9:12]), ("dvel", P0[12:15])):
        bias = (obs[key] - truth[key]).sum(axis=1) / 0.1
        assert np.all(np.abs(bias.std(axis=0) / np.sqrt(variance) - 1) < 3 / np.sqrt(2 * rows))


def test_fixes_are_drawn_from_the_told_noise():
    env = vector(700, STATIC, duration=0.5)
    fixes = [c[0]["gps_vel"] for c in play(env, actions_of(700, 4), seed=0)]
    std = np.sqrt(np.diag(env.unwrapped.task.prior.R)[:3])
    assert_allclose(std, 0.1)
    assert np.all(np.abs(np.std(fixes, axis=(0, 1)) / std - 1) < 3 / np.sqrt(2 * 3500))


def test_told_process_noise_and_thesis_prior():
    matched, thesis = (make(imu="thesis-white", prior=p).task.prior for p in ("matched", "thesis"))
    arw, vrw = np.radians(0.01) / 60, 5e-6 * 9.80665
    assert_allclose(np.diag(matched.Q)[:6] / 0.1, [*[arw**2] * 3, *[vrw**2] * 3], rtol=1e-9)
    step = [np.radians(0.01 / 3600) ** 2] * 3 + [(5e-4 * 9.80665) ** 2] * 3  # added 100 times a second
    assert_allclose(np.diag(thesis.Q)[:6], 10 * np.array(step), rtol=1e-9)
    assert_allclose(np.diag(thesis.R)[:3], 0.01)
    markov = make(imu="thesis-markov").task.prior
    assert markov.gyro_bias_std_deg_h == pytest.approx(np.hypot(0.02, 0.1))
    assert markov.accel_bias_std_ug == pytest.approx(np.hypot(100, 100))


@pytest.mark.parametrize("rows", [None, 3])
def test_task_start_is_the_start_of_info(rows):
    env = make() if rows is None else vector(rows)
    before = env.unwrapped.task
    _, info = env.reset(seed=0)
    start = env.unwrapped.task.start
    for name in ("q_nb", "vel", "pos"):
        assert_array_equal(getattr(start, name), info["start"][name])
        assert getattr(start, name).shape == (() if rows is None else (3,)) + (
            (4,) if name == "q_nb" else (3,)
        )
    assert np.all(info["start"]["known"])
    assert before.start is None
    assert dataclasses.replace(env.unwrapped.task, start=None) == before


@pytest.mark.parametrize("rows", [None, 3])
def test_unknown_start(rows):
    env = make(**ONE_SECOND_UNKNOWN) if rows is None else vector(rows, **ONE_SECOND_UNKNOWN)
    _, info = env.reset(seed=0)
    task = env.unwrapped.task
    assert task.start is None
    assert task.coarse_s == 0.5
    assert not np.any(info["start"]["known"])
    assert_array_equal(np.atleast_2d(info["start"]["q_nb"])[0], IDENTITY)
    assert_array_equal(np.atleast_2d(info["start"]["vel"])[0], 0.0)
    assert_array_equal(np.atleast_2d(info["start"]["pos"])[0], task.site.pos)
    assert_allclose(task.prior.attitude_std_deg, (0.1, 0.1, 2.0))


def test_surprises_are_not_told():
    gps = {"outages_s": [[1.0, 2.0]], "jump_mps": 1.0, "jump_s": 1.0, "contamination": 0.1}
    told = make(gps=gps).task.gps
    assert told.outages_s == ()
    assert told.jump_mps == 0.0
    assert told.contamination == 0.1


def test_nothing_of_the_truth_is_in_the_info_unless_asked():
    for obs, _, _, info in play(make(), [IDENTITY] * 3, seed=0):
        assert "truth" not in info
        assert "truth" not in obs


BAD = [
    ({"imuu": "mems"}, "unknown setting of the environment 'imuu'; did you mean 'imu'"),
    ({"imu": "mens"}, "unknown IMU preset 'mens'; did you mean 'mems'"),
    ({"imu": {"gyro_bias": 1.0}}, "unknown setting of ImuSpec 'gyro_bias'; did you mean 'gyro_bias_deg_h'"),
    ({"imu": {"preset": "mens"}}, "did you mean 'mems'"),
    ({"imu": {"arw_deg_sqrt_h": -1.0}}, "ImuSpec.arw_deg_sqrt_h = -1.0; allowed: finite and not negative"),
    ({"imu": {"gyro_markov_s": 0.0}}, "allowed: a positive correlation time"),
    ({"imu": 3}, "IMU preset: 3; allowed: a preset's name"),
    ({"gps": "thesys"}, "unknown GPS preset 'thesys'; did you mean 'thesis'"),
    ({"gps": {"rate": 1.0}}, "unknown setting of GpsSpec 'rate'; did you mean 'rate_hz'"),
    ({"gps": {"rate_hz": 3.0}}, "GPS rate 3 Hz with epochs of 0.1 s"),
    ({"gps": {"vel_std_mps": [1, 2]}}, "allowed: one number or three"),
    ({"start": "tolt"}, "unknown start 'tolt'; did you mean 'told'"),
    ({"prior": "mached"}, "unknown prior 'mached'; did you mean 'matched'"),
    ({"motion": "randm"}, "unknown motion 'randm'; did you mean 'random'"),
    ({"earth": "wgs-84"}, "unknown earth model 'wgs-84'; did you mean 'wgs84'"),
    ({"latitude_deg": 89.95}, "latitude 89.95 deg; allowed: -89.9 to 89.9"),
    ({"latitude_deg": float("nan")}, "allowed: -89.9 to 89.9"),
    ({"heading_deg": float("inf")}, "heading_deg = inf; allowed"),
    ({"duration": 0.25}, "duration = 0.25 s with epochs of 0.1 s; allowed: a whole number of epochs"),
    ({"duration": 0.2}, "at least 3, for instance 0.3 s"),
    ({"duration": -5.0}, "allowed: a whole number of epochs"),
    ({"duration": float("nan")}, "allowed: a whole number of epochs"),
    ({"epoch": 0.0}, "epoch = 0.0; allowed: a positive number"),
    ({"epoch": float("nan")}, "epoch = nan; allowed: a positive number"),
    ({"n_sub": 0}, "n_sub = 0; allowed: a whole number of IMU samples"),
    ({"n_sub": 2.5}, "n_sub = 2.5; allowed"),
    ({"n_sub": float("nan")}, "n_sub = nan; allowed"),
    ({"n_sub": True}, "n_sub = True; allowed"),
    ({"coarse": 1.0}, "coarse = 1.0 with start = 'told'; allowed: 0"),
    ({"start": "unknown", "coarse": 2.5}, "allowed: coarse shorter than the duration"),
    ({"start": "unknown", "coarse": -1.0}, "coarse = -1.0"),
    (
        {"start": "unknown", "coarse": 1.0, "misalignment_deg": [1, 1, 1]},
        "misalignment_deg with start = 'unknown'",
    ),
    ({"misalignment_deg": [1, 1]}, "allowed: three finite numbers"),
    ({"misalignment_deg": [1, 1, float("nan")]}, "allowed: three finite numbers"),
    ({"misalignment_deg": 5.0}, "allowed: three finite numbers"),
    ({"misalignment_deg": "abc"}, "allowed: three finite numbers"),
    ({"render_mode": "ansi"}, "unknown render_mode 'ansi'; Allowed: rgb_array"),
    ({"vibration": "no"}, "vibration = 'no'; allowed: True or False"),
    ({"duration": "long"}, "duration = 'long'; allowed"),
    ({"epoch": "0.1"}, "epoch = '0.1'; allowed"),
    ({"latitude_deg": "north"}, "latitude_deg = 'north'; allowed"),
    ({"heading_deg": "north"}, "heading_deg = 'north'; allowed"),
    ({"imu": {"arw_deg_sqrt_h": "small"}}, "ImuSpec.arw_deg_sqrt_h = 'small'; allowed"),
    ({"gps": {"rate_hz": "fast"}}, "GpsSpec.rate_hz = 'fast'; allowed"),
]


@pytest.mark.filterwarnings("ignore:.*not in the possible render_modes.*:UserWarning")
@pytest.mark.parametrize("env_id", [SWAY, STATIC])
@pytest.mark.parametrize(("settings", "message"), BAD, ids=lambda v: str(v) if isinstance(v, dict) else "")
def test_bad_settings_are_one_clear_error(env_id, settings, message):
    with pytest.raises(ValueError) as error:  # noqa: PT011  the message is compared below
        make(env_id, **settings)
    assert message in str(error.value)


@pytest.mark.parametrize("num_envs", [0, -1])
def test_bad_number_of_environments(num_envs):
    with pytest.raises(ValueError, match=f"num_envs = {num_envs}; allowed: at least 1"):
        vector(num_envs)


def test_render():
    env = make(render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    assert first.dtype == np.uint8
    assert first.shape == (480, 960, 3)
    for _ in range(5):
        env.step(np.full(4, np.nan))
    env.step(env.episode._truth.q_nb[0])
    second = env.render()
    assert second.std() > 10
    assert np.any(first != second)
    assert make().render() is None


def test_render_of_a_batch_is_its_first_row():
    env, single = vector(2, render_mode="rgb_array"), make(render_mode="rgb_array")
    env.reset(seed=0)
    single.reset(seed=0)
    action = np.array([0.9, 0.1, 0.2, 0.3])
    env.step(np.stack([action, -action]))
    single.step(action)
    assert_array_equal(env.render()[0], single.render())


def test_the_bound_that_render_draws():
    """equations.md G: 20.6 and 358 arcsec for 100 ug and 0.02 deg/h at 39.96 deg."""
    level, azimuth = np.degrees(sensor_floor(make().task)) * 3600
    assert level == pytest.approx(20.6, abs=0.1)
    assert azimuth == pytest.approx(358, abs=1)


def test_vibration_and_heading_reach_the_world():
    shaken, quiet = (make(vibration=v).reset(seed=0)[0]["dvel"] for v in (True, False))
    assert np.abs(shaken - quiet).max() > 1e-3
    headings = make(heading_deg=120.0, reveal_truth=True, env_id=STATIC).reset(seed=0)[1]["truth"]["q_nb"]
    assert np.degrees(attitude.to_euler(attitude.to_dcm(headings))[0]) == pytest.approx(120.0)
