"""The verb ``check``: whether an estimator keeps the contract."""

from __future__ import annotations

from argparse import Namespace

from rich.console import Console
from rich.markup import escape

from sins_env.cli.failing import failing
from sins_env.cli.output import RunFailed
from sins_env.evaluation.contract import TOLERANCE, Check, check_estimator


def check(given: Namespace, console: Console) -> int:
    """Print a line per point of the contract.

    Raises:
        RunFailed: the estimator fails a check, or ends its process.
    """
    marks = {True: "[green]pass[/]", False: "[bold red]FAIL[/]", None: "[dim]  - [/]"}

    def show(one: Check) -> None:
        detail = f"  [dim]{escape(one.detail)}[/]" if one.passed is not False else f"  {escape(one.detail)}"
        console.print(f"{marks[one.passed]}  {escape(one.name)}{detail if one.detail else ''}", highlight=False)

    with failing():
        found = check_estimator(
            given.solver,
            dict(given.set),
            show,
            tolerance=given.tolerance or TOLERANCE,
            epoch_timeout_s=given.timeout,
        )
    failed = sum(one.passed is False for one in found)
    if failed:
        raise RunFailed(f"{given.solver} fails {failed} of {len(found)} checks")
    console.print(f"{given.solver} meets the contract", style="green", highlight=False)
    return 0
