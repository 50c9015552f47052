"""Verbs of a contest: submit writes a bundle, judge reads one."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from rich.console import Console

from sins_env.cli.output import RunFailed, remark
from sins_env.evaluation.contest import bundle, judging, submitting
from sins_env.evaluation.play.executors import runner
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.store.store import Store
from sins_env.reading.files import size
from sins_env.writing.visible import visible

FEW = 200  #: number of runs below which a board gives no verdict


def submit(given: Namespace, console: Console) -> int:
    """Check the rows of a solver, and write a bundle.

    Raises:
        RunFailed: rows that the present code does not make.
    """
    out = Path(given.out)
    if not out.resolve().parent.is_dir():
        raise ValueError(f"--out {out}: the directory does not exist")
    settings = dict(given.set) if given.set else None
    try:
        with runner(None, given.workers, given.rows) as where, Bar(f"checking {given.file}") as bar:
            made = submitting.submit(
                Path(given.file),
                given.solver,
                out,
                tasks=given.task,
                settings=settings,
                rows=given.rows,
                draw=given.draw,
                where=where,
                progress=bar.update,
            )
    except submitting.Differs as error:
        for text in error.found:
            remark(text)
        raise RunFailed(f"{given.file}: {len(error.found)} differences, and {out} is not written") from error
    said = made.submission
    for task, runs in said.runs.items():
        if runs < FEW:
            remark(f"{task}: {runs} runs are preliminary; a verdict needs {FEW}")
    _print_claim(said)
    print(f"{out}: {size(made.size)}, {sum(said.runs.values())} runs, {said.checked} of them made again: equal to 1e-9")
    return 0


def judge(given: Namespace, console: Console) -> int:
    """Check a bundle, print what it claims, and show it beside the rows of a hidden suite."""
    with judging.opened(Path(given.bundle)) as (said, folder):
        _print_claim(said)
        judging.check(said, folder)
        for text in judging.remarks(said):
            remark(text)
        if given.db:
            with Store(given.db, read_only=True) as hidden:
                console.print(judging.table(judging.beside(said, folder, hidden)))
        if given.out:
            bundle.keep(folder, Path(given.out))
            print(f"{given.out}: rows and Python files; play them there with --solver {visible(said.solver)} --seed -")
    return 0


def _print_claim(said: bundle.Submission) -> None:
    """Print what a bundle says of itself, a line each."""
    settings = ", ".join(f"{name}={value}" for name, value in sorted(said.settings.items()))
    print(f"solver {visible(said.solver)}" + (f" with {visible(settings)}" if settings else ""))
    for name, value in (
        ("sources", bundle.sources_hash(said.files) or "those of this project"),
        ("rows", said.files[bundle.RESULTS]),
        ("code", said.code),
        ("made", said.made),
    ):
        print(f"{name:8}{visible(value)}")
