"""The verb ``run``: one episode, with its final errors and a figure."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table
from rich.text import Text

from sins_env.cli.failing import failing
from sins_env.cli.output import RunFailed, check_plot, remark, save_figure
from sins_env.evaluation import monte_carlo
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.play.one_run import Course, run_episode
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.replay import tables, track
from sins_env.evaluation.score.quantities import QUANTITIES, run_errors
from sins_env.evaluation.show import numbers, run_figure
from sins_env.evaluation.show.rich_tables import titled
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.units import ARCSEC, DEG


def run(given: Namespace, console: Console) -> int:
    """Run one episode, show its azimuth error meanwhile, and print the table of errors.

    Raises:
        RunFailed: the run raised, was lost, froze, or had failed epochs.
    """
    task, settings = get_task(given.task), dict(given.set)
    check_plot(given.plot)
    with Bar(f"{given.solver} on {task.name}") as bar:

        def watch(k: int, phi: Any, sigma: Any) -> None:
            if k % 10 == 0:
                note = f"azimuth {phi[0, 2] / DEG:+8.3f} deg" if np.isfinite(phi[0, 2]) else ""
                bar.update(k * epoch, total, note)

        epoch, total = monte_carlo.extent(task, 1)
        with failing(f"{given.solver} on {task.name}, run {given.run}"):
            course = run_episode(
                task,
                given.solver,
                given.run,
                given.seed,
                settings=settings,
                observer=watch,
                epoch_timeout_s=given.timeout,
            )
    records = course.records
    if records.status[0] == "raised" and given.traceback:
        for line in records.traceback[0].rstrip().split("\n"):
            remark(line)
    if given.plot:
        save_figure(run_figure.run_figure(task, given.solver, course), given.plot)
    if not records.unfinished[0]:
        console.print(_run_table(given, task, course))
    if records.broken[0] or records.status[0] == "frozen":
        where = "; --traceback shows where" if " raised " in records.reason[0] and not given.traceback else ""
        raise RunFailed(f"{given.solver} on {task.name}, run {given.run}: {records.reason[0]}{where}")
    return 0


def _run_table(given: Namespace, task: EvaluationTask, course: Course) -> Table:
    records = course.records
    title = f"{given.solver} on {task.name}, run {given.run}"
    table = titled(title)
    table.add_column("error")
    scored = records.criteria.scored
    navigates = records.criteria.navigates
    for name in ("at the end", "RMS" if navigates else "RMS, steady", "threshold", "within it from"):
        table.add_column(name, justify="right")
    rows = (
        ("azimuth", 2, DEG, "°"),
        ("east", 0, ARCSEC, '"'),
        ("north", 1, ARCSEC, '"'),
    )
    for name, j, unit, sign in rows:
        time = float(records.t_conv[0, j])
        table.add_row(
            name,
            f"{records.final[0, j] / unit:+.4g}{sign}" if scored else "-",
            f"{numbers.number_text(records.steady_rms[0, j] / unit)}{sign}" if scored else "-",
            f"{records.criteria.delta[j] / unit:g}{sign}",
            "-" if not scored else f"{time:.1f} s" if np.isfinite(time) else Text("not aligned", style="red"),
        )
    if navigates:
        _add_navigation(table, records)
        if scored:
            tables.add_rows(table, track.of_run(task, given.run, course))
    coarse = f" after {records.criteria.coarse_s:g} s of coarse alignment" if records.criteria.coarse_s else ""
    verdict = records.reason[0] or str(records.status[0])
    times = f"times from the start of the fine phase{coarse}{averaging_spans(records.criteria) if navigates else ''}"
    heading = f"no reference to score against; heading at the end {np.degrees(records.heading[0]) % 360:.3f}°"
    table.caption = Text(f"{verdict}; {times if scored else heading}")
    table.caption_justify = "left"
    return table


def averaging_spans(criteria: Criteria) -> str:
    """Return the time spans of the RMS in a navigation task, for the caption."""
    steady = (criteria.num_epochs - criteria.steady_from + 1) * criteria.epoch_s
    return f"; RMS: of angles in the last {steady:g} s, of the others from {(criteria.span_from - 1) * criteria.epoch_s:g} s on"


def _add_navigation(table: Table, records: Records) -> None:
    """Add rows with the lengths of position and velocity errors; the RMS is over the scored span."""
    for name in ("position_h", "position_v", "velocity_h", "velocity_v"):
        quantity = QUANTITIES[name]
        over_time, final = (numbers.number_text(float(found[0]) / quantity.unit) for found in run_errors(records, name))
        cells = (f"{value} {quantity.unit_name}" if records.criteria.scored else "-" for value in (final, over_time))
        table.add_row(quantity.name, *cells, "", "")
