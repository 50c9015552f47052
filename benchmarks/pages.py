"""Writes the tables of docs/: from leaderboard.json, the catalogue of tasks and the docstrings of the solvers.

python benchmarks/pages.py               after leaderboard.py, or when a task or the docstring of a solver has changed
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path

import choose
import markers
import suite
import wording
import zoo
from wording import Board, Entry, cost, failed, found, over_bound, p_value, ratio, value

from sins_env.cli.output import remark
from sins_env.evaluation.show.numbers import number_text, seconds_text
from sins_env.evaluation.tasks.catalogue import TASKS

ROOT = Path(__file__).resolve().parents[1]
JSON = ROOT / "benchmarks" / "leaderboard.json"
MOST = 4  #: largest number of tasks of a solver in the zoo's table
MOST_NAMED = 5  #: largest number of solvers beside the leader


def page(name: str) -> Path:
    """Return the path of a page of docs."""
    return ROOT / "docs" / f"{name}.md"


def written(document: str, blocks: Mapping[str, Callable[[Board], str]], board: Board) -> str:
    """Return a page with each of its blocks between the markers of the block's name."""
    for block, text in blocks.items():
        document = markers.replaced(document, block, text(board))
    return document


# ---- the leaders of all tasks ----


def leaders(board: Board) -> str:
    """Return the leaderboard with one row per task, what it claims, and a line that tells its provenance."""
    head = ("task", "bound", "`ckf`", "the leader", "leader / `ckf`", "nobody beats either")
    rows = [_task_row(board, task) for task in board["tasks"]]
    return f"{wording.table(head, rows)}\n\n{claims(board)}\n\n{provenance(board)}"


def claims(board: Board) -> str:
    """Return how many comparisons there are, how many wins, and what stands behind them."""
    compared = [one for one in board["results"] if one["suite"] == "A" and one["p_adjusted"] is not None]
    wins = [one for one in compared if one["word"] == "wins"]
    fragile = sum(bool(one["fragile"]) for one in wins)
    rivals = [task for task in board["tasks"] if task["leader"] not in (None, suite.YARDSTICK)]
    judged = [one for task in rivals if (one := _fresh(board, task, task["leader"])) and one["p"] is not None]
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


def _fresh(board: Board, task: Entry, solver: str | None) -> Entry | None:
    return found(board, task["task"], "B", solver)


def _task_row(board: Board, task: Entry) -> tuple[str, ...]:
    yardstick = _fresh(board, task, suite.YARDSTICK) or found(board, task["task"], "A", suite.YARDSTICK)
    one = _fresh(board, task, task["leader"]) or found(board, task["task"], "A", task["leader"])
    if yardstick is None:
        return (suite.short(task["task"]), _bound(task), "-", "-", "-", "-")
    first = "-" if one is None else f"{wording.name(one)} {_told(one, task)}"
    return (suite.short(task["task"]), _bound(task), _told(yardstick, task), first, _against(one), _others(board, task))


def _bound(task: Entry) -> str:
    text = value(task["bound"], task["unit"])
    return f"({text})" if task["bound"] is not None and not task["bound_holds"] else text


def _told(one: Entry, task: Entry) -> str:
    """Return score, ratio to the bound, failed runs and time of a result in words."""
    parts = [wording.estimate(one["score"], one["score_ci"], task["unit"])]
    if one["x_bound"] is not None:
        parts.append(over_bound(one, task))
    parts.append(failed(one).replace(" [", " failed ["))
    if one["time_s"] is not None and one["aligned"] and one["aligned"] > 0.5:
        parts.append(f"{seconds_text(one['time_s'])} s")
    return ", ".join(parts)


def _against(one: Entry | None) -> str:
    """Return the ratio of the leader to ckf, and how sure it is; without suite B it is that of the runs that selected it."""
    if one is None or one["ratio"] is None:
        return "-"
    if one["p"] is None:
        return f"{ratio(one['ratio'], one['ratio_ci'])}, preliminary"
    said = {**wording.VERDICTS, "wins": "confirmed"}[one["word"]]
    if one["suite"] == "A":
        said = "on the runs that selected it, not confirmed"
    return (
        f"{ratio(one['ratio'], one['ratio_ci'])}, p {p_value(one['p'])}: {said}{', fragile' if one['fragile'] else ''}"
    )


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


