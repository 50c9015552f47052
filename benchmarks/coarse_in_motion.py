"""Coarse alignment in motion: heading errors after 10 to 300 s beside the bound, and whether they are as told.

    python benchmarks/coarse_in_motion.py                    30 runs of a car, a ship and a flight, tactical sensors
    python benchmarks/coarse_in_motion.py --imu navigation   other sensors; gyros that see the earth turn

All three move from the first sample on with an unknown attitude. Fixes of 0.1 m/s and 3 m come once a second. A row of
``motion_body`` has a Doppler log or an odometer in place of the fixes. ``ckf`` begins by itself once its heading is known. Each
cell has the RMS of the heading's error, deg, and in brackets the mean of its square over the told variance. The bound is that of
Cramer and Rao, which knows nothing of the attitude but a level to 3 deg. Gross errors of a heading that may be anything have an
RMS of 104 deg.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

import gymnasium
import numpy as np
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

import solvers
from sins_env import attitude
from sins_env.arrays import Array
from sins_env.evaluation.bound import bounds
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.types import Task
from sins_env.units import DEG
from solvers.pipeline.coarse.motion import Body, InMotion, Position, Velocity
from solvers.pipeline.coarse.spread import told_by

TIMES_S = (10.0, 30.0, 60.0, 120.0, 300.0)
EPOCH_S = 0.1
FIXES = {"vel_std_mps": 0.1, "pos_std_m": 3.0, "rate_hz": 1.0}
#: Profiles of SINS/NavFlight-v0, each with the sensor that shows a velocity along the body.
MOTIONS = {"car": "odometer", "ship": "dvl", "hotstart60": None}
METHODS: dict[str, type[InMotion]] = {"motion_velocity": Velocity, "motion_position": Position, "motion_body": Body}


class Method:
    """A coarse method as a solver."""

    def __init__(self, kind: type[InMotion]) -> None:
        self.kind = kind

    def reset(self, task: Task, rng: Any, num_runs: int) -> None:
        self.task, self.coarse = task, self.kind(task, (num_runs,), open_ended=True)
        self.pad = np.zeros((num_runs, 6))

    def step(self, obs: Any) -> Array:
        self.coarse.add(obs)
        return np.concatenate([self.coarse.attitude(), self.pad], axis=-1)

    def covariance(self) -> Array:
        self.coarse.settle()
        spread = self.coarse.spread()
        assert spread is not None
        return told_by(spread, self.task.prior)


def play(env: Any, solver: Any, runs: int, seed: int) -> tuple[Array, Array]:
    """Return the errors and the standard deviations of the heading at the times, (T, runs) deg."""
    obs, _ = env.reset(seed=seed)
    solver.reset(env.unwrapped.task, [np.random.default_rng([seed, row]) for row in range(runs)], runs)
    looks, errors, sigmas = [round(t / EPOCH_S) for t in TIMES_S], [], []
    for k in range(1, looks[-1] + 1):
        answer = solver.step(obs)
        obs, _, _, _, info = env.step(answer)
        if k in looks:
            if isinstance(solver, Method):  # what the end of a phase adds counts
                P = solver.covariance()
                answer = solver.coarse.attitude()
            else:
                P, answer = solver.covariance(), answer[:, :4]
            errors.append(attitude.misalignment(answer, info["truth"]["q_nb"])[:, 2] / DEG)
            sigmas.append(np.sqrt(P[:, 2, 2]) / DEG)
    return np.array(errors), np.array(sigmas)


def limits(settings: dict[str, Any]) -> Array:
    """Return the bound of the heading at the times, deg."""
    task = EvaluationTask(
        name="motion",
        what="a start in motion",
        source="benchmarks/coarse_in_motion.py",
        env_id="SINS/NavFlight-v0",
        delta_azimuth_deg=1.0,
        delta_level_arcsec=3600.0,
        kwargs=settings,
    )
    bound = bounds.compute(task)
    assert bound is not None
    return np.asarray(bound.sigma[np.searchsorted(bound.t, np.array(TIMES_S) - 1e-6), 2] / DEG)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="coarse alignment in motion beside the bound")
    parser.add_argument("--runs", type=int, default=30, help="runs of each motion (default %(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="seed of sensors and noises (default %(default)s)")
    parser.add_argument("--imu", default="tactical", help="preset of inertial sensors (default %(default)s)")
    given = parser.parse_args(arguments)
    table = Table(title=f"heading error, deg RMS (error^2 / told), {given.runs} runs, {given.imu}, seed {given.seed}")
    for name in ("motion", "solver", *(f"{t:g} s" for t in TIMES_S)):
        table.add_column(name, justify="left" if name in ("motion", "solver") else "right")
    rows = [
        (profile, name)
        for profile, aid in MOTIONS.items()
        for name in (*METHODS, "ckf", "gsf_imm")
        if aid or name != "motion_body"
    ]
    with threadpool_limits(1), Bar("motions") as bar:
        for done, (profile, name) in enumerate(rows):
            bar.update(done, len(rows))
            settings: dict[str, Any] = {
                "profile": profile, "start": "unknown", "coarse": 0.0, "duration": TIMES_S[-1], "epoch": EPOCH_S,
                "n_sub": 10, "imu": given.imu, "gps": FIXES,
            }  # fmt: skip
            if name == "motion_body":
                settings["aids"] = {MOTIONS[profile]: {}}
            if name == "motion_velocity":
                bound = limits(settings)
                table.add_row(profile, "bound", *(f"{value:.3f}" for value in bound))
            env = gymnasium.make_vec("SINS/NavFlight-v0", num_envs=given.runs, reveal_truth=True, **settings)
            solver = Method(METHODS[name]) if name in METHODS else solvers.make(name)
            error, sigma = play(env, solver, given.runs, given.seed)
            rms, ratio = np.sqrt(np.mean(error**2, axis=1)), np.mean((error / sigma) ** 2, axis=1)
            cells = [f"{a:.3f} ({b:.2f})" for a, b in zip(rms, ratio, strict=True)]
            table.add_row("", name, *cells, end_section=(done + 1 == len(rows) or rows[done + 1][0] != profile))
            env.close()
    Console(width=150).print(table)


if __name__ == "__main__":
    main()
