"""The verbs ``navigate`` and ``align``: a recording navigated or aligned, with files, a figure and a summary."""

from __future__ import annotations

import json
from argparse import Namespace
from collections.abc import Mapping
from typing import Any

from rich.console import Console
from rich.table import Table

from sins_env.cli.failing import failing
from sins_env.cli.output import check_plot, remark, save_figure
from sins_env.cli.verbs.sensors import sensor_settings
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.show.rich_tables import titled
from sins_env.evaluation.solution import aligning, files
from sins_env.evaluation.solution.navigating import navigate as navigated
from sins_env.evaluation.solution.solution import Solution
from sins_env.writing.visible import in_json


def navigate(given: Namespace, console: Console) -> int:
    """Navigate a recording; print the summary, warnings, and the files written.

    Raises:
        RunFailed: the estimator failed.
    """
    solution = _solved(given, smooth=given.smooth)
    _show(solution, given, console, solution.facts(), solution.summary())
    return 0


def align(given: Namespace, console: Console) -> int:
    """Align a base at rest; print heading, pitch and roll with their sigmas, and how they converged.

    Raises:
        RunFailed: the estimator failed.
    """
    solution = _solved(given, mode="align")
    course = aligning.course(solution)
    _show(solution, given, console, solution.facts(), {**solution.summary(), "course": course})
    if not given.json:
        console.print(aligning.table(course))
    return 0


def _solved(given: Namespace, **more: Any) -> Solution:
    """Check what is to be written, and return the solution.

    Raises:
        ValueError: files of an unknown format, or a rate or frame that does not fit.
        RunFailed: the estimator failed.
    """
    check_plot(given.figure, "--figure")
    for path in given.out:
        files.check(path, given.frame)
    env: dict[str, Any] = {
        name: getattr(given, name) for name in ("coarse", "epoch", "bridge") if getattr(given, name) is not None
    }
    if given.accept:
        env["accept"] = tuple(given.accept)
    with failing(), Bar(given.recording) as bar:
        return navigated(
            given.recording,
            given.solver,
            window=None if given.window is None else tuple(given.window),
            settings=dict(given.set),
            seed=given.seed,
            epoch_timeout_s=given.timeout,
            progress=bar.update,
            **{**env, **sensor_settings(given), **more},
        )


def _show(
    one: Solution, given: Namespace, console: Console, facts: Mapping[str, str], summary: Mapping[str, Any]
) -> None:
    """Write the files, and print warnings and the summary."""
    found = one.findings
    written(one, given)
    if given.figure:
        save_figure(one.plot(), given.figure)
    for finding in (*found, *one.consistency.warnings):
        remark(f"warning: {finding}")
    if given.json:
        told = [{**finding._asdict(), "span_s": list(finding.span_s)} for finding in found]
        print(json.dumps(in_json({**summary, "findings": told, "files": list(given.out)}), indent=2))
        return
    console.print(facts_table(one, facts))


def facts_table(one: Solution, facts: Mapping[str, str]) -> Table:
    """Return the facts of a solution, a line each."""
    table = titled(f"{one.recording} by {one.solver}{', smoothed' * one.smoothed}")
    table.show_header = False
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    for name, text in facts.items():
        table.add_row(name, text)
    return table


def written(one: Solution, given: Namespace) -> None:
    """Write a solution to the files of ``--out``, with a remark on each."""
    for path in given.out:
        files.save(one, path, rate_hz=given.rate, frame=given.frame)
        remark(f"solution: {path}")