# ---- every solver on every task ----


def results(board: Board) -> str:
    """Return a section with a table for each task."""
    return "\n".join(_section(board, task) for task in board["tasks"])


def _section(board: Board, task: Entry) -> str:
    head = ("#", "solver", "runs", "failed", "score", "× bound", "median", "time, s", "NEES", "cost", "/ `ckf`", "")
    lines = [one for one in board["results"] if one["task"] == task["task"]]
    order = {"A": 0, "B": 1}
    lines.sort(key=lambda one: (order[one["suite"]], one["rank"] is None, one["rank"] or 0, one["score"] or 0.0))
    rows = [_row(one, task) for one in lines]
    told = f"{task['what']}; {task['score']}"
    told += f", bound {_bound(task)}" if task["bound"] is not None else ", no bound"
    told += f", cap {value(task['cap'], task['unit'])}" if task["cap"] is not None else ""
    pairs = [_pair(one) for one in board["pairs"] if one["task"] == task["task"]]
    after = f"\n{' '.join(pairs)}\n" if pairs else ""
    return f"### {task['task']}\n\n{told}.\n\n{wording.table(head, rows)}\n{after}"


def _row(one: Entry, task: Entry) -> tuple[str, ...]:
    rank = "-" if one["rank"] is None else str(one["rank"])
    time = "-" if one["aligned"] is None else "never" if one["time_s"] is None else seconds_text(one["time_s"])
    over = "-" if one["ratio"] is None else ratio(one["ratio"], one["ratio_ci"])
    p = "" if one["p_adjusted"] is None else f", p {p_value(one['p_adjusted'])}"
    return (
        "B" if one["suite"] == "B" else rank,
        wording.name(one),
        str(one["runs"]),
        failed(one).replace(f" of {one['runs']}", ""),
        wording.estimate(one["score"], one["score_ci"], task["unit"]),
        over_bound(one, task),
        value(one["median"], task["unit"]),
        time,
        "-" if one["nees"] is None else number_text(one["nees"], 2),
        cost(one["cost"]),
        over + p,
        _verdict(one),
    )


def _verdict(one: Entry) -> str:
    """Return the verdict against ckf in words."""
    if one["solver"] == suite.YARDSTICK:
        return "yardstick"
    if one["word"] is None:
        return "preliminary" if one["preliminary"] else ""
    return f"{wording.VERDICTS[one['word']]}{', fragile' if one['fragile'] else ''}"


def _pair(one: Entry) -> str:
    """Return a sentence on two solvers that were looked at up to 800 runs."""
    names = f"`{one['a']}` and `{one['b']}`"
    said = {"apart": "told apart", "equal": "equal within 2 %", "open": "not told apart"}[one["verdict"]]
    return f"{names} are {said} at {one['runs']} runs: {ratio(one['ratio'], one['ratio_ci'])}."


# ---- tasks and solvers ----


def tasks_table(board: Board) -> str:
    """Return the table of all tasks, with what they say of themselves."""
    return wording.table(("task", "what"), [(f"`{task.name}`", task.what) for task in TASKS.values()])


def zoo_table(board: Board) -> str:
    """Return the table of the zoo with one row per solver."""
    head = ("solver", "idea", "source", "cost", "where it wins")
    over = wording.costs(board, suite.COSTED[0])
    rows = [
        (f"`{name}`", zoo.idea(name), zoo.source(name) or "-", cost(over.get(name)), _where(board, name))
        for name in zoo.names()
    ]
    return wording.table(head, rows)


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


#: The generated blocks of each page of docs, by the names of their markers.
PAGES: Mapping[str, Mapping[str, Callable[[Board], str]]] = {
    "choose": {"situations": choose.situations, "whole": choose.whole},
    "leaderboard": {"leaders": leaders, "results": results},
    "tasks": {"tasks": tasks_table},
    "zoo": {"zoo": zoo_table},
}


def main() -> None:
    board = json.loads(JSON.read_text())
    for name, blocks in PAGES.items():
        path = page(name)
        path.write_text(written(path.read_text(), blocks, board))
        remark(f"tables: {path}")


if __name__ == "__main__":
    main()
