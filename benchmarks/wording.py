"""Figures of leaderboard.json in words, and tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import suite

from sins_env.evaluation.score.verdicts import Measure
from sins_env.evaluation.show.numbers import angle_text, number_text
from sins_env.units import ARCSEC

Entry = Mapping[str, Any]  #: a task, a result or a pair of leaderboard.json
Board = Mapping[str, Any]  #: the whole of it

#: What is said of a verdict against the yardstick.
VERDICTS = {"wins": "wins", "loses": "worse", "equal": "equal within 2 %", "undecided": "not told apart"}


def found(board: Board, task: str, suite_of: str, solver: str | None) -> Entry | None:
    """Return the result of a solver on suite A or B of a task; None if it has not played it."""
    wanted = (task, suite_of, solver)
    return next((one for one in board["results"] if (one["task"], one["suite"], one["solver"]) == wanted), None)


def costs(board: Board, task: str) -> dict[str, float]:
    """Return the cost of a step over that of ckf by solver: on a task of this kind, or where that was not measured, on any."""
    order = sorted(suite.COSTED, key=lambda name: name == suite.costed_for(task))  # the latter replaces the former
    return {
        one["solver"]: one["cost"] for name in order for one in board["results"] if one["task"] == name and one["cost"]
    }


def value(number: float | None, unit: str, beside: float | None = None) -> str:
    """Return a value with its unit, which for an angle ``beside`` another one is that of the other."""
    if number is None:
        return "-"
    if unit != "rad":
        return f"{number_text(number)} {unit}"
    text = angle_text(number / ARCSEC, None if beside is None else beside / ARCSEC)
    return text if text.endswith("°") else f"{text}″"


def estimate(number: float | None, ends: Sequence[float | None], unit: str) -> str:
    """Return a value with its interval."""
    interval = "" if None in ends else f" [{'–'.join(value(end, unit, number) for end in ends)}]"
    return value(number, unit) + interval


def ratio(number: float, ends: Sequence[float | None]) -> str:
    """Return a ratio with its interval."""
    interval = "" if None in ends else f" [{'–'.join(number_text(end) for end in ends if end is not None)}]"
    return number_text(number) + interval


def over_bound(one: Entry, task: Entry) -> str:
    """Return the ratio to the bound, in brackets if the two are not comparable; '-' if there is none."""
    if one["x_bound"] is None:
        return "-"
    text = f"×{ratio(one['x_bound'], one['x_bound_ci'])}"
    return text if Measure(task["cap"], task["bound"], task["bound_holds"]).comparable else f"({text})"


def failed(one: Entry) -> str:
    """Return the failed runs with their interval, such as '0 of 200 [0–1.8 %]'."""
    low, high = (f"{100 * end:.3g}" if end > 0.995 else f"{100 * end:.2g}" for end in one["failed_ci"])
    return f"{round(one['failed'] * one['runs'])} of {one['runs']} [{low}–{high} %]"


def p_value(p: float) -> str:
    """Return a p value to two digits."""
    return "< 0.001" if p < 0.001 else f"{p:.2g}"


def cost(over: float | None) -> str:
    """Return a cost over that of ckf to two digits; '-' if it was not measured."""
    return "-" if over is None else number_text(over, 2)


def name(one: Entry) -> str:
    """Return the solver's name, in bold if it wins against ckf on runs that did not select it."""
    return f"**`{one['solver']}`**" if one["word"] == "wins" and one["suite"] == "B" else f"`{one['solver']}`"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = [head, ["---"] * len(head), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
