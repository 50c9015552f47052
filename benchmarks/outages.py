"""Drift without fixes: a car with a MEMS IMU and RTK at 4 Hz, whose fixes are withheld five times for 15 s.

    python benchmarks/outages.py                              all solvers below
    python benchmarks/outages.py --rough                      an IMU whose biases wander a hundred times as much as told
    python benchmarks/outages.py --solvers ckf --runs 5       others, fewer runs

The car is driving when it is switched on, and nobody tells the attitude. Every run has its own draw of sensors and noises. Fixes
have errors of 2 cm and 5 cm/s. They are made 1 ms before the end of an epoch, as receivers with stamps of .499 s give them.

The drift is the horizontal error of the position at the end of a span without fixes, RMS over the runs. ``after`` is that error
20 s later, when fixes are back: the largest of all runs and spans tells whether a solver has left the fixes for good.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

import numpy as np
from in_motion import Course, town
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

import solvers
from sins_env.arrays import Array
from sins_env.evaluation.estimators.guard import Guard
from sins_env.evaluation.play.loop import Loop
from sins_env.evaluation.tasks.task import EvaluationTask
from solvers import zoo

#: ``:recorded`` has the settings with which ``navigate`` takes a recording.
SOLVERS = ("gsf_imm:recorded", "gsf_imm", "student_t_ckf", "inekf", "ekf")
EPOCH_S, DURATION_S, WITHHELD_S, BACK_S = 0.25, 330.0, 15.0, 20.0
STARTS_S = (120.0, 160.0, 200.0, 240.0, 280.0)
#: True IMU where a solver is told the preset: biases that wander within a minute, as vibration and heat do in a car.
ROUGH = {
    "preset": "mems", "gyro_markov_deg_h": 200.0, "gyro_markov_s": 20.0, "accel_markov_ug": 10_000.0, "accel_markov_s": 20.0,
    "arw_deg_sqrt_h": 1.0, "vrw_ug_sqrt_hz": 1000.0,
}  # fmt: skip
FIXES = {"vel_std_mps": 0.05, "pos_std_m": 0.02, "rate_hz": 4.0, "age_s": 0.001}


def task_of(seed: int, rough: bool) -> EvaluationTask:
    """Return the task: one drive through town."""
    rng = np.random.default_rng(seed)
    course = Course(13.0)
    while course.time_s < DURATION_S:
        town(rng, course)
    plan = {"latitude_deg": 48.0, "longitude_deg": 11.0, "height_m": 500.0, "speed_mps": 13.0, "heading_deg": 250.0}
    return EvaluationTask(
        name="outages",
        what="a drive with five spans without fixes",
        source="benchmarks/outages.py",
        env_id="SINS/NavFlight-v0",
        delta_azimuth_deg=2.0,
        delta_level_arcsec=3600.0,
        suite_seed=seed,
        kwargs={
            "profile": {**plan, "segments": course.rows}, "duration": DURATION_S, "epoch": EPOCH_S, "n_sub": 25,
            "gps": {**FIXES, "outages_s": [[at, at + WITHHELD_S] for at in STARTS_S]}, "start": "unknown", "coarse": 0.0,
            "imu": ROUGH if rough else "mems", "told": {"imu": "mems"},
        },
    )  # fmt: skip


def errors(task: EvaluationTask, name: str, runs: int) -> Array:
    """Return the horizontal errors of the position of a solver, (epochs, runs), m."""
    env, seeds = task.make(runs), list(range(runs))
    solver = solvers.make(name.removesuffix(":recorded"), **(zoo.RECORDED if name.endswith(":recorded") else {}))
    rngs = [np.random.default_rng([seed]) for seed in seeds]
    loop = Loop(env, Guard(solver, runs), task.reset(env, seeds)[0], rngs)
    found = [np.hypot(*info["errors"]["pos"][:, :2].T) for _, _, info, _, _ in loop]
    env.close()
    return np.array(found)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="drift of solvers while fixes are withheld")
    parser.add_argument("--solvers", nargs="+", default=SOLVERS, metavar="NAME", help=f"default {' '.join(SOLVERS)}")
    parser.add_argument("--runs", type=int, default=20, help="runs (default %(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the drive and the noises (default %(default)s)")
    parser.add_argument("--rough", action="store_true", help="an IMU that is worse than told")
    given = parser.parse_args(arguments)
    table = Table(title=f"drift after {WITHHELD_S:g} s without fixes, RMS of {given.runs} runs, m")
    for heading in ("solver", *(f"{at:g} s" for at in STARTS_S), "mean", "after: median", "worst"):
        table.add_column(heading, justify="left" if heading == "solver" else "right")
    ends = [round((at + WITHHELD_S) / EPOCH_S) - 1 for at in STARTS_S]
    with threadpool_limits(1):
        for name in given.solvers:
            found = errors(task_of(given.seed, given.rough), name, given.runs)
            drift = np.sqrt(np.square(found[ends]).mean(axis=1))
            after = found[[end + round(BACK_S / EPOCH_S) for end in ends]]
            cells = [*drift, drift.mean(), np.median(after), after.max()]
            table.add_row(name, *(f"{value:.2f}" for value in cells))
    Console(width=140).print(table)


if __name__ == "__main__":
    main()
