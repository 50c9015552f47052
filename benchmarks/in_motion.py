"""Drives that begin in motion: a car is driving when its INS is switched on, and nobody tells the attitude.

    python benchmarks/in_motion.py                           gsf_imm with both grades of sensors
    python benchmarks/in_motion.py --solver ckf --drives 8   another solver, fewer drives

Drives are drawn as segments. In town a car brakes for each turn of 40 to 120 deg and accelerates again. On a road it keeps its
speed on legs and gentle bends. On a straight it holds speed and heading for the first 70 s, in which nothing but the Earth's rate
shows the heading, and then drives as in town. Each drive has its own draw of sensors and noises. Fixes of velocity and position
come once a second.

A drive fails if the heading is more than 2 deg off 60 s after switch-on. ``expected`` is how many fail by the solver's own
standard deviation, if errors are Gaussian. The bound is that of Cramer and Rao for the drive: no estimator without knowledge of
the motion, such as that a car does not slip sideways, has smaller errors.
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.random import Generator
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

import solvers
from sins_env.arrays import Array, Obs
from sins_env.evaluation.bound import bounds
from sins_env.evaluation.estimators.guard import Guard
from sins_env.evaluation.play.loop import Loop
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.score import exact
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.units import DEG

LIMIT_DEG, AFTER_S = 2.0, 60.0  #: largest error of the heading, and when
TIMES_S = (10.0, 30.0, 60.0, 120.0, 300.0)
DURATION_S, EPOCH_S, N_SUB = 300.0, 0.1, 10
STRAIGHT_S = 70.0  #: length of the first leg on a straight
SENSORS = ("mems", "tactical")
FIXES = {"vel_std_mps": 0.1, "pos_std_m": 5.0, "rate_hz": 1.0}


class Course:
    """A drive in the making: legs with constant rates, whose times are whole epochs."""

    def __init__(self, speed_mps: float) -> None:
        self.rows: list[list[Any]] = []
        self.speed, self.pitch, self.time_s = speed_mps, 0.0, 0.0

    def leg(self, duration_s: float, speed_mps: float | None = None, turn: Sequence[float] = (0.0, 0.0)) -> None:
        """Drive for a while, to another speed, and with heading rates at start and end, deg/s."""
        T = max(round(duration_s / EPOCH_S), 1) * EPOCH_S
        accel = 0.0 if speed_mps is None else (speed_mps - self.speed) / T
        self.rows.append([T, accel, 0.0, 0.0, *turn])
        self.speed, self.time_s = self.speed + accel * T, self.time_s + T

    def slope(self, pitch_deg: float, duration_s: float) -> None:
        """Drive onto a slope."""
        self.rows.append([duration_s, 0.0, (pitch_deg - self.pitch) / duration_s])
        self.pitch, self.time_s = pitch_deg, self.time_s + duration_s

    def change(self, speed_mps: float, accel_mps2: float) -> None:
        """Brake or accelerate to a speed."""
        self.leg(abs(speed_mps - self.speed) / accel_mps2, speed_mps)

    def turn(self, angle_deg: float, lateral_mps2: float) -> None:
        """Turn at constant speed; the heading rate grows and falls within a second."""
        rate = math.copysign(lateral_mps2 / self.speed / DEG, angle_deg)
        steady = max(abs(angle_deg / rate) - 1.0, EPOCH_S)
        self.leg(1.0, turn=(0.0, rate))
        self.leg(steady, turn=(rate, rate))
        self.leg(1.0, turn=(rate, 0.0))


def either(rng: Generator, low: float, high: float) -> float:
    """Draw a size from low to high with either sign."""
    return float(rng.uniform(low, high) * rng.choice([-1.0, 1.0]))


def town(rng: Generator, course: Course) -> None:
    """Drive to the next crossing, brake, turn, and accelerate."""
    course.leg(rng.uniform(3.0, 25.0))
    if rng.random() < 0.3:
        course.slope(either(rng, 0.0, 4.0), 2.0)
    course.change(rng.uniform(4.0, 8.0), rng.uniform(1.0, 2.5))
    course.turn(either(rng, 40.0, 120.0), rng.uniform(1.5, 3.0))
    course.change(rng.uniform(9.0, 17.0), rng.uniform(1.0, 2.0))


def road(rng: Generator, course: Course) -> None:
    """Drive a leg and a bend at one speed."""
    course.leg(rng.uniform(5.0, 35.0))
    if rng.random() < 0.3:
        course.slope(either(rng, 0.0, 3.0), 3.0)
    course.turn(either(rng, 15.0, 60.0), rng.uniform(0.5, 1.5))


#: Kinds of drives: what follows itself until the end, speeds at switch-on, and the length of a first straight leg.
KINDS: dict[str, tuple[Callable[[Generator, Course], None], tuple[float, float], float]] = {
    "town": (town, (8.0, 17.0), 0.0),
    "road": (road, (15.0, 30.0), 0.0),
    "straight": (town, (8.0, 17.0), STRAIGHT_S),
}


def drive(kind: str, rng: Generator) -> dict[str, Any]:
    """Draw a drive as a flight plan, all at one place."""
    onwards, speeds, straight_s = KINDS[kind]
    course = Course(rng.uniform(*speeds))
    speed, heading = course.speed, rng.uniform(0.0, 360.0)
    if straight_s:
        course.leg(straight_s)
    while course.time_s < DURATION_S:
        onwards(rng, course)
    plan = {"latitude_deg": 48.0, "longitude_deg": 11.0, "height_m": 500.0, "speed_mps": speed, "heading_deg": heading}
    return {**plan, "segments": course.rows}


def task_of(kind: str, number: int, sensors: str, seed: int) -> EvaluationTask:
    """Return the task of a drive; both grades of sensors take the same one."""
    plan = drive(kind, np.random.default_rng([seed, list(KINDS).index(kind), number]))
    return EvaluationTask(
        name=f"{kind}-{number}",
        what="a drive that begins in motion",
        source="benchmarks/in_motion.py",
        env_id="SINS/NavFlight-v0",
        delta_azimuth_deg=LIMIT_DEG,
        delta_level_arcsec=3600.0,
        suite_seed=seed,
        kwargs={
            "profile": plan, "duration": DURATION_S, "epoch": EPOCH_S, "n_sub": N_SUB, "imu": sensors, "gps": FIXES,
            "start": "unknown", "coarse": 0.0,
        },
    )  # fmt: skip


@dataclass(frozen=True)
class Found:
    """What a solver made of D drives, at the times TIMES_S; deg."""

    error: Array  #: (D, T) of the heading
    sigma: Array  #: (D, T) standard deviation that the solver states
    bound: Array  #: (D, T)


class SideBySide:
    """Environments of one run each as one vector environment for the loop: its rows are different drives."""

    def __init__(self, tasks: Sequence[EvaluationTask]) -> None:
        self._envs = [task.make(1) for task in tasks]
        starts = [task.reset(env, [0])[0] for task, env in zip(tasks, self._envs, strict=True)]
        self.unwrapped = self._envs[0].unwrapped  #: every row is told what the first is
        self.start = stacked(starts)  #: first observation

    def step(self, action: Array) -> tuple[Any, ...]:
        """Step every environment with its row of the action; the info has the errors."""
        steps = [env.step(action[row : row + 1]) for row, env in enumerate(self._envs)]
        errors = stacked([step[4]["errors"] for step in steps])
        return stacked([step[0] for step in steps]), None, None, None, {"errors": errors}

    def close(self) -> None:
        """Close every environment."""
        for env in self._envs:
            env.close()


def stacked(parts: Sequence[Mapping[str, Array]]) -> Obs:
    """Return the arrays of several environments as those of one batch."""
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}  # type: ignore[return-value]


def play(tasks: Sequence[EvaluationTask], name: str, report: Callable[[float], None]) -> Found:
    """Play a solver on drives side by side: rows of one batch are different drives, of which it is told the same."""
    env, solver = SideBySide(tasks), solvers.make(name)
    rngs = [np.random.default_rng([row]) for row in range(len(tasks))]
    loop = Loop(env, Guard(solver, len(tasks)), env.start, rngs)
    looks = [round(t / EPOCH_S) for t in TIMES_S]
    errors, sigmas = [], []
    for k, _, info, _, _ in loop:
        if k in looks:
            errors.append(info["errors"]["phi"][:, 2])
            sigmas.append(np.sqrt(solver.covariance()[:, 2, 2]))
        if k % 50 == 0:
            report(k / loop.task.num_epochs)
    loop.close()
    limits = []
    for task in tasks:
        bound = bounds.compute(task)
        assert bound is not None
        limits.append(bound.sigma[np.searchsorted(bound.t, np.array(TIMES_S) - 1e-6), 2])
    return Found(np.array(errors).T / DEG, np.array(sigmas).T / DEG, np.array(limits) / DEG)


def summary(name: str, seed: int, found: Mapping[tuple[str, str], Found]) -> Table:
    """Return the table: errors at all times, and what is expected 60 s after switch-on."""
    table = Table(title=f"{name}, attitude unknown at switch-on in motion; |heading error|, deg; seed {seed}")
    for heading in ("sensors", "drives", "number", *(f"{t:g} s: median, worst" for t in TIMES_S)):
        table.add_column(heading, justify="left" if heading in ("sensors", "drives") else "right")
    for heading in (f"> {LIMIT_DEG:g} deg at {AFTER_S:g} s", "expected", "bound: median, worst", "(error/sigma)^2"):
        table.add_column(heading, justify="right")
    at = TIMES_S.index(AFTER_S)
    for (sensors, kind), f in found.items():
        size = np.abs(f.error)
        failed = int((~(size[:, at] <= LIMIT_DEG)).sum())
        _, (low, high) = exact.share(failed, len(size))
        expected = sum(math.erfc(LIMIT_DEG / sigma / math.sqrt(2.0)) for sigma in f.sigma[:, at])
        cells = [sensors, kind, f"{len(size)}", *(f"{np.median(at_t):.2f}, {at_t.max():.2f}" for at_t in size.T)]
        cells += [f"{failed} [{low:.1%}, {high:.1%}]", f"{expected:.1f}"]
        cells += [f"{np.median(f.bound[:, at]):.2f}, {f.bound[:, at].max():.2f}"]
        cells += [f"{np.square(f.error / f.sigma)[:, at].mean():.2f}"]
        table.add_row(*cells)
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="drives that begin in motion, with an unknown attitude")
    parser.add_argument("--solver", default="gsf_imm", help="default %(default)s")
    parser.add_argument("--drives", type=int, default=30, help="drives of each kind (default %(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="seed of drives and noises (default %(default)s)")
    parser.add_argument("--sensors", nargs="+", default=SENSORS, help="presets of inertial sensors")
    parser.add_argument("--json", metavar="FILE", help="also write the errors of all drives, a line a kind")
    given = parser.parse_args(arguments)
    found: dict[tuple[str, str], Found] = {}
    total = len(given.sensors) * len(KINDS)
    with threadpool_limits(1), Bar("drives") as bar:
        for sensors in given.sensors:
            for kind in KINDS:
                tasks = [task_of(kind, number, sensors, given.seed) for number in range(given.drives)]
                done = len(found)
                found[sensors, kind] = play(tasks, given.solver, lambda part, done=done: bar.update(done + part, total))
                if given.json:
                    row = {key: value.tolist() for key, value in vars(found[sensors, kind]).items()}
                    with open(given.json, "a", encoding="utf-8") as file:
                        file.write(json.dumps({"sensors": sensors, "kind": kind, "seed": given.seed, **row}) + "\n")
    Console(width=220).print(summary(given.solver, given.seed, found))


if __name__ == "__main__":
    main()
