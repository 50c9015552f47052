"""Sensitivities of gsf_imm: what its hypotheses gain and cost on scenarios that are none of the suite's tasks.

    python benchmarks/sensitivities.py                          table of the settings of VARIANTS, on the scenarios of one seed
    python benchmarks/sensitivities.py --seed 2 --scenarios 40  other scenarios
    python benchmarks/sensitivities.py told cross               some settings only

A scenario draws the motion of the base, the grade of the IMU, and the noise and the rate of the fixes. Half of the told variances
are right, and the others are wrong by a factor from 1/100 to 100. One scenario in two has a surprise that nobody tells: an offset
or a slow ramp of the fixes, bursts of outages, heavy tails or contamination. The reference is ``two_pass`` on the same random
numbers, told the truth and spared the surprise. A ratio is that of the azimuth's RMS over runs and the last fifth of the time to
that of the reference. Settings are compared scenario by scenario.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.random import Generator
from rich.console import Console
from rich.table import Table
from threadpoolctl import threadpool_limits

import solvers
from sins_env.arrays import Array, Obs
from sins_env.evaluation.estimators.guard import Guard
from sins_env.evaluation.play.errors import nees
from sins_env.evaluation.play.loop import Loop
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask, solver_rng
from sins_env.types import Task

EPOCH_S, N_SUB, DURATION_S = 0.2, 6, 300.0
WRONG = 100.0  #: largest factor of a told variance, and the reciprocal of the least
LAST = 0.2  #: share of the epochs whose errors count
RAMP_S = 30.0  #: length of a ramp
FAR = 3.0  #: a ratio, or an NEES over its expectation, that is called large

SURPRISES: dict[str, Callable[[Generator], dict[str, Any]]] = {
    "offset": lambda rng: {"jump_mps": _log(rng, 0.05, 5.0), "jump_s": _log(rng, 5.0, 60.0)},
    "ramp": lambda rng: {"ramp": _log(rng, 1e-3, 3e-2)},  # m/s^2, from a drawn time on for RAMP_S
    "outages": lambda rng: {"outages_s": _bursts(rng)},
    "heavy tails": lambda rng: {"heavy_tail_dof": rng.uniform(2.1, 5.0)},
    "contamination": lambda rng: {
        "contamination": rng.uniform(0.01, 0.3),
        "contamination_factor": _log(rng, 10.0, 1e4),
    },
}

#: Settings of gsf_imm by name. All sets of pairs but those of the default are grids in the logarithm of the two variances.
VARIANTS: dict[str, dict[str, Any]] = {
    "default": {},
    "told": {"imu_factors": [[1, 1]], "fix_factors": [1], "fix_offsets": False},
    "gyro": {"imu_factors": [[1, 1], [0.01, 1], [100, 1]]},
    "cross": {"imu_factors": [[1, 1], [100, 1], [0.01, 1], [1, 100], [1, 0.01]]},
    "corners": {"imu_factors": [[1, 1], [100, 100], [100, 0.01], [0.01, 100], [0.01, 0.01]]},
    "square": {"imu_factors": [[1, 1]] + [[g, a] for g in (1, 100, 0.01) for a in (1, 100, 0.01) if (g, a) != (1, 1)]},
    "no regimes": {"fix_factors": [1]},
    "no offset": {"fix_offsets": False},
}


def _log(rng: Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _bursts(rng: Generator) -> list[tuple[float, float]]:
    """Return five to ten outages of 1 to 20 s in the first four fifths of the time."""
    starts = np.sort(rng.uniform(0.0, 0.8 * DURATION_S, rng.integers(5, 11)))
    return [(float(start), float(start + _log(rng, 1.0, 20.0))) for start in starts]


@dataclass(frozen=True)
class Scenario:
    """One scenario: what is true, what is told, and the surprise."""

    true: dict[str, Any]  #: settings of the environment
    factors: tuple[float, float, float]  #: told over true variances of gyros, accelerometers and fixes
    surprise: str
    gps: dict[str, Any]  #: what the surprise changes in the fixes


def drawn(rng: Generator) -> Scenario:
    """Draw a scenario."""
    arw, vrw = _log(rng, 0.002, 0.3), _log(rng, 2.0, 200.0)
    imu = {
        "arw_deg_sqrt_h": arw,
        "vrw_ug_sqrt_hz": vrw,
        "gyro_bias_deg_h": arw * _log(rng, 0.5, 5.0),
        "accel_bias_ug": vrw * _log(rng, 2.0, 20.0),
    }
    gps = {"vel_std_mps": _log(rng, 0.02, 1.0), "rate_hz": float(rng.choice([1.0, 2.5, 5.0]))}
    still = rng.random() < 0.25
    factors = [_log(rng, 1.0 / WRONG, WRONG) if rng.random() < 0.5 else 1.0 for _ in range(3)]
    surprise = str(rng.choice([*SURPRISES])) if rng.random() < 0.5 else "none"
    change = SURPRISES[surprise](rng) if surprise != "none" else {}
    true = {
        "imu": imu, "gps": gps, "heading_deg": None, "duration": DURATION_S, "epoch": EPOCH_S, "n_sub": N_SUB,
    }  # fmt: skip
    if not still:
        true["motion"] = "random"
    return Scenario({**true, "still": still}, (factors[0], factors[1], factors[2]), surprise, change)


def told(task: Task, factors: Sequence[float]) -> Task:
    """Return a task with the variances of gyros, accelerometers and fixes multiplied by ``factors``."""
    gyro, accel, fix = (math.sqrt(factor) for factor in factors)
    p = task.prior
    prior = dataclasses.replace(
        p,
        arw_deg_sqrt_h=gyro * p.arw_deg_sqrt_h,
        vrw_ug_sqrt_hz=accel * p.vrw_ug_sqrt_hz,
        gps_vel_std_mps=tuple(fix * std for std in p.gps_vel_std_mps),
    )
    imu = dataclasses.replace(task.imu, arw_deg_sqrt_h=prior.arw_deg_sqrt_h, vrw_ug_sqrt_hz=prior.vrw_ug_sqrt_hz)
    gps = dataclasses.replace(
        task.gps, vel_std_mps=prior.gps_vel_std_mps, heavy_tail_dof=0.0, contamination=0.0
    )  # a surprise is not told
    return dataclasses.replace(task, prior=prior, imu=imu, gps=gps)


def environment(scenario: Scenario, surprised: bool) -> EvaluationTask:
    """Return the task of a scenario, with its surprise or without."""
    kwargs = dict(scenario.true)
    env_id = "SINS/AlignStatic-v0" if kwargs.pop("still") else "SINS/AlignSway-v0"
    change = {name: value for name, value in scenario.gps.items() if name != "ramp"} if surprised else {}
    return dataclasses.replace(
        get_task("sway-white-v0"), name="scenario", env_id=env_id, kwargs={**kwargs, "gps": {**kwargs["gps"], **change}}
    )


class Ramp:
    """A velocity of the fixes that drifts for some time, at one rate and from one time for each run, and then ends at once."""

    def __init__(self, rate: float, lasts_s: float, runs: int, rng: Generator) -> None:
        direction = rng.uniform(0.0, 2.0 * np.pi, runs)
        self._rate = rate * np.stack([np.sin(direction), np.cos(direction), np.zeros(runs)], axis=-1)
        self._lasts = lasts_s
        self._start = rng.uniform(0.0, DURATION_S - lasts_s, runs)

    def __call__(self, obs: Obs) -> Obs:
        t = obs["t"][:, 0] - self._start
        moved = np.where(((t > 0.0) & (t < self._lasts))[:, None], t[:, None] * self._rate, 0.0)
        return {**obs, "gps_vel": np.where(obs["gps_valid"] == 1, obs["gps_vel"] + moved, 0.0)}


class Told:
    """A vector environment whose task tells something else, and whose observations are disturbed."""

    def __init__(self, env: Any, tell: Callable[[Task], Task], disturb: Callable[[Obs], Obs]) -> None:
        self._env, self._disturb = env, disturb
        self.task = tell(env.unwrapped.task)

    @property
    def unwrapped(self) -> Told:
        return self

    def step(self, action: Array) -> tuple[Any, ...]:
        """Take a step, with the observation disturbed."""
        obs, *rest = self._env.step(action)
        return self._disturb(obs), *rest

    def close(self) -> None:
        """Close the environment."""
        self._env.close()


class Played(NamedTuple):
    """What a solver made of R runs."""

    squares: Array  #: (R,) squared azimuth errors, means over the last fifth of the time, rad^2
    nees: Array  #: (R,) NEES of the attitude over its expectation at the end
    sigmas: Array  #: (R, 3) errors of the attitude at the end over the standard deviations that the solver states
    lost: int  #: number of runs that it gave up
    doubt: Array  #: (R,) share of epochs in which it doubts the told noise; NaN if it does not tell


def same(given: Any) -> Any:
    """Return what is given."""
    return given


def play(
    task: EvaluationTask,
    solver: Any,
    runs: int,
    seed: int,
    tell: Callable[[Task], Task] = same,
    disturb: Callable[[Obs], Obs] = same,
) -> Played:
    """Play a solver on runs of a task, which tells what ``tell`` makes of it, with fixes as ``disturb`` makes them."""
    env = task.make(runs, reveal_truth=True)
    obs, _ = task.reset(env, range(runs), seed)
    rngs = [solver_rng(task, type(solver).__name__, run) for run in range(runs)]
    loop = Loop(Told(env, tell, disturb), Guard(solver, runs), disturb(obs), rngs)
    phi = np.array([info["errors"]["phi"] for k, _, info, _, _ in loop if k > (1.0 - LAST) * loop.task.num_epochs])
    P = solver.covariance()
    lost = int((loop.guard.health()[2] >= 0).sum())
    doubt = getattr(solver, "diagnostics", dict)().get("doubt", np.full(runs, np.nan))
    loop.close()
    sigmas = np.abs(phi[-1]) / np.sqrt(np.diagonal(P[:, :3, :3], axis1=-2, axis2=-1))
    return Played(np.square(phi[..., 2]).mean(axis=0), nees(phi[-1], P[:, :3, :3]) / 3.0, sigmas, lost, doubt)


def ratios(scenario: Scenario, number: int, seed: int, runs: int, variants: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return of each variant the ratio to the reference, the mean NEES over its expectation, and the number of lost runs."""
    suite_seed = 1000 * seed + number
    calm, harsh = environment(scenario, False), environment(scenario, True)
    reference = play(calm, solvers.make("two_pass"), runs, suite_seed)
    best = float(np.mean(reference.squares))
    ramp = scenario.gps.get("ramp")
    disturb = Ramp(ramp, RAMP_S, runs, np.random.default_rng([seed, number, 1])) if ramp else same
    found = {
        name: play(
            harsh,
            solvers.make("gsf_imm", **VARIANTS[name]),
            runs,
            suite_seed,
            lambda task: told(task, scenario.factors),
            disturb,
        )
        for name in variants
    }
    return {
        name: {"ratio": math.sqrt(float(np.mean(p.squares)) / best), "nees": float(np.mean(p.nees)), "lost": p.lost}
        for name, p in found.items()
    }


