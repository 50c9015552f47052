"""Faults of sensors that nobody tells, and what robust filters make of them.

    python benchmarks/sensor_faults.py                  every fault, 24 runs each: some CPU minutes
    python benchmarks/sensor_faults.py spoof            faults whose name begins so

A car or a ship under way is played for 150 s with the fault from 60 to 120 s. All faults of a vehicle have the same random numbers.
Errors are RMS over runs: the horizontal position at the end of the fault and at the end of the run, and the heading at the end. A
run has failed if its position at the end is further off than three times the RMS of ``ckf`` without the fault.

The column ``beyond`` is the share of readings at full seconds in the fault whose NIS is beyond its 99.9 % limit, by aid. It is
0.1 % for good ones. The column ``doubt`` is that of the diagnostics at the end. The solver ``gated`` has ``aid_gate=0.999``.
The tactical IMU has scale errors that no filter models, so the NEES is above one without a fault, too. The table is in
docs/mathematics/aiding.md#faults.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from rich.console import Console
from rich.table import Table
from scipy import stats
from threadpoolctl import threadpool_limits

import solvers
from sins_env.arrays import Array
from sins_env.evaluation.estimators.guard import Guard
from sins_env.evaluation.play.errors import nees
from sins_env.evaluation.play.loop import Loop
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.tasks.task import EvaluationTask, solver_rng
from sins_env.units import DEG

FAULT_S, DURATION_S, EPOCH_S = (60.0, 120.0), 150.0, 0.2
GATE = 0.999  #: probability that a good reading lies within its gate
SOLVERS = ("ckf", "ckf gated", "student_t_ckf", "huber_ckf", "imm_ekf", "gsf_imm")
FIXES = {"vel_std_mps": 0.1, "pos_std_m": 3.0, "rate_hz": 1.0}
SPOOF = {"spoof_mps2": 0.02, "spoof_s": FAULT_S}
AWAY = {"outages_s": [[30.0, DURATION_S]]}
LOST = {"lock_lost_s": [FAULT_S]}

#: Vehicle, settings of the fixes, sensors without the fault, and what the fault adds to fixes and sensors.
CASES: dict[str, tuple[str, dict[str, Any], dict[str, Any], dict[str, Any], dict[str, Any]]] = {
    "spoof .02 m/s^2, fixes alone": ("car", {}, {}, SPOOF, {}),
    "spoof .02 m/s^2, with odometer": ("car", {}, {"odometer": {}}, SPOOF, {}),
    "spoof .2 m/s^2, with odometer": ("car", {}, {"odometer": {}}, {**SPOOF, "spoof_mps2": 0.2}, {}),
    "log without bottom": ("ship", AWAY, {"dvl": {}}, {}, {"dvl": LOST}),
    "log in water, .2 m/s": ("ship", AWAY, {"dvl": {}}, {}, {"dvl": {**LOST, "without_lock": "water"}}),
    "wheel spins by 10 %": ("car", AWAY, {"odometer": {}}, {}, {"odometer": {"slip_s": [FAULT_S]}}),
    "car slips 3 mrad per m/s^2": ("car", AWAY, {"odometer": {}}, {}, {"odometer": {"slip_mrad_per_mps2": 3.0}}),
    "wheel slips 1 % per m/s^2": ("car", AWAY, {"odometer": {}}, {}, {"odometer": {"slip_per_mps2": 0.01}}),
}


class Played(NamedTuple):
    """What a solver made of R runs; metres, rad."""

    off: Array  #: (2, R) horizontal error at the end of the fault and at the end of the run
    heading: Array  #: (R,) its error at the end
    nees: Array  #: (2,) mean NEES over its expectation, at both times
    beyond: dict[str, float]  #: share of readings in the fault that lie beyond the gate, by aid
    doubt: float  #: median over runs at the end; NaN if the solver does not tell


def task_of(name: str, faulty: bool, seed: int) -> EvaluationTask:
    """Return the task of a case, with its fault or without."""
    vehicle, gps, aids, pull, fault = CASES[name]
    given = {aid: {**fields, **(fault.get(aid, {}) if faulty else {})} for aid, fields in aids.items()}
    return EvaluationTask(
        name=f"{vehicle}-fault",
        what=name,
        source="benchmarks/sensor_faults.py",
        env_id="SINS/NavFlight-v0",
        delta_azimuth_deg=1.0,
        delta_level_arcsec=3600.0,
        suite_seed=seed,
        kwargs={
            "profile": vehicle, "duration": DURATION_S, "epoch": EPOCH_S, "n_sub": 2, "imu": "tactical",
            "gps": {**FIXES, **gps, **(pull if faulty else {})}, "aids": given,
        },
    )  # fmt: skip


def play(task: EvaluationTask, name: str, runs: int) -> Played:
    """Play a solver, ``gated`` or not, on a task."""
    kind, _, gated = name.partition(" ")
    solver = solvers.make(kind, **({"aid_gate": GATE} if gated else {}))
    env = task.make(runs, reveal_truth=True)
    obs, _ = task.reset(env, range(runs), task.suite_seed)
    loop = Loop(env, Guard(solver, runs), obs, [solver_rng(task, kind, run) for run in range(runs)])
    ends = [round(t / EPOCH_S) for t in (FAULT_S[1], DURATION_S)]
    per_second = round(1.0 / EPOCH_S)
    off, fits, seen = [], [], {}
    for k, _, info, _, _ in loop:
        errors = info["errors"]
        if FAULT_S[0] / EPOCH_S < k <= ends[0] and k % per_second == 0:
            told = solver.diagnostics()
            for aid in (key.removesuffix("_nis") for key in told if key.endswith("_nis")):
                nis, limit = told[f"{aid}_nis"], stats.chi2.ppf(GATE, told[f"{aid}_residual"].shape[-1])
                far, count = seen.get(aid, (0, 0))
                seen[aid] = far + int((nis > limit).sum()), count + int(np.isfinite(nis).sum())
        if k in ends:
            error = np.concatenate([errors["phi"], errors["vel"], errors["pos"]], axis=-1)
            off.append(np.hypot(error[:, 6], error[:, 7]))
            fits.append(nees(error, solver.covariance()).mean() / 9.0)
            heading = error[:, 2]
    doubt = float(np.median(solver.diagnostics().get("doubt", np.nan)))
    loop.close()
    beyond = {aid: far / max(count, 1) for aid, (far, count) in seen.items()}
    return Played(np.array(off), heading, np.array(fits), beyond, doubt)


def cells(found: Played, limit: float) -> list[str]:
    """Return the figures of a solver as texts; a run beyond ``limit`` m at the end has failed."""
    off = np.sqrt(np.square(found.off).mean(axis=1))
    failed = int((~(found.off[1] <= limit)).sum())
    beyond = ", ".join(f"{aid} {100.0 * share:.1f} %" for aid, share in found.beyond.items())
    heading = np.sqrt(np.square(found.heading).mean()) / DEG
    return [
        f"{off[0]:.1f}, {off[1]:.1f}", f"{heading:.2f}", f"{failed}", f"{found.nees[0]:.2f}, {found.nees[1]:.2f}", beyond,
        "" if np.isnan(found.doubt) else f"{found.doubt:.2f}",
    ]  # fmt: skip


def summary(rows: Mapping[tuple[str, str], list[str]], runs: int, seed: int) -> Table:
    """Return the table of all cases."""
    table = Table(title=f"faults of sensors, {runs} runs each, seed {seed}")
    for heading in (
        "fault",
        "solver",
        "horizontal m: 120 s, 150 s",
        "heading deg",
        "failed",
        "NEES/9",
        "beyond",
        "doubt",
    ):
        table.add_column(heading, justify="left" if heading in ("fault", "solver", "beyond") else "right")
    for (case, solver), texts in rows.items():
        table.add_row(case, solver, *texts)
    return table


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description="faults of sensors that nobody tells, and robust filters")
    parser.add_argument("cases", nargs="*", metavar="fault", help="beginnings of names; default all")
    parser.add_argument("--runs", type=int, default=24, help="default %(default)s")
    parser.add_argument("--seed", type=int, default=1, help="default %(default)s")
    given = parser.parse_args(arguments)
    names = [name for name in CASES if not given.cases or name.startswith(tuple(given.cases))]
    if not names:
        parser.error(f"{', '.join(given.cases)}: no such fault; allowed: {', '.join(CASES)}")
    rows: dict[tuple[str, str], list[str]] = {}
    total = len(names) * (len(SOLVERS) + 1)
    with threadpool_limits(1), Bar("faults") as bar:
        for name in names:
            sound = play(task_of(name, False, given.seed), SOLVERS[0], given.runs)
            limit = 3.0 * float(np.sqrt(np.square(sound.off[1]).mean()))
            rows[name, "ckf, no fault"] = cells(sound, limit)
            for solver in SOLVERS:
                rows[name, solver] = cells(play(task_of(name, True, given.seed), solver, given.runs), limit)
                bar.update(len(rows), total)
    Console(width=160).print(summary(rows, given.runs, given.seed))


if __name__ == "__main__":
    main()
