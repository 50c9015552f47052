"""Verbs of ``sins-env`` that run something: run, eval, check, bench.

Tables go to standard output, progress and remarks to standard error."""

from __future__ import annotations

import math
from argparse import Namespace
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from sins_env.evaluation import bench as speed
from sins_env.evaluation import monte_carlo, plots, registry, terminal, track, words
from sins_env.evaluation.check import Check, check_estimator
from sins_env.evaluation.criteria import Criteria
from sins_env.evaluation.episode import Course, run_episode
from sins_env.evaluation.executors import Processes, check_executor
from sins_env.evaluation.filling import Evaluation, fill
from sins_env.evaluation.guard import EstimatorError
from sins_env.evaluation.outcome import RunFailed, check_plot, remark, save_figure, titled
from sins_env.evaluation.progress import Bar
from sins_env.evaluation.quantities import QUANTITIES, run_errors
from sins_env.evaluation.records import Records
from sins_env.evaluation.store import Store, canonical
from sins_env.evaluation.tasks import EvaluationTask, get_task
from sins_env.specs import ARCSEC, DEG


def run(given: Namespace, console: Console) -> int:
    """One episode with live errors."""
    task, settings = get_task(given.task), dict(given.set)
    check_plot(given.plot)
    registry.make(given.solver, settings)
    with Bar(f"{given.solver} on {task.name}") as bar:

        def watch(k: int, phi: Any, sigma: Any) -> None:
            if k % 10 == 0:
                note = f"azimuth {phi[0, 2] / DEG:+8.3f} deg" if np.isfinite(phi[0, 2]) else ""
                bar.update(k * epoch, total, note)

        epoch, total = monte_carlo.extent(task, 1)
        # A solver of somebody else gets a process of its own: whatever it does to it, this one says what it was.
        timeout = given.timeout or (None if registry.is_own(given.solver) else math.inf)
        course = run_episode(
            task, given.solver, given.run, given.seed, settings=settings, observer=watch, epoch_timeout_s=timeout
        )
    records = course.records
    if records.status[0] == "raised" and given.traceback:
        remark(records.traceback[0].rstrip())
    if given.plot:
        save_figure(plots.run_figure(task, given.solver, course), given.plot)
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
            f"{words.number(records.steady_rms[0, j] / unit)}{sign}" if scored else "-",
            f"{records.criteria.delta[j] / unit:g}{sign}",
            "-" if not scored else f"{time:.1f} s" if np.isfinite(time) else Text("not aligned", style="red"),
        )
    if navigates:
        _add_navigation(table, records)
        if scored:
            track.add_rows(table, track.of_run(task, given.run, course))
    coarse = f" after {records.criteria.coarse_s:g} s of coarse alignment" if records.criteria.coarse_s else ""
    verdict = records.reason[0] or str(records.status[0])
    times = f"times from the start of the fine phase{coarse}{_spans(records.criteria) if navigates else ''}"
    heading = f"no reference to score against; heading at the end {np.degrees(records.heading[0]) % 360:.3f}°"
    table.caption = f"{verdict}; {times if scored else heading}"
    table.caption_justify = "left"
    return table


def _spans(criteria: Criteria) -> str:
    """What the RMS of a navigation task are over."""
    steady = (criteria.num_epochs - criteria.steady_from + 1) * criteria.epoch_s
    return f"; RMS: of angles in the last {steady:g} s, of the others from {(criteria.span_from - 1) * criteria.epoch_s:g} s on"


def _add_navigation(table: Table, records: Records) -> None:
    """Lengths of the errors of position and velocity; over time from where they count."""
    for name in ("position_h", "position_v", "velocity_h", "velocity_v"):
        quantity = QUANTITIES[name]
        over_time, final = (words.number(float(found[0]) / quantity.unit) for found in run_errors(records, name))
        cells = (f"{value} {quantity.unit_name}" if records.criteria.scored else "-" for value in (final, over_time))
        table.add_row(quantity.name, *cells, "", "")


