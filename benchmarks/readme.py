"""Writes the tables of README and `docs/leaderboard.md`: from leaderboard.json, the catalogue and the docstrings of the solvers.

python benchmarks/readme.py              after leaderboard.py, or when a task or the docstring of a solver has changed
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import markers
import suite
import zoo

from sins_env.cli.output import remark
from sins_env.evaluation.score.verdicts import Measure
from sins_env.evaluation.show.numbers import angle_text, number_text, seconds_text
from sins_env.evaluation.tasks.catalogue import TASKS
from sins_env.units import ARCSEC

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
PAGE = ROOT / "docs/leaderboard.md"
JSON = ROOT / "benchmarks" / "leaderboard.json"
MOST = 4  #: largest number of tasks of a solver in the zoo's table
MOST_NAMED = 5  #: largest number of solvers beside the leader in README

Entry = dict[str, Any]  #: a task, a result or a pair of leaderboard.json
Board = dict[str, Any]


def written(document: str, board: Board) -> str:
    """Return README with the tables between their markers."""
    document = markers.replaced(document, "leaderboard", leaderboard(board))
    document = markers.replaced(document, "tasks", tasks_table())
    return markers.replaced(document, "zoo", zoo_table(board))


# ---- README ----


def leaderboard(board: Board) -> str:
    """Return the leaderboard with one row per task, what it claims, and a line that tells its provenance."""
    head = ("task", "bound", "`ckf`", "the leader", "leader / `ckf`", "nobody beats either")
    rows = [_task_row(board, task) for task in board["tasks"]]
    return f"{_table(head, rows)}\n\n{claims(board)}\n\n{provenance(board)}"


def claims(board: Board) -> str:
    """Return how many comparisons there are, how many wins, and what stands behind them."""
    compared = [one for one in board["results"] if one["suite"] == "A" and one["p_adjusted"] is not None]
    wins = [one for one in compared if one["word"] == "wins"]
    fragile = sum(bool(one["fragile"]) for one in wins)
    rivals = [task for task in board["tasks"] if task["leader"] not in (None, suite.YARDSTICK)]
    judged = [one for task in rivals if (one := fresh(board, task)) and one["p"] is not None]
    confirmed = sum(one["word"] == "wins" for one in judged)
    tasks = {one["task"] for one in compared}
    return (
        f"On {len(tasks)} tasks {len(compared)} solvers are compared with `ckf`, with Holm's adjustment within each task: "
        f"{len(wins)} wins, {fragile} of them fragile. One task in twenty may hold a false win. "
        f"On runs that did not select it, the leader wins against `ckf` on {confirmed} of {len(judged)} tasks."
    )


def provenance(board: Board) -> str:
    """Return which code made the board, when, and with which packages."""
    made = board["provenance"]
    first, last = (moment.partition(" ")[0] for moment in made["started"])
    when = first if first == last else f"{first} to {last}"
    packages = ", ".join(f"{name} {made['versions'][name]}" for name in ("python", "numpy", "scipy"))
    adopted = "".join(
        f" Rows of code {one['before']} count too, for {one['compared']} of them were made again and are equal."
        for one in made["adopted"]
    )
    return f"Made {when} by code {made['code']} ({packages}), suite seeds 0 (A) and 1 (B).{adopted}"


def fresh(board: Board, task: Entry, solver: str | None = None) -> Entry | None:
    """Return the result of the leader, or of another solver, on suite B; None if it has not played it."""
    return _find(board, task["task"], "B", solver or task["leader"])


def _find(board: Board, task: str, name: str, solver: str | None) -> Entry | None:
    wanted = (task, name, solver)
    return next((one for one in board["results"] if (one["task"], one["suite"], one["solver"]) == wanted), None)


def _task_row(board: Board, task: Entry) -> tuple[str, ...]:
    yardstick = fresh(board, task, suite.YARDSTICK) or _find(board, task["task"], "A", suite.YARDSTICK)
    one = fresh(board, task) or _find(board, task["task"], "A", task["leader"])
    if yardstick is None:
        return (suite.short(task["task"]), _bound(task), "-", "-", "-", "-")
    first = "-" if one is None else f"{_name(one)} {_told(one, task)}"
    return (suite.short(task["task"]), _bound(task), _told(yardstick, task), first, _against(one), _others(board, task))


def _bound(task: Entry) -> str:
    text = _value(task["bound"], task["unit"])
    return f"({text})" if task["bound"] is not None and not task["bound_holds"] else text


def _name(one: Entry) -> str:
    """Return the solver's name, in bold if it wins against ckf on runs that did not select it."""
    return f"**`{one['solver']}`**" if one["word"] == "wins" and one["suite"] == "B" else f"`{one['solver']}`"


