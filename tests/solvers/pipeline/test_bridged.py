"""Gaps that are bridged: what an epoch is told of them, and what filters, the bank and coarse alignment make of it."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from oracles.replays import make, play, stacked, vector

import solvers
from sins_env import attitude, earth
from sins_env.recordings import Gnss, Recording, Reference, bridged
from sins_env.states import ERRORS
from sins_env.types import NavState
from solvers.pipeline import coarse
from solvers.pipeline.errors.alignment import AlignmentErrors
from solvers.pipeline.errors.navigation import NavigationErrors
from solvers.pipeline.strapdown import Strapdown

GPS = {"vel_std_mps": 0.1, "pos_std_m": 3.0, "rate_hz": 1.0}
TURNS = [[8.0, 0.0], [3.0, 0.0, 0.0, 0.0, 30.0, 30.0], [6.0, 0.5], [3.0, 0.0, 0.0, 0.0, -30.0, -30.0]] * 2
GAP_S = (29.0, 31.0)  # in the third turn, which begins at 28 s
SETTINGS = {"imu": "tactical", "mode": "navigate", "epoch": 0.1, "start": "told", "bridge": 3.0, "gps": GPS}


@pytest.fixture(scope="module")
def drive():
    """A car that turns four times by 90 deg in 40 s, recorded, without the samples of ``GAP_S``."""
    plan = {"latitude_deg": 48.0, "longitude_deg": 11.0, "height_m": 500.0, "speed_mps": 8.0, "segments": TURNS}
    env = gymnasium.make("SINS/NavFlight-v0", profile=plan, duration=40.0, epoch=0.1, n_sub=10, imu="tactical", gps=GPS)
    world = env.unwrapped.episode.world
    first, _ = world.reset([np.random.default_rng(1)], {})
    epochs = [world.epoch(k) for k in range(1, 401)]
    dtheta, dvel = (np.concatenate([one.measured[key][0] for one in epochs]) for key in ("dtheta", "dvel"))
    fixed = [k for k in range(400) if epochs[k].measured["gps_valid"][0, 0]]
    vel, pos = (np.array([epochs[k].measured[key][0] for k in fixed]) for key in ("gps_vel", "gps_pos"))
    true = (
        np.concatenate([getattr(one, part) for one in [first, *(e.truth for e in epochs)]]) for part in first._fields
    )
    gap = slice(*(round(100 * t) for t in GAP_S))
    dtheta[gap] = dvel[gap] = np.nan
    fixes = Gnss(0.1 * (1 + np.array(fixed)), vel, pos)
    return Recording(
        "drive", 100.0, 0.0, dtheta, dvel, world.task.site, fixes, np.zeros(3), Reference(0.1 * np.arange(401), *true)
    )


def test_epochs_tell_what_their_bridged_samples_are_off_by(drive):
    observations, _, _ = play(make(drive, **SETTINGS, window=(0.05, 39.9)), np.zeros(10), seed=0)
    found, whole = stacked(observations, "bridge_cov")[:-1], bridged(drive, 3.0).bridge_cov[0]
    np.testing.assert_allclose(found.sum(axis=0), whole, rtol=1e-12)
    here = np.flatnonzero(found.any(axis=(1, 2)))
    np.testing.assert_array_equal(here, np.arange(289, 310))
    np.testing.assert_allclose(
        found[[289, 290, 309]], np.array([0.5, 1.0, 0.5])[:, None, None] * 0.05 * whole, rtol=1e-12
    )
    assert "bridge_cov" not in make(drive, **SETTINGS, window=(0.0, 28.0)).reset(seed=0)[0]


@pytest.mark.parametrize("name", ["ekf", "gsf_imm"])
def test_a_gap_in_a_turn_is_told_and_rows_are_runs_alone(drive, name):
    """Where the samples end the heading is a few deg off and said to be; without the word it is beyond ten sigmas."""
    env = vector(drive, 3, **SETTINGS, window=(20.0, 11.2), stride=2.0)
    observations, _, _ = play(env, seed=4, options={"window": [0, 1, 2]}, action=np.zeros((3, 10)))
    task, world = env.unwrapped.task, env.unwrapped.episode.world
    deaf = [{key: value for key, value in obs.items() if key != "bridge_cov"} for obs in observations[:-1]]
    told, untold = (followed(solvers.make(name), task, seen, 3) for seen in (observations[:-1], deaf))
    for row in (0, 2):
        alone = replace(task, start=NavState(*(part[row] for part in task.start)))
        seen = [{key: value[row] for key, value in obs.items()} for obs in observations[:-1]]
        for one, rows in zip(followed(solvers.make(name), alone, seen, 1), told, strict=True):
            np.testing.assert_array_equal(one, rows[:, row])
    assert not np.array_equal(told[1], untold[1])
    for row in range(3):
        k = round((GAP_S[1] - 20.0 - 2.0 * row) / task.epoch_s)
        far = [
            np.abs(attitude.misalignment(q[k - 1, row, :4], world.truth_at(k).q_nb[row])[2]) / s[k - 1, row]
            for q, s in (told, untold)
        ]
        assert far[0] < 3.0 < 10.0 < far[1]


def followed(estimator, task, observations, runs):
    """The answers (K, ..., 10) of an estimator, and its standard deviations (K, ...) of the heading."""
    rngs = [np.random.default_rng(row) for row in range(runs)]
    estimator.reset(task, rngs if observations[0]["t"].ndim == 2 else rngs[0], runs)
    pairs = [(np.array(estimator.step(obs)), np.sqrt(estimator.covariance()[..., 2, 2])) for obs in observations]
    return tuple(np.stack(part) for part in zip(*pairs, strict=True))


@pytest.mark.parametrize("errors", [NavigationErrors(), AlignmentErrors()])
def test_noise_of_increments_is_what_they_do_to_the_ins(errors):
    """The increments of each sample are changed one by one: the second moment of what that does to two mechanisations."""
    rng, n_sub, T = np.random.default_rng(3), 40, 0.1
    model, pos = earth.get("wgs84"), np.array([0.8, 0.2, 400.0])
    nav = NavState(attitude.normalize(rng.standard_normal(4)), np.array([10.0, -5.0, 1.0]), pos)
    ins = Strapdown(model, T, n_sub, pos, hold_position=False)
    L = np.diag(np.repeat([1e-4, 0.1], 3)) @ rng.standard_normal((6, 6))
    cov, step = L @ L.T, np.repeat([1e-6, 1e-3], 3)
    dtheta, dvel = np.full((n_sub, 3), 1e-4), np.full((n_sub, 3), 0.02)
    changed = np.zeros((n_sub, 6, n_sub, 6))
    for j in range(n_sub):
        changed[j, range(6), j, range(6)] = step
    rows = NavState(*(np.broadcast_to(part, (n_sub, 6, len(part))) for part in nav))
    there, _ = ins.advance(ins.start(rows), dtheta + changed[..., :3], dvel + changed[..., 3:])
    here, motion = ins.advance(ins.start(nav), dtheta, dvel)
    phi = attitude.misalignment(there.nav.q_nb, np.broadcast_to(here.nav.q_nb, there.nav.q_nb.shape))
    off = np.concatenate([phi, there.nav.vel - here.nav.vel, earth.offset(model, here.nav.pos, there.nav.pos)], axis=-1)
    J = np.swapaxes(off / step[:, None], -1, -2)
    want = np.zeros((15, 15))
    want[:9, :9] = (J @ (cov / n_sub) @ J.mT).sum(axis=0)
    want[6:9, 6:9] *= 4 / 3  # the INS moves by the mean of the velocities at both ends, white noise by its integral
    places, units = ERRORS.places(errors.core), errors.core.si
    want = want[np.ix_(places, places)] / np.outer(units, units)
    found = errors.disturbed(motion, cov)
    size = np.sqrt(np.maximum(np.diag(want), 1e-300))
    np.testing.assert_allclose(found / np.outer(size, size), want / np.outer(size, size), atol=0.02)


@pytest.mark.parametrize("method", ["oba", "motion_velocity"])
def test_noise_of_increments_is_what_they_do_to_a_coarse_attitude(method):
    """The increments of one epoch are changed by an angle or a velocity along each axis."""
    env = gymnasium.make_vec(
        "SINS/AlignSway-v0", 1, start="unknown", coarse=20.0, duration=40.0, n_sub=1, imu="perfect", gps="perfect"
    )
    observations, _, _ = play(env, seed=1, action=np.array([[1.0, 0.0, 0.0, 0.0]]))
    task, seen = env.unwrapped.task, observations[: round(20.0 / env.unwrapped.task.epoch_s)]
    rng, k, step = np.random.default_rng(2), len(seen) // 3, np.repeat([1e-6, 1e-4], 3)
    L = step[:, None] * rng.standard_normal((6, 6))
    found = []
    for cov in (np.zeros((6, 6)), L @ L.T):
        estimator = coarse.start(method, task, (7,))
        for i, obs in enumerate(seen):
            rows = {key: np.repeat(value, 7, axis=0) for key, value in obs.items()}
            if i == k:
                rows["dtheta"][1:4, 0] += step[:3] * np.eye(3)
                rows["dvel"][4:, 0] += step[3:] * np.eye(3)
                rows["bridge_cov"] = np.tile(cov, (7, 1, 1))
            estimator.add(rows)
        found.append(estimator.spread().noise[0])
    q_nb = estimator.attitude()
    J = attitude.misalignment(q_nb, np.broadcast_to(q_nb[0], q_nb.shape))[1:].T / step
    want, added = J @ L @ L.T @ J.T, found[1] - found[0]
    size = np.sqrt(np.diag(want))
    np.testing.assert_allclose(added / np.outer(size, size), want / np.outer(size, size), atol=0.03)
