"""Which filter to take in which situation, decided by the verdicts of leaderboard.json: the tables of docs/choose.md.

The solver to take is the cheapest of those that are as good as the leader. Nobody beats them, and they win against ckf where the
leader does. No pair at up to 800 runs tells them, or a better one, from the leader. A task that has not been played, or that has no
situation, has no row.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import takewhile
from pathlib import Path

import suite
import wording
from wording import Board, Entry

from sins_env.evaluation.show.numbers import number_text

#: What holds for the reader, by the task that plays it.
SITUATIONS: Mapping[str, str] = {
    "sway-white-v0": "all is as told, base sways",
    "sway-markov-v0": "all is as told, and sensor errors wander",
    "flight-lu-gauss-v0": "all is as told, in flight",
    "flight-sun2012-v0": "all is as told, and the heading hardly shows",
    "sway-scratch-v0": "attitude unknown, with a coarse phase",
    "sway-anyheading-v0": "heading unknown, base sways",
    "flight-hotstart30-v0": "heading wrong by 30 deg, in flight",
    "flight-hotstart60-v0": "heading wrong by 60 deg, in flight",
    "flight-hotstart90-v0": "heading wrong by 90 deg, in flight",
    "inmotion-car-v0": "attitude unknown, car under way",
    "inmotion-flight-v0": "attitude unknown, aircraft under way",
    "sway-told-wrong-v0": "noise of the fixes told wrong",
    "flight-zhao2010-v0": "noise of the IMU told wrong, in flight",
    "sway-contaminated-v0": "outliers: a fifth of the fixes is bad",
    "flight-lu-mixture-v0": "the same outliers, in flight",
    "sway-jump-v0": "fixes jump for seconds",
    "sway-heavytail-v0": "fixes with heavy tails",
    "dualantenna-mems-v0": "MEMS IMU and two antennas",
    "gpsdr-v0": "GPS and dead reckoning, MEMS IMU and odometer",
    "car-odometer-v0": "GPS away, with an odometer",
    "ship-dvl-v0": "GPS away, with a Doppler log",
    "tight-v0": "pseudo-ranges, at times too few satellites",
    "static8-v0": "base stands still",
    "vehicle-v0": "parked car that people disturb",
}
PAGE = Path("docs/leaderboard.md").name  #: page that the situations link to, beside their own
CHEAP = 2.0  #: largest cost of a step, over that of ckf, of a solver that counts as cheap


def situations(board: Board) -> str:
    """Return the table with a row for each situation whose task has been played."""
    head = ("situation", "take", "cost", "× bound", "failed", "against `ckf`", "`ckf` there")
    tasks = {task["task"]: task for task in board["tasks"]}
    rows = [row for name, what in SITUATIONS.items() if name in tasks and (row := _row(board, tasks[name], what))]
    return wording.table(head, rows)


def _row(board: Board, task: Entry, what: str) -> tuple[str, ...] | None:
    taken = taken_on(board, task)
    if taken is None:
        return None
    one = _shown(board, taken)
    cost = wording.costs(board, task["task"]).get(one["solver"])
    yardstick = wording.found(board, task["task"], one["suite"], suite.YARDSTICK)
    there = "-" if yardstick is None or yardstick is one else _told(yardstick, task)
    link = f"[{what}]({PAGE}#{task['task']})"
    return (
        link,
        wording.name(one),
        wording.cost(cost),
        wording.over_bound(one, task),
        wording.failed(one),
        _against(one),
        there,
    )


def taken_on(board: Board, task: Entry) -> Entry | None:
    """Return the result on suite A of the solver to take; None if no solver has a rank."""
    costs = wording.costs(board, task["task"])
    good = as_good_as_the_leader(board, task)
    return min(good, key=lambda one: (_rounded(costs.get(one["solver"], math.inf)), one["score"]), default=None)


def as_good_as_the_leader(board: Board, task: Entry) -> list[Entry]:
    """Return the results on suite A of the leader and of the solvers that are as good, the best first, of equals ckf."""
    of_task = [one for one in board["results"] if (one["task"], one["suite"], one["rank"]) == (task["task"], "A", 1)]
    first = sorted(of_task, key=lambda one: (one["score"], one["solver"] != suite.YARDSTICK))
    apart = {
        name
        for one in board["pairs"]
        if (one["task"], one["verdict"]) == (task["task"], "apart") and task["leader"] in (one["a"], one["b"])
        for name in (one["a"], one["b"])
    } - {task["leader"]}
    near = list(takewhile(lambda one: one["solver"] not in apart, first))
    wins = any((one["solver"], one["word"]) == (task["leader"], "wins") for one in near)
    return [one for one in near if one["word"] == "wins" or not wins]


def _rounded(cost: float) -> float:
    """Return a cost as the table shows it, so that its noise does not decide."""
    return float(f"{cost:.2g}")


def _shown(board: Board, one: Entry) -> Entry:
    """Return the result of the same solver on suite B, if it has played it."""
    return wording.found(board, one["task"], "B", one["solver"]) or one


def _told(one: Entry, task: Entry) -> str:
    bound = wording.over_bound(one, task)
    return wording.failed(one) if bound == "-" else f"{bound}, {wording.failed(one)}"


def _against(one: Entry) -> str:
    """Return the ratio to ckf with the verdict, and whether runs that did not select the solver confirm it."""
    if one["solver"] == suite.YARDSTICK:
        return "is `ckf`"
    if one["ratio"] is None or one["word"] is None:
        return "too few runs"
    said = wording.VERDICTS[one["word"]]
    said = "confirmed on suite B" if (one["suite"], one["word"]) == ("B", "wins") else f"{said} on suite {one['suite']}"
    return f"{wording.ratio(one['ratio'], one['ratio_ci'])}, {said}{', fragile' if one['fragile'] else ''}"


def whole(board: Board) -> str:
    """Return the table of the solvers for those who know no situation: of all solvers, and of the cheap ones."""
    head = ("you want", "take", "cost", "nobody beats it on", "somebody beats it on")
    tasks = [task["task"] for task in board["tasks"]]
    rows = []
    for what, most in (("one solver for everything", math.inf), (f"one that costs at most {CHEAP:g} `ckf`", CHEAP)):
        counts = {name: _beaten(board, name) for name in _played_by(board, tasks, most)}
        best = min(counts, key=lambda name: (-sum(not beaten for beaten in counts[name].values()), name), default=None)
        if best is None:
            continue
        costs = [wording.costs(board, task)[best] for task in suite.COSTED if best in wording.costs(board, task)]
        lost = [suite.short(task) for task, beaten in counts[best].items() if beaten]
        played = len(counts[best])
        rows.append(
            (
                what,
                f"`{best}`",
                " to ".join(number_text(cost, 2) for cost in sorted(set(costs))),
                f"{played - len(lost)} of {played} tasks",
                ", ".join(lost) or "-",
            )
        )
    return wording.table(head, rows)


def _played_by(board: Board, tasks: list[str], most: float) -> list[str]:
    """Return the solvers with a rank whose cost is known and at most ``most`` wherever they play."""
    costs = {task: wording.costs(board, task) for task in tasks}
    ranked = [one for one in board["results"] if one["suite"] == "A" and one["rank"] is not None]
    names = dict.fromkeys(one["solver"] for one in ranked)
    return [
        name
        for name in names
        if all(costs[one["task"]].get(name, math.inf) <= most for one in ranked if one["solver"] == name)
    ]


def _beaten(board: Board, solver: str) -> dict[str, bool]:
    """Return by task whether somebody beats a solver there."""
    return {
        one["task"]: one["rank"] > 1
        for one in board["results"]
        if (one["suite"], one["solver"]) == ("A", solver) and one["rank"] is not None
    }