def _over(one: Entry, task: Entry) -> str:
    """Return the ratio to the bound, in brackets if the two are not comparable; '-' if there is none."""
    if one["x_bound"] is None:
        return "-"
    text = f"×{_ratio(one['x_bound'], one['x_bound_ci'])}"
    return text if Measure(task["cap"], task["bound"], task["bound_holds"]).comparable else f"({text})"


def _told(one: Entry, task: Entry) -> str:
    """Return score, ratio to the bound, failed runs and time of a result in words."""
    parts = [_estimate(one["score"], one["score_ci"], task["unit"])]
    if one["x_bound"] is not None:
        parts.append(_over(one, task))
    parts.append(_failed(one))
    if one["time_s"] is not None and one["aligned"] and one["aligned"] > 0.5:
        parts.append(f"{seconds_text(one['time_s'])} s")
    return ", ".join(parts)


def _against(one: Entry | None) -> str:
    """Return the ratio of the leader to ckf, and how sure it is; without suite B it is that of the runs that selected it."""
    if one is None or one["ratio"] is None:
        return "-"
    if one["p"] is None:
        return f"{_ratio(one['ratio'], one['ratio_ci'])}, preliminary"
    said = {"wins": "confirmed", "equal": "equal within 2 %", "loses": "worse", "undecided": "not told apart"}[
        one["word"]
    ]
    if one["suite"] == "A":
        said = "on the runs that selected it, not confirmed"
    return f"{_ratio(one['ratio'], one['ratio_ci'])}, p {_p(one['p'])}: {said}{', fragile' if one['fragile'] else ''}"


def _others(board: Board, task: Entry) -> str:
    """Return the other solvers of rank 1, the best first."""
    first = [
        one
        for one in board["results"]
        if (one["task"], one["suite"], one["rank"]) == (task["task"], "A", 1) and one["solver"] != task["leader"]
    ]
    names = [f"`{one['solver']}`" for one in sorted(first, key=lambda one: one["score"])]
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more or "-"


# ---- numbers in words ----


def _value(value: float | None, unit: str, beside: float | None = None) -> str:
    """Return a value with its unit, which for an angle ``beside`` another one is that of the other."""
    if value is None:
        return "-"
    if unit != "rad":
        return f"{number_text(value)} {unit}"
    text = angle_text(value / ARCSEC, None if beside is None else beside / ARCSEC)
    return text if text.endswith("°") else f"{text}″"


def _estimate(value: float | None, ends: Sequence[float | None], unit: str) -> str:
    interval = "" if None in ends else f" [{'–'.join(_value(end, unit, value) for end in ends)}]"
    return _value(value, unit) + interval


def _ratio(value: float, ends: Sequence[float | None]) -> str:
    interval = "" if None in ends else f" [{'–'.join(number_text(end) for end in ends if end is not None)}]"
    return number_text(value) + interval


def _failed(one: Entry) -> str:
    """Return the failed runs with their interval, such as '0 of 200 failed [0–1.8 %]'."""
    low, high = (f"{100 * end:.3g}" if end > 0.995 else f"{100 * end:.2g}" for end in one["failed_ci"])
    return f"{round(one['failed'] * one['runs'])} of {one['runs']} failed [{low}–{high} %]"


def _p(p: float) -> str:
    return "< 0.001" if p < 0.001 else f"{p:.2g}"


# ---- docs/leaderboard.md ----

PREFACE = """# Leaderboard

Every solver of the default suite on every task that it plays, made by `make leaderboard` from `benchmarks/leaderboard.json`.
[Tasks and scores](../docs/tasks_and_scores.md) defines the figures. Intervals are of 95 %.

* **failed**: runs beyond three times the cap or a level's threshold, or that raised, froze or were lost.
* **score**: root of the mean squared error of a run, none counted beyond the cap. It ranks.
* **× bound**: score over the Cramér-Rao bound, adjusted by the luck of the bound's own filter in the same runs.
  In brackets the bound is only a reference, or the cap is below 2.5 bounds and takes part of the errors away.
* **median**: the error of a typical run. **time**: median time to alignment, from the start of the fine phase.
* **/ `ckf`**: ratio of the scores in the same runs, with the p value of sign flips, Holm-adjusted for all solvers of the task.
* **#**: one more than the number of solvers that beat it. Those that share rank 1 hold the best one with 95 % probability.

A win is **fragile** if one more run, in which the winner fails, undoes it. Fewer than 200 runs are preliminary and give no
verdict. The figures of a leader are too good on suite A, which selected it; those of suite B are not.
"""