def _pairs(given: Namespace) -> list[tuple[EvaluationTask, str]]:
    """Every task with every solver, each once; all names are checked before anything runs."""
    tasks = [get_task(name) for name in dict.fromkeys(given.task)]
    solvers = list(dict.fromkeys(given.solver))
    for solver in solvers:
        registry.make(solver, dict(given.set))
    for task in tasks:
        task.make(1).close()
        if task.max_runs is not None and given.runs > task.max_runs:
            remark(f"{task.name}: {task.max_runs} runs, the windows of its recording")
    return [(task, solver) for task in tasks for solver in solvers]


def evaluate(given: Namespace, console: Console) -> int:
    """Evaluate, store as chunks end, then show the table."""
    check_plot(given.plot)
    pairs, settings = _pairs(given), dict(given.set)
    canonical(settings)
    check_executor(given.executor)
    with Store(given.db) as store:
        wanted = [
            Evaluation.of(task, solver, settings, range(min(given.runs, task.max_runs or given.runs)), given.seed)
            for task, solver in pairs
        ]
        for task in {task.name: task for task, _ in pairs}.values():
            store.add_task(task)
        present = next((one for one in wanted if store.runs_of(one.key)), None)
        if present and not given.resume:
            raise ValueError(
                f"{given.db} holds {len(store.runs_of(present.key))} runs of {present.solver} on {present.task.name} already; "
                "they are kept: --resume adds what is missing, --db FILE begins another file"
            )
        fill(
            store,
            wanted,
            given.seed,
            executor=given.executor,
            workers=given.workers,
            chunk=given.chunk,
            epoch_timeout_s=given.timeout,
        )
        results = [store.results(one.key, range(given.runs)) for one in wanted]
    terminal.print_tables(results, console)
    if given.plot:
        save_figure(plots.error_figure(results), given.plot)
    bad = [one for one in results if one.records.broken.any()]
    for one in bad:
        records = one.records
        i = int(np.argmax(records.broken))
        unmeasured = "; its cost was not measured" if one.summary.counts["lost"] and not one.cost else ""
        remark(f"{one.label} on {one.task.name}, run {records.run[i]}: {records.reason[i]}{unmeasured}")
    return 1 if bad else 0


def check(given: Namespace, console: Console) -> int:
    """A line per point of the contract."""
    marks = {True: "[green]pass[/]", False: "[bold red]FAIL[/]", None: "[dim]  - [/]"}

    def show(one: Check) -> None:
        detail = f"  [dim]{escape(one.detail)}[/]" if one.passed is not False else f"  {escape(one.detail)}"
        console.print(f"{marks[one.passed]}  {escape(one.name)}{detail if one.detail else ''}", highlight=False)

    if registry.is_own(given.solver):
        found = check_estimator(given.solver, dict(given.set), show)
    else:  # whatever it does to its process
        registry.make(given.solver, dict(given.set))
        with Processes(1) as worker:
            answer = worker.call(check_estimator, given.solver, dict(given.set))
        if answer is None:
            raise RunFailed(f"{given.solver} ended its process in the middle of the checks")
        found = answer
        for one in found:
            show(one)
    failed = sum(one.passed is False for one in found)
    if failed:
        raise RunFailed(f"{given.solver} fails {failed} of {len(found)} checks")
    console.print(f"{given.solver} meets the contract", style="green", highlight=False)
    return 0


def bench(given: Namespace, console: Console) -> int:
    """Speed, in CPU time on one thread."""
    batches, remarks = speed.fitting(given.solver, given.task, given.runs)
    for text in remarks:
        remark(text)
    try:
        with Bar(f"bench of {given.solver}") as bar:
            speeds = speed.measure(given.solver, given.task, batches=batches, progress=bar.update)
    except EstimatorError as error:
        raise RunFailed(f"{given.solver} on {given.task}: {error}") from error
    table = titled(f"{given.solver} on {given.task}")
    table.add_column("part")
    for name in ("runs", "x real time\nper core", "us per run\nand epoch"):
        table.add_column(name, justify="right")
    for i, one in enumerate(speeds):
        bold = "bold" if one.part == "whole chain" else ""
        cells = (one.part, str(one.runs), f"{one.real_time:,.0f}", f"{one.epoch_us:.2f}")
        table.add_row(*cells, style=bold, end_section=i % 3 == 2)
    table.caption, table.caption_justify = (
        "CPU time, one thread, fine phase; median over blocks of epochs",
        "left",
    )
    console.print(table)
    return 0
