"""Wrappers against independent oracles: SciPy's rotations and pymap3d's frames, a solver's own answers, and their statistics."""

import warnings

import gymnasium
import numpy as np
import pymap3d
import pytest
from gymnasium.utils.env_checker import check_env
from scipy.spatial.transform import Rotation

from sins_env import wrappers
from sins_env.evaluation.estimators import finding
from sins_env.recordings.axes import swap_ned, swap_ned_attitude
from sins_env.wrappers.frames import NorthEastDown

SWAY = {"id": "SINS/AlignSway-v0", "duration": 1.0, "n_sub": 2, "reveal_truth": True}
FLIGHT = {
    "id": "SINS/NavFlight-v0",
    "duration": 1.0,
    "reveal_truth": True,
    "aids": {"dvl": "bottom", "height": "bmp388"},
}


def made(rows=None, **kwargs):
    return gymnasium.make(**kwargs) if rows is None else gymnasium.make_vec(num_envs=rows, **kwargs)


def states(truth, navigate):
    return np.concatenate([truth["q_nb"], truth["vel"], truth["pos"]], axis=-1) if navigate else truth["q_nb"]


def test_ned_is_that_of_others():
    """The attitude of the FRD body in NED is that of pymap3d's axes and SciPy's rotations."""
    rng = np.random.default_rng(0)
    site = 40.0, 116.0, 50.0
    T = np.array(
        [pymap3d.geodetic2ned(*pymap3d.enu2geodetic(*axis, *site), *site) for axis in np.eye(3)]
    ).T  # columns: East, North and Up in NED
    v = rng.normal(size=(5, 3))
    assert np.allclose(swap_ned(v), v @ T.T, atol=1e-6)
    q = rng.normal(size=(5, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    turn = np.round(T)
    ours = Rotation.from_quat(swap_ned_attitude(q), scalar_first=True).as_matrix()
    assert np.allclose(ours, turn @ Rotation.from_quat(q, scalar_first=True).as_matrix() @ turn.T, atol=1e-15)
    yaw, pitch, roll = Rotation.from_quat(swap_ned_attitude(np.eye(4)[:1]), scalar_first=True).as_euler("ZYX")[0]
    assert (yaw, pitch, roll) == (0.0, 0.0, 0.0)  # level, towards north
    error = rng.normal(size=(6, 40))
    both = np.kron(np.eye(2), turn)
    assert np.allclose(NorthEastDown()._field("bridge_cov", np.cov(error)), np.cov(both @ error), atol=1e-14)
    for action in (q, np.hstack([q, v, v]), v, np.hstack([v, v, v])):
        assert np.array_equal(NorthEastDown().answer(NorthEastDown().answer(action)), action)


@pytest.mark.parametrize(("rows", "kwargs"), [(None, SWAY), (2, SWAY), (None, FLIGHT), (2, FLIGHT)])
def test_ned_says_the_same(rows, kwargs):
    """The true state in NED has no error, and a turned one has the same errors in other axes."""
    env, plain = wrappers.north_east_down(made(rows, **kwargs)), made(rows, **kwargs)
    seed = [1, 2][:rows] if rows else 1
    (obs, info), (there, told) = env.reset(seed=seed), plain.reset(seed=seed)
    navigate = plain.unwrapped.task.navigate
    for name in obs.keys() & {"dtheta", "dvel", "gps_vel", "dvl"}:
        assert np.array_equal(obs[name], there[name][..., [1, 0, 2]] * [1, 1, -1])
    for name in obs.keys() - {"dtheta", "dvel", "gps_vel", "dvl"}:
        assert np.array_equal(obs[name], there[name])
    assert env.observation_space.contains(obs)
    assert np.array_equal(info["start"]["q_nb"], told["start"]["q_nb"][..., [0, 2, 1, 3]] * [1, 1, 1, -1])
    action = states(info["start"], navigate)
    _, reward, *_, info = env.step(action)
    _, reward_there, *_, told = plain.step(states(told["start"], navigate))
    assert np.array_equal(reward, reward_there)
    for name, value in told["errors"].items():
        assert np.array_equal(info["errors"][name], value if name.startswith("_") else swap_ned(value))
    truth = NorthEastDown().answer(states(info["truth"], navigate))
    assert np.array_equal(truth, states(told["truth"], navigate))


@pytest.mark.parametrize("rows", [None, 2])
def test_corrections_of_a_solver(rows):
    """Zero leaves the solver's answer; one turns it by the scale; the solver goes on with its own."""
    env = wrappers.corrections(made(rows, **SWAY), "ekf", scale=(1e-3, 2e-3, 3e-3))
    plain, solver = made(rows, **SWAY), finding.make("ekf")
    seed = [5, 6][:rows] if rows else 5
    env.reset(seed=seed)
    obs, _ = plain.reset(seed=seed)
    rng = np.random.default_rng(0)
    solver.reset(plain.unwrapped.task, [rng] * rows if rows else rng, rows or 1)
    for k in range(10):
        action = np.zeros(env.action_space.shape, np.float32)
        action[..., 2] = k % 2
        q = solver.step(obs)
        _, reward, *_, info = env.step(action)
        obs, expected, *_, told = plain.step(q)
        if k % 2:
            turned = info["errors"]["phi"] - told["errors"]["phi"]
            assert np.allclose(np.linalg.norm(turned, axis=-1), 3e-3, rtol=2e-2)
        else:
            assert np.allclose(reward, expected, rtol=1e-9, atol=1e-9)
    if rows:  # the step after the end begins anew, for solver and world
        env.step(env.action_space.sample())
        plain.step(q)
        assert env.translation._seen == 1


def test_corrections_of_the_last_answer():
    """The told start is the first answer; a navigator's velocity and place move by metres."""
    env = wrappers.corrections(made(**FLIGHT), scale=np.repeat([1e-3, 2.0, 30.0], 3))
    _, info = env.reset(seed=3)
    start = np.concatenate([info["start"][name] for name in ("q_nb", "vel", "pos")])
    assert np.array_equal(env.translation.answer(np.zeros(9)), start)
    moved = env.translation.answer(np.array([0.0, 0, 0, 1, 0, 0, 0, 1, 1]))
    assert np.allclose(moved[4:7] - start[4:7], [2.0, 0, 0])
    lat, lon = np.degrees(start[7:9])
    assert np.allclose(
        pymap3d.geodetic2enu(*np.degrees(moved[7:9]), moved[9], lat, lon, start[9]), [0, 30, 30], atol=1e-2
    )
    again = env.translation.answer(np.array([0.0, 0, 0, 1, 0, 0, 0, 0, 0]))
    assert again[4] == pytest.approx(start[4] + 4.0)


@pytest.mark.parametrize("kwargs", [SWAY, FLIGHT])
def test_scaled_observations_are_of_order_one(kwargs):
    env = wrappers.scaled(wrappers.north_east_down(made(3, **kwargs)), {"gps_vel": 0.5})
    plain = made(3, **kwargs)
    obs, _ = env.reset(seed=11)
    there, _ = plain.reset(seed=11)
    assert np.allclose(obs["gps_vel"] * 0.5, swap_ned(there["gps_vel"]), rtol=1e-6)
    seen = []
    for _ in range(10):
        assert env.observation_space.contains(obs)
        seen.append(obs)
        obs, *_ = env.step(env.action_space.sample() * 0 + 0.1)
    for name in seen[0].keys() - {"gps_vel", "t"}:
        values = np.concatenate([one[name].ravel() for one in seen])
        rms = np.sqrt(np.mean(np.square(values[values != 0])))
        assert 0.3 < rms < 3.0, name
    assert seen[-1]["t"][0, 0] == 1.0


@pytest.mark.parametrize(
    "wrap",
    [
        wrappers.north_east_down,
        wrappers.scaled,
        lambda env: wrappers.corrections(env, "ckf"),
        lambda env: wrappers.scaled(wrappers.north_east_down(wrappers.corrections(env))),
    ],
    ids=["ned", "scaled", "corrections", "all"],
)
def test_gymnasiums_checker_is_content(wrap):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings(
            "ignore", message=".*(not within the observation space|check_env.*unwrapped|different from the).*"
        )
        check_env(wrap(made(**SWAY)), skip_render_check=True)


def test_what_is_refused():
    env = made(**SWAY)
    with pytest.raises(ValueError, match="allowed: one of SINS/"):
        wrappers.north_east_down(gymnasium.make("CartPole-v1"))
    with pytest.raises(
        ValueError, match="Corrections around NorthEastDown; allowed, from the inside out and each once"
    ):
        wrappers.corrections(wrappers.north_east_down(env))
    with pytest.raises(ValueError, match="did you mean 'gps_vel'"):
        wrappers.scaled(env, {"gps_ve": 1.0})
    with pytest.raises(ValueError, match="3 positive numbers, rad, m/s and m"):
        wrappers.corrections(env, scale=(1.0, 2.0))
    with pytest.raises(ValueError, match="without a solver none"):
        wrappers.corrections(env, settings={"model": "nine"})
    with pytest.raises(ValueError, match="a dict of scales"):
        wrappers.scaled(env, [1.0])


@pytest.mark.parametrize("rows", [None, 2])
def test_actions_that_are_refused_change_nothing(rows):
    """No action is stretched to a shape, and no NaN stays in an estimate that goes on."""
    env, untouched = (wrappers.north_east_down(wrappers.corrections(made(rows, **SWAY))) for _ in range(2))
    shape = env.action_space.shape
    for one in (env, untouched):
        one.reset(seed=3)
    for action, text in [
        (np.zeros(1), "action of shape"),
        (np.zeros((*shape, 1)), "action of shape"),
        (np.full(shape, np.nan), "finite"),
    ]:
        with pytest.raises(ValueError, match=text):
            env.step(action)
    assert np.all(env.step(np.zeros(shape))[1] == untouched.step(np.zeros(shape))[1])
