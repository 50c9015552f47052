"""A native batch is the single environment many times, bit for bit, in Gymnasium's own layout."""

import functools
import tracemalloc

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv
from numpy.testing import assert_allclose, assert_array_equal
from oracles.courses import IDENTITY, ONE_SECOND_UNKNOWN, STATIC, VEHICLE, actions_of, leaves, make, play, vector


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
    "headings": {"heading_deg": [0.0, 45.0, 90.0]},
    "vehicle": {"env_id": VEHICLE, "coarse": 0.5, "events": "mixed", "event_rate_per_min": 60.0, "gps": "dgps"},
    "any heading": {"any_heading": True, "prior": "thesis"},
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


#: More than one block of runs, and epochs longer than a chunk of samples.
LONG = {
    "motion": "random",
    "vibration": True,
    "epoch": 1.0,
    "n_sub": 300,
    "duration": 3.0,
    "gps": {"rate_hz": 1.0},
}


def test_rows_of_other_blocks_equal_the_single_environment_bit_for_bit():
    rows, steps = 45, actions_of(45, 3)
    course = play(vector(rows, **LONG, reveal_truth=True), steps, seed=5)
    for row in (0, 15, 16, 17, 18, 33, 34, 35, 44):
        assert_row_equals(course, row, play(make(**LONG, reveal_truth=True), steps[:, row], seed=5 + row))


def test_memory_of_long_epochs():
    """4.1 GiB when ten epochs of every run's integrals existed at once."""
    env = vector(256, **LONG)
    tracemalloc.start()
    play(env, np.tile(IDENTITY, (3, 256, 1)), seed=0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 100e6  # measured: 39 MiB


@pytest.mark.parametrize(("n_sub", "epochs"), [(1, 300), (7, 42), (30, 10), (300, 1), (301, 1)])
def test_a_chunk_is_a_number_of_samples(n_sub, epochs):
    world = make(n_sub=n_sub, duration=60.0).episode.world
    asked, chunk = [], world.trajectory.chunk
    world.trajectory.chunk = lambda first, count: (asked.append((first, count)), chunk(first, count))[1]
    world.reset([np.random.default_rng(0)], {})
    world.epoch(1)
    assert asked == [(0, epochs)]


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
    assembled = SyncVectorEnv([functools.partial(make, **settings)] * 3, autoreset_mode=AutoresetMode.NEXT_STEP)
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
    for obs, _, _, info in kept:  # no views of the world's memory
        given = [*obs.values(), *(v for path, v in leaves(info) if path[0] == "truth")]
        assert all(array.flags.owndata for array in given)
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


@pytest.mark.parametrize(
    "seed", [3.5, "3", True, -1, {}, [1.5, 2, 3], [1, -2, 3], [1, "2", 3], np.ones(3), [[1], [2, 3], 4]], ids=repr
)
def test_bad_seeds(seed):
    with pytest.raises(ValueError) as error:  # noqa: PT011  the message is compared below
        vector(3).reset(seed=seed)
    message = str(error.value)
    assert message == f"seed = {seed!r}; allowed: None, a whole number from 0 on, or a list of 3 of them"


@pytest.mark.parametrize("seed", [np.int64(4), np.arange(4, 7), (4, np.uint8(5), 6)], ids=repr)
def test_seeds_of_numpy(seed):
    wanted, found = (vector(3).reset(seed=s)[0]["dtheta"] for s in (4, seed))
    assert_array_equal(found, wanted)


@pytest.mark.parametrize("num_envs", [0, -1, 2.5])
def test_bad_number_of_environments(num_envs):
    with pytest.raises(ValueError, match=f"num_envs = {num_envs}; allowed: at least 1"):
        vector(num_envs)


def test_render_of_a_batch_is_its_first_row():
    env, single = vector(2, render_mode="rgb_array"), make(render_mode="rgb_array")
    env.reset(seed=0)
    single.reset(seed=0)
    action = np.array([0.9, 0.1, 0.2, 0.3])
    env.step(np.stack([action, -action]))
    single.step(action)
    assert_array_equal(env.render()[0], single.render())