def page(board: Board) -> str:
    """Return the page with a table for each task."""
    parts = [PREFACE, f"{claims(board)}\n\n{provenance(board)}\n"]
    return "\n".join([*parts, *(_section(board, task) for task in board["tasks"])])


def _section(board: Board, task: Entry) -> str:
    head = ("#", "solver", "runs", "failed", "score", "× bound", "median", "time, s", "NEES", "cost", "/ `ckf`", "")
    lines = [one for one in board["results"] if one["task"] == task["task"]]
    order = {"A": 0, "B": 1}
    lines.sort(key=lambda one: (order[one["suite"]], one["rank"] is None, one["rank"] or 0, one["score"] or 0.0))
    rows = [_row(one, task) for one in lines]
    told = f"{task['what']}; {task['score']}"
    told += f", bound {_bound(task)}" if task["bound"] is not None else ", no bound"
    told += f", cap {_value(task['cap'], task['unit'])}" if task["cap"] is not None else ""
    pairs = [_pair(one) for one in board["pairs"] if one["task"] == task["task"]]
    return f"## {task['task']}\n\n{told}.\n\n{_table(head, rows)}\n" + (f"\n{' '.join(pairs)}\n" if pairs else "")


def _row(one: Entry, task: Entry) -> tuple[str, ...]:
    rank = "-" if one["rank"] is None else str(one["rank"])
    time = "-" if one["aligned"] is None else "never" if one["time_s"] is None else seconds_text(one["time_s"])
    ratio = "-" if one["ratio"] is None else _ratio(one["ratio"], one["ratio_ci"])
    p = "" if one["p_adjusted"] is None else f", p {_p(one['p_adjusted'])}"
    return (
        "B" if one["suite"] == "B" else rank,
        _name(one),
        str(one["runs"]),
        _failed(one).partition(" of")[0] + _failed(one).partition("failed")[2],
        _estimate(one["score"], one["score_ci"], task["unit"]),
        _over(one, task),
        _value(one["median"], task["unit"]),
        time,
        "-" if one["nees"] is None else number_text(one["nees"], 2),
        _cost(one["cost"]),
        ratio + p,
        _verdict(one),
    )


def _verdict(one: Entry) -> str:
    """Return the verdict against ckf in words."""
    if one["solver"] == suite.YARDSTICK:
        return "yardstick"
    if one["word"] is None:
        return "preliminary" if one["preliminary"] else ""
    said = {"wins": "wins", "loses": "worse", "equal": "equal within 2 %", "undecided": "not told apart"}[one["word"]]
    return f"{said}, fragile" if one["fragile"] else said


def _pair(one: Entry) -> str:
    """Return a sentence on two solvers that were looked at up to 800 runs."""
    names = f"`{one['a']}` and `{one['b']}`"
    ratio = _ratio(one["ratio"], one["ratio_ci"])
    said = {"apart": "told apart", "equal": "equal within 2 %", "open": "not told apart"}[one["verdict"]]
    return f"{names} are {said} at {one['runs']} runs: {ratio}."


# ---- other tables ----


def tasks_table() -> str:
    """Return the table of all tasks, with what they say of themselves."""
    return _table(("task", "what"), [(f"`{task.name}`", task.what) for task in TASKS.values()])


def zoo_table(board: Board) -> str:
    """Return the table of the zoo with one row per solver."""
    head = ("solver", "idea", "source", "cost", "where it wins")
    costs = {one["solver"]: one["cost"] for one in board["results"] if one["task"] == suite.COSTED[0]}
    rows = [
        (f"`{name}`", zoo.idea(name), zoo.source(name) or "-", _cost(costs.get(name)), _where(board, name))
        for name in zoo.names()
    ]
    return _table(head, rows)


def _cost(ratio: float | None) -> str:
    return "-" if ratio is None else number_text(ratio, 2)


def _where(board: Board, solver: str) -> str:
    """Return the tasks that a solver wins against ckf on suite A, the best first; '-' if there is none."""
    won = sorted(
        (
            one["ratio"],
            f"{suite.short(one['task'])} {number_text(one['ratio'], 2)}{' (fragile)' if one['fragile'] else ''}",
        )
        for one in board["results"]
        if (one["solver"], one["suite"], one["word"]) == (solver, "A", "wins")
    )
    told = [text for _, text in won]
    return ", ".join(told[:MOST]) + (f" and {len(told) - MOST} more" if len(told) > MOST else "") or "-"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *([cell.replace("|", "\\|") for cell in row] for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    board = json.loads(JSON.read_text())
    README.write_text(written(README.read_text(), board))
    PAGE.write_text(page(board))
    remark(f"tables: {README}, {PAGE}")


if __name__ == "__main__":
    main()
