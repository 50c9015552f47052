"""Writes the tables of README: tasks from the catalogue, leaderboard and zoo from leaderboard.json and the docstrings.

python benchmarks/readme.py              after leaderboard.py, or when a task or the docstring of a solver has changed
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import markers
import suite
import zoo

from sins_env.cli.output import remark
from sins_env.evaluation.show.numbers import angle_text, number_text
from sins_env.evaluation.tasks.catalogue import TASKS

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
JSON = ROOT / "benchmarks" / "leaderboard.json"
BEST = 3  #: number of solvers of a task in the leaderboard
SHARE = 0.1  #: least number of runs of one of the best solvers, as a share of those of ckf
MOST = 4  #: largest number of tasks of a solver in the zoo's table
WORTH = 0.99  #: a larger ratio of errors does not count as a win, even if its interval is below 1

Entry = dict[str, Any]  #: a task or a result of leaderboard.json


def written(document: str, board: dict[str, Any]) -> str:
    """Return ``document`` with the tables between their markers."""
    document = markers.replaced(document, "leaderboard", leaderboard(board))
    document = markers.replaced(document, "tasks", tasks_table())
    return markers.replaced(document, "zoo", zoo_table(board))


def leaderboard(board: dict[str, Any]) -> str:
    """Return the leaderboard with one row per task, and a line that tells its provenance."""
    head = ("task", "runs", "bound", "`ckf` [95 %]", "the best: error, × bound, aligned")
    rows = [_task_row(task, _of_task(board, task["task"])) for task in board["tasks"]]
    made = board["provenance"]
    first, last = (moment.partition(" ")[0] for moment in made["started"])
    when = first if first == last else f"{first} to {last}"
    packages = ", ".join(f"{name} {made['versions'][name]}" for name in ("python", "numpy", "scipy"))
    return f"{_table(head, rows)}\n\nMade {when} by code {made['code']} ({packages}), suite seed 0."


def tasks_table() -> str:
    """Return the table of all tasks, with what they say of themselves."""
    return _table(("task", "what"), [(f"`{task.name}`", task.what) for task in TASKS.values()])


def _task_row(task: Entry, entries: Sequence[Entry]) -> tuple[str, ...]:
    yardstick = next(one for one in entries if one["solver"] == suite.YARDSTICK)
    bound = _value(task["bound"], task["unit"])
    if task["bound_holds"] is False and task["bound"] is not None:
        bound = f"({bound})"
    best = []
    for one in _best_first(task, [one for one in entries if one["runs"] >= SHARE * yardstick["runs"]])[:BEST]:
        other = f" ({one['runs']} runs)" if one["runs"] != yardstick["runs"] else ""
        best.append(f"{_strong(one)} {_told(one, task)}{other}")
    return (_short(task["task"]), str(yardstick["runs"]), bound, _told(yardstick, task, interval=True), "; ".join(best))


def _best_first(task: Entry, entries: Sequence[Entry]) -> list[Entry]:
    """Sort the results by their ratio to ckf over common runs, which needs no equal numbers of runs; else by rank."""
    if task["ranked_by"] == "score":
        return sorted(entries, key=lambda one: one["paired"]["ratio"] if one["paired"] else 1.0)
    if task["ranked_by"] is None:
        return sorted(entries, key=lambda one: math.inf if one["score"] is None else one["score"])
    return list(entries)


def _strong(one: Entry) -> str:
    """Return the solver's name, in bold if it is better than ckf beyond chance."""
    return f"**`{one['solver']}`**" if _wins(one) else f"`{one['solver']}`"


def _told(one: Entry, task: Entry, interval: bool = False) -> str:
    """Return an error as text, with its ratios and the share of aligned or failed runs."""
    text = _value(one["score"], task["unit"])
    if interval and None not in one["interval"]:
        text += f" [{'–'.join(_value(end, task['unit']) for end in one['interval'])}]"
    if task["ranked_by"] == "failures":
        return f"{text}, {one['failed']} of {one['runs']} failed"
    if task["bound"] is not None:
        text += f", ×{number_text(one['bound_ratio'])}"
    if one["paired"] and task["ranked_by"] == "score":
        text += f", {number_text(one['paired']['ratio'], 2)} of ckf"
    return text if task["ranked_by"] is None else f"{text}, {100 * one['success']:.0f} %"


def _value(value: float | None, unit: str) -> str:
    if value is None:
        return "-"
    text = angle_text(value) if unit == "arcsec" else number_text(value)
    return text + ("" if text.endswith("°") else {"arcsec": "″", "deg": "°"}.get(unit, f" {unit}"))


def _wins(one: Entry) -> bool:
    """Return whether the whole interval shows it better than ckf, in the ratio of errors or in failed runs."""
    paired = one["paired"]
    return bool(paired) and (_smaller(paired) or paired["failures_interval"][1] < 0)


def _smaller(paired: Entry) -> bool:
    return paired["apart"] and paired["ratio"] < WORTH


def zoo_table(board: dict[str, Any]) -> str:
    """Return the table of the zoo with one row per solver."""
    head = ("solver", "idea", "source", "cost", "where it wins")
    costs = {one["solver"]: one["cost"] for one in _of_task(board, suite.COSTED[0])}
    rows = [
        (f"`{name}`", zoo.idea(name), zoo.source(name) or "-", _cost(costs.get(name)), _where(board, name))
        for name in zoo.names()
    ]
    return _table(head, rows)


def _cost(ratio: float | None) -> str:
    return "-" if ratio is None else number_text(ratio, 2)


def _where(board: dict[str, Any], solver: str) -> str:
    """Return the tasks that a solver wins, the best first; '-' if there is none."""
    ranked_by = {task["task"]: task["ranked_by"] for task in board["tasks"]}
    won = []
    for one in board["results"]:
        if one["solver"] != solver or not _wins(one):
            continue
        name, paired = _short(one["task"]), one["paired"]
        fewer = paired["failures_interval"][1] < 0
        if fewer and (ranked_by[one["task"]] == "failures" or not _smaller(paired)):
            before = one["failed"] - round(paired["failures"] * paired["runs"])
            won.append((one["failed"] / max(before, 1), f"{name} {one['failed']} failed, not {before}"))
        else:
            won.append((paired["ratio"], f"{name} {number_text(paired['ratio'], 2)}"))
    told = [text for _, text in sorted(won)]
    return ", ".join(told[:MOST]) + (f" and {len(told) - MOST} more" if len(told) > MOST else "") or "-"


def _of_task(board: dict[str, Any], task: str) -> list[Entry]:
    return [one for one in board["results"] if one["task"] == task]


def _short(task: str) -> str:
    return task.removesuffix("-v0").removeprefix("sway-").removeprefix("flight-")


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    document = README.read_text()
    README.write_text(written(document, json.loads(JSON.read_text())))
    remark(f"tables: {README}")


if __name__ == "__main__":
    main()