def summary(rows: Sequence[dict[str, Any]], variants: Sequence[str]) -> Table:
    """Return the table of settings: ratios to the reference, and paired ratios to the first setting."""
    table = Table(
        title=f"{len(rows)} scenarios; ratio of the azimuth's RMS to that of two_pass told the truth without the surprise"
    )
    for heading in (
        "setting",
        "honest",
        "told wrong",
        "surprise",
        "all",
        "90 %",
        "worst",
        "to the first",
        "far",
        "overconfident",
        "lost",
    ):
        table.add_column(heading, justify="left" if heading == "setting" else "right")
    kinds = {
        "honest": lambda row: row["surprise"] == "none" and all(f == 1.0 for f in row["factors"]),
        "told wrong": lambda row: row["surprise"] == "none" and any(f != 1.0 for f in row["factors"]),
        "surprise": lambda row: row["surprise"] != "none",
        "all": lambda row: True,
    }
    for name in variants:
        logs = {
            k: np.array([math.log(row["found"][name]["ratio"]) for row in rows if kind(row)])
            for k, kind in kinds.items()
        }
        every = logs["all"]
        first = np.array([math.log(row["found"][variants[0]]["ratio"]) for row in rows])
        apart, error = (
            every - first,
            np.std(every - first, ddof=1) / math.sqrt(len(rows)) if len(rows) > 1 else math.nan,
        )
        cells = [f"{math.exp(part.mean()):.3f}" if len(part) else "-" for part in logs.values()]
        cells += [f"{math.exp(np.quantile(every, 0.9)):.2f}", f"{math.exp(every.max()):.2f}"]
        cells.append("-" if name == variants[0] else f"{math.exp(apart.mean()):.3f} +- {error:.3f}")
        cells.append(f"{sum(row['found'][name]['ratio'] > FAR for row in rows)}")
        cells.append(f"{sum(row['found'][name]['nees'] > FAR for row in rows)}")
        cells.append(f"{sum(row['found'][name]['lost'] for row in rows)}")
        table.add_row(name, *cells)
    return table


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="what the hypotheses of gsf_imm gain and cost on drawn scenarios")
    parser.add_argument("variants", nargs="*", metavar="setting", help=f"default all: {' '.join(VARIANTS)}")
    parser.add_argument("--scenarios", type=int, default=60, help="default %(default)s")
    parser.add_argument("--runs", type=int, default=8, help="runs of each (default %(default)s)")
    parser.add_argument("--seed", type=int, default=1, help="seed of the scenarios (default %(default)s)")
    parser.add_argument("--json", metavar="FILE", help="also write every scenario and its ratios, a line each")
    given = parser.parse_args(arguments)
    variants = given.variants or list(VARIANTS)
    if unknown := [name for name in variants if name not in VARIANTS]:
        parser.error(f"{', '.join(unknown)}: no such setting; allowed: {', '.join(VARIANTS)}")
    rows: list[dict[str, Any]] = []
    with threadpool_limits(1), Bar("scenarios") as bar:
        for number in range(given.scenarios):
            scenario = drawn(np.random.default_rng([given.seed, number]))
            rows.append(
                {**dataclasses.asdict(scenario), "found": ratios(scenario, number, given.seed, given.runs, variants)}
            )
            bar.update(number + 1, given.scenarios)
            if given.json:
                with open(given.json, "a", encoding="utf-8") as file:
                    file.write(json.dumps(rows[-1]) + "\n")
    Console().print(summary(rows, variants))
    return 0


if __name__ == "__main__":
    sys.exit(main())
