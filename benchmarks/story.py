"""The figures of README and docs: accuracy against cost, failed runs, and errors against time, from JSON and results file."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import matplotlib
import numpy as np
import suite
import wording
from matplotlib.transforms import Bbox

from sins_env.cli.output import remark
from sins_env.evaluation.report.page_figures import pareto_front
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.error_figure import band, size_of
from sins_env.evaluation.show.style import COLOURS, bound_style, finish, new_figure
from sins_env.units import DEG

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Entry = Mapping[str, Any]  #: a task or a result of leaderboard.json
Point = tuple[float, float]  #: cost and score

#: Tasks of the figure of costs, with the titles of their panels and the solvers that are named in addition to the front.
COSTS = {
    "sway-white-v0": ("nothing is wrong", ("ckf", "gsf_imm", "two_pass", "fgo")),
    "sway-told-wrong-v0": ("told noise is wrong", ("ckf", "gsf_imm", "imm_ekf", "vb_ckf")),
    "sway-anyheading-v0": ("heading unknown", ("ckf", "gsf_imm", "inekf")),
    "flight-lu-mixture-v0": ("flight, a fifth of the fixes is bad", ("ckf", "gsf_imm", "gm_ekf")),
}
#: Tasks of the figure of errors, with the titles of their panels and the solvers that are drawn.
TIMES = {
    "sway-told-wrong-v0": ("told noise is wrong", ("ckf", "aukf", "gsf_imm")),
    "sway-anyheading-v0": ("heading unknown", ("ckf", "inekf", "gsf_imm")),
}
RECOMMENDED = "gsf_imm"
SAMPLES = 80  #: number of points of a curve
BETTER = 0.95  #: a solver of the front is named if its score is at most so many times that of the next cheaper one
WIDTH = 7.2  #: width of a figure in inches: letters of 9 points are 7 pixels high on a telephone
#: Values that an axis of ratios labels, if it spans less than a factor of two, and if more.
TICKS = ((0.8, 0.9, 1, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2), (0.5, 1, 1.5, 2, 3, 5, 10, 20, 50, 100))
#: Places of a label around its point, nearest first: distances in points, and directions in degrees.
DISTANCES, DIRECTIONS = (6, 13, 22, 33, 46, 60, 75), (35, -35, 145, -145, 90, -90, 0, 180)
LINE = 0.4  #: what it counts that a label lies on a line, where a point counts 1


def draw(board: Mapping[str, Any], played: Mapping[str, Sequence[Results]], folder: Path) -> None:
    """Write ``cost.svg``, ``failures.svg`` and ``time.svg``, for the tasks that there are."""
    folder.mkdir(parents=True, exist_ok=True)
    figures = {"cost": cost_figure(board), "failures": failure_figure(board), "time": time_figure(played)}
    for name, figure in figures.items():
        path = folder / f"{name}.svg"
        with matplotlib.rc_context({"svg.hashsalt": name}):  # equal runs give an equal file
            figure.savefig(path, metadata={"Date": None})
        remark(f"figure: {path}, {path.stat().st_size / 1e3:.0f} kB")


# ---- score against cost ----


def cost_figure(board: Mapping[str, Any]) -> Figure:
    """Draw the score over the bound against the cost of a step over that of ckf; solvers of the front are named."""
    figure = new_figure(WIDTH, 6.4)
    panels = figure.subplots(2, 2, sharex=True).ravel()
    points = [placed(board, task) for task in COSTS]
    for axes, (title, _), there in zip(panels, COSTS.values(), points, strict=False):
        finish(axes, title, xscale="log", yscale="log")
        if there:
            _costs(axes, there)
    for axes in panels[2:]:
        axes.set_xlabel("cost of a step / ckf")
    for axes in panels[::2]:
        axes.set_ylabel("score / bound")
    figure.canvas.draw()  # labels find their places when the axes have theirs
    for axes, (_, named), there in zip(panels, COSTS.values(), points, strict=False):
        if there:
            _name(axes, there, named)
    return figure


def placed(board: Mapping[str, Any], task: str) -> dict[str, Point]:
    """Return cost and score over the bound by solver, of those that have both on this task; few runs do not count."""
    cost = wording.costs(board, task)
    return {
        one["solver"]: (cost[one["solver"]], one["x_bound"])
        for one in board["results"]
        if (one["task"], one["suite"]) == (task, "A")
        and one["x_bound"]
        and cost.get(one["solver"])
        and one["solver"] not in suite.AT_REST
    }


def _front(points: Mapping[str, Point]) -> list[Point]:
    return pareto_front(list(points.values()))


def _colour(name: str, points: Mapping[str, Point]) -> str:
    return COLOURS[1] if name == suite.YARDSTICK else COLOURS[0] if points[name] in _front(points) else "0.55"


def _costs(axes: Axes, points: Mapping[str, Point]) -> None:
    best = _front(points)
    axes.step(*np.array(best).T, where="post", color=COLOURS[0], linewidth=1, linestyle=(0, (2, 2)), zorder=1)
    axes.axhline(1.0, color="black", linewidth=1.1, zorder=1)
    for name, point in points.items():
        axes.plot(*point, "o", color=_colour(name, points), markersize=5, markeredgewidth=0, zorder=2)
    axes.margins(x=0.12, y=0.15)
    low, high = axes.get_ylim()
    axes.set_yticks([tick for tick in TICKS[int(high > 2 * low)] if low <= tick <= high])
    axes.set_yticks([], minor=True)


def _name(axes: Axes, points: Mapping[str, Point], named: Sequence[str]) -> None:
    best = _front(points)
    leaders = {best[0], best[-1], *(point for before, point in pairwise(best) if point[1] < BETTER * before[1])}
    told = [name for name, point in points.items() if point in leaders or name in named]
    labels(axes, {name: points[name] for name in told}, points.values(), {name: _colour(name, points) for name in told})


def strokes(axes: Axes) -> list[Bbox]:
    """Return the pieces of the lines that are drawn along the axes, in pixels."""
    room, out = axes.get_window_extent(), []
    for line in axes.lines:
        if line.get_linestyle() != "None":
            corners = line.get_transform().transform(line.get_path().vertices)
            out += [Bbox([np.minimum(a, b), np.maximum(a, b)]).padded(1) for a, b in pairwise(corners)]
    return [one for one in out if one.overlaps(room)]


def labels(axes: Axes, named: Mapping[str, Point], points: Sequence[Point], colours: Mapping[str, str]) -> list[Any]:
    """Write a name beside each point where it covers no name, point or line, with a line to a point that is far."""
    scale, lines = axes.figure.dpi / 72.0, strokes(axes)
    dots = [Bbox.from_bounds(x - 4, y - 4, 8, 8) for x, y in axes.transData.transform(list(points))]
    room, taken, out = axes.get_window_extent(), [], []
    for name, point in sorted(named.items(), key=lambda item: -item[1][1]):
        text = axes.annotate(name, point, (0, 0), textcoords="offset points", fontsize=9, color=colours[name], zorder=4)
        box = text.get_window_extent()
        tried = []
        for far in DISTANCES:
            for angle in DIRECTIONS:
                dx, dy = far * math.cos(math.radians(angle)), far * math.sin(math.radians(angle))
                dx -= box.width / scale * (0.5 - 0.5 * math.cos(math.radians(angle)))
                dy -= box.height / scale * (0.5 - 0.5 * math.sin(math.radians(angle)))
                there = box.translated(dx * scale, dy * scale)
                outside = not (
                    room.x0 <= there.x0 and there.x1 <= room.x1 and room.y0 <= there.y0 and there.y1 <= room.y1
                )
                hits = 10 * sum(there.overlaps(one) for one in taken) + sum(there.overlaps(one) for one in dots)
                hits += LINE * sum(there.overlaps(one) for one in lines)
                tried.append((hits + 5 * outside, far, len(tried), dx, dy, there))
        _, far, _, dx, dy, there = min(tried)[:6]
        text.remove()
        line = {"arrowstyle": "-", "color": colours[name], "linewidth": 0.6, "shrinkA": 0, "shrinkB": 3}
        style = {"fontsize": 9, "color": colours[name], "zorder": 4}
        if far > DISTANCES[1]:
            style["arrowprops"] = line
        out.append(axes.annotate(name, point, (dx, dy), textcoords="offset points", **style))
        taken.append(there.padded(4, 1))
    return out


# ---- failed runs ----


def failure_figure(board: Mapping[str, Any]) -> Figure:
    """Draw the share of failed runs with its 95 % interval, a row for each task: the yardstick, the leader, the recommended."""
    names = [task["task"] for task in board["tasks"] if _most_runs(board, task["task"]) >= suite.LEAST_SHOWN]
    names = names or [task["task"] for task in board["tasks"]]
    figure = new_figure(WIDTH, 0.3 * len(names) + 1.2)
    axes = figure.subplots()
    leader = {task["task"]: task["leader"] for task in board["tasks"]}
    kinds = (
        (lambda name: suite.YARDSTICK, suite.YARDSTICK, COLOURS[1], "o", 0.22),
        (leader.get, "smallest score", COLOURS[2], "D", 0.0),
        (lambda name: RECOMMENDED, RECOMMENDED, COLOURS[0], "s", -0.22),
    )
    for which, label, colour, marker, up in kinds:
        for i, name in enumerate(names):
            one = next(
                (r for r in board["results"] if (r["task"], r["suite"], r["solver"]) == (name, "A", which(name))), None
            )
            if one:
                y, (low, high) = len(names) - 1 - i + up, one["failed_ci"]
                axes.plot([100 * low, 100 * high], [y, y], color=colour, linewidth=1.2)
                axes.plot(
                    100 * one["failed"], y, marker, color=colour, markersize=5, label=label, clip_on=False, zorder=3
                )
                label = "_"
    finish(axes, "failed runs with 95 % intervals", xlabel="% of runs", xscale="symlog", xlim=(0, 105))
    axes.set_xscale("symlog", linthresh=2.0, linscale=0.6)
    ticks = (0, 1, 2, 5, 10, 20, 50, 100)
    axes.set_xticks(ticks, labels=[f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)
    axes.set_yticks(range(len(names)), labels=[suite.short(name) for name in reversed(names)])
    axes.set_ylim(-0.6, len(names) - 0.4)
    figure.legend(loc="outside upper right", ncols=len(kinds), frameon=False, fontsize=9)
    return figure


def _most_runs(board: Mapping[str, Any], task: str) -> int:
    return max((one["runs"] for one in board["results"] if one["task"] == task), default=0)


# ---- errors against time ----


def time_figure(played: Mapping[str, Sequence[Results]]) -> Figure:
    """Draw the RMS of the azimuth error against time with 95 % bands, the bound, and the oracle in the same runs."""
    figure = new_figure(9.0, 4.1)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (task, (title, solvers)) in zip(panels, TIMES.items(), strict=False):
        lines = {one.solver: one for one in played.get(task, ())}
        for i, solver in enumerate(name for name in solvers if name in lines):
            _curve(axes, lines[solver], i)
        if lines:
            _yardsticks(axes, lines[next(iter(lines))])
        finish(axes, title, xlabel="time, s", yscale="log")
        if lines:
            axes.legend(frameon=False, fontsize=9, loc="upper right", bbox_to_anchor=(1.0, 0.87))
    panels[0].set_ylabel("azimuth error, RMS over runs, deg")
    return figure


def _picked(one: Results) -> tuple[Any, Any]:
    """Return times, s, and the samples of the history that are drawn."""
    t = np.asarray(one.records.criteria.history_t, dtype=float)
    picked = np.unique(np.linspace(0, len(t) - 1, SAMPLES).round().astype(int))
    return t[picked], picked


def _curve(axes: Axes, one: Results, i: int) -> None:
    t, picked = _picked(one)
    failed = f"{one.solver}, {100 * one.summary.success:.0f} % align"
    band(axes, t, size_of(one.records.history[:, picked][..., [2]], False), DEG, failed, i)
    axes.set_xlim(0, t[-1])


def _yardsticks(axes: Axes, one: Results) -> None:
    if one.bound:
        axes.plot(one.bound.t, one.bound.sigma[:, 2] / DEG, **bound_style(one.bound))
    if one.oracle is not None:
        t, picked = _picked(one)
        size = np.sqrt(np.square(one.oracle.history[:, picked, 2], dtype=float).mean(axis=0)) / DEG
        line = {"color": "black", "linewidth": 1.2, "linestyle": (0, (1, 1.5)), "zorder": 3}
        axes.plot(t, size, label="oracle: the bound's filter", **line)
