"""A start of unknown attitude without a coarse phase: the level, runs whose first fixes differ, a drive that begins in motion."""

import dataclasses

import gymnasium
import numpy as np
import pytest

import sins_env  # noqa: F401
import solvers
from sins_env import attitude, earth
from sins_env.types import NavState
from solvers.pipeline import switch_on
from solvers.pipeline.strapdown import Strapdown, StrapdownState

SETTINGS = {
    "SINS/AlignSway-v0": {"duration": 6.0, "n_sub": 3},
    "SINS/AlignVehicle-v0": {"duration": 6.0},
    "SINS/NavFlight-v0": {"profile": "hotstart60", "duration": 6.0, "imu": "mems"},
}


def test_level_from_the_force_of_an_epoch():
    rng = np.random.default_rng(1)
    heading, pitch, roll = rng.uniform(-1.0, 1.0, (3, 20))
    force = attitude.to_dcm(attitude.from_euler(heading, pitch, roll)).mT @ [0.0, 0.0, 9.8]
    q_nb = switch_on.level({"dvel": np.repeat(0.01 * force[:, None], 10, axis=1)})
    found = attitude.to_euler(attitude.to_dcm(q_nb))
    np.testing.assert_allclose(found, [np.zeros(20), pitch, roll], atol=1e-12)
    np.testing.assert_array_equal(switch_on.level({"dvel": np.zeros((3, 3))}), [1.0, 0.0, 0.0, 0.0])


def record(env_id, runs, epochs, **settings):
    env = gymnasium.make_vec(env_id, num_envs=runs, start="unknown", coarse=0.0, **settings)
    obs, _ = env.reset(seed=3)
    task, seen = env.unwrapped.task, []
    for _ in range(epochs):
        seen.append({key: value.copy() for key, value in obs.items()})
        obs, *_ = env.step(np.tile(np.eye(10 if task.navigate else 4)[0], (runs, 1)))
    return task, seen


@pytest.mark.parametrize("env_id", SETTINGS)
@pytest.mark.parametrize("name", ["ckf", "gsf_ekf", "gsf_imm"])
def test_each_run_begins_at_its_own_first_fix(env_id, name):
    """In a batch as alone; before, the answer is the level. A single filter aligns in flight by itself."""
    if (env_id, name) == ("SINS/NavFlight-v0", "ckf"):
        pytest.skip("see tests/solvers/pipeline/coarse/test_in_motion.py")
    task, seen = record(env_id, 2, 14, **SETTINGS[env_id])
    first = (3, 8)
    for k, obs in enumerate(seen, start=1):
        for run, begin in enumerate(first):
            obs["gps_valid"][run] &= k >= begin
    rngs = [np.random.default_rng(i) for i in range(2)]
    together = solvers.make(name)
    together.reset(task, rngs, 2)
    answers = np.array([together.step(obs) for obs in seen])
    for run, begin in enumerate(first):
        alone = solvers.make(name)
        alone.reset(task, np.random.default_rng(0), 1)
        mine = [{key: value[run] for key, value in obs.items()} for obs in seen]
        own = np.array([alone.step(obs) for obs in mine])
        np.testing.assert_allclose(answers[:, run], own, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(
            own[: begin - 1, :4], [switch_on.level(obs) for obs in mine[: begin - 1]], atol=1e-15
        )
        np.testing.assert_allclose(together.covariance()[run], alone.covariance(), rtol=1e-6, atol=1e-14)
        assert alone.health().failed_at == -1


def test_two_passes_need_a_start():
    env = gymnasium.make("SINS/AlignSway-v0", start="unknown", coarse=0.0, duration=6.0)
    env.reset(seed=0)
    with pytest.raises(ValueError, match="unknown start and coarse = 0; allowed: a told start, or a coarse phase"):
        solvers.make("two_pass").reset(env.unwrapped.task, None)


def test_a_drive_that_begins_in_motion():
    """A car at 15 m/s that turns after 10 s: heading to 2 deg after 25 s, as far as its covariance says."""
    turn = {"duration_s": 10.0, "heading_rate_deg_s": 9.0}
    plan = {
        "latitude_deg": 40.0,
        "longitude_deg": 10.0,
        "speed_mps": 15.0,
        "heading_deg": 200.0,
        "segments": [{"duration_s": 10.0}, turn, {"duration_s": 20.0}],
    }
    env = gymnasium.make_vec(
        "SINS/NavFlight-v0", num_envs=4, start="unknown", profile=plan, imu="mems", gps={"rate_hz": 10.0}, duration=25.0
    )
    obs, _ = env.reset(seed=5)
    solver = solvers.make("gsf_imm")
    solver.reset(env.unwrapped.task, None, 4)
    for _ in range(250):
        obs, _, _, _, info = env.step(solver.step(obs))
    heading = info["errors"]["phi"][:, 2]
    sigma = np.sqrt(solver.covariance()[:, 2, 2])
    assert (np.abs(heading) < np.radians(2.0)).all()
    assert (np.abs(heading) < 4.0 * sigma).all()


def test_a_coarse_phase_is_filtered_again():
    """As if the attitude that it found had been told at the first fix, with a heading as wide as ten times its error."""
    settings = SETTINGS["SINS/AlignSway-v0"]
    task, seen = record("SINS/AlignSway-v0", 2, 60, **settings)
    prior = dataclasses.replace(task.prior, attitude_std_deg=(0.1, 0.1, 2.0))
    task = dataclasses.replace(task, coarse_s=4.0, coarse_told=True, prior=prior)
    for k, obs in enumerate(seen, start=1):
        obs["gps_valid"][:, 0] &= k >= np.array([3, 8])
    solver, plain = (solvers.make("inekf", coarse_again=again) for again in (True, False))
    answers = []
    for one in (solver, plain):
        one.reset(task, None, 2)
        answers.append(np.array([one.step(obs) for obs in seen]))
    np.testing.assert_array_equal(answers[0][:39], answers[1][:39])
    again = switch_on.second_pass(task, seen[:40], answers[1][39], None)
    np.testing.assert_array_equal(again.q_nb[-1], answers[1][39])
    heading = np.sqrt(again.P0[:, 2, 2])
    np.testing.assert_allclose(heading, np.radians(20.0))
    for run, first in enumerate((3, 8)):
        start = NavState(again.q_nb[first - 1][run], seen[first - 1]["gps_vel"][run], task.site.pos)
        prior = dataclasses.replace(
            switch_on.switch_on_prior(task.prior), attitude_std_deg=(3.0, 3.0, np.degrees(heading[run]))
        )
        alone = solvers.make("inekf")
        alone.reset(dataclasses.replace(task, coarse_s=0.0, start=start, prior=prior), None, 1)
        own = [alone.step({key: value[run] for key, value in obs.items()}) for obs in seen[first:]]
        np.testing.assert_allclose(answers[0][39:, run], own[39 - first :], atol=1e-12)


def test_the_gyros_carry_an_attitude_back():
    """The strapdown, from the first attitude, leads to the last."""
    task, seen = record("SINS/AlignSway-v0", 2, 30, **SETTINGS["SINS/AlignSway-v0"])
    q = attitude.from_euler(np.array([0.3, -2.0]), np.array([0.1, 0.0]), np.array([0.0, 0.2]))
    back = switch_on.carried_back(task, seen, q)
    strapdown = Strapdown(earth.get(task.site.earth), task.epoch_s, task.n_sub, task.site.pos, hold_position=True)
    state = StrapdownState(NavState(back[0], np.zeros((2, 3)), np.tile(task.site.pos, (2, 1))), None)
    for obs, expected in zip(seen[1:], back[1:], strict=True):
        state, _ = strapdown.advance(
            state._replace(nav=state.nav._replace(vel=np.zeros((2, 3)))), obs["dtheta"], obs["dvel"]
        )
        np.testing.assert_allclose(state.nav.q_nb, expected, atol=1e-7)
