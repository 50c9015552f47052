"""The two figures of README, from the runs of the leaderboard: accuracy against cost, and errors against time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import matplotlib
import numpy as np
import suite

from sins_env.cli.output import remark
from sins_env.evaluation.report.page_figures import pareto_front
from sins_env.evaluation.score.paired import paired_ratio
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.error_figure import band, size_of
from sins_env.evaluation.show.style import COLOURS, bound_style, finish, new_figure
from sins_env.units import DEG

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Board = Mapping[str, Sequence[Results]]  #: results by task
Point = tuple[float, float]  #: cost and error

#: Tasks of the first figure, with the titles of their panels and the solvers that are named in addition to the front.
COSTS = {
    "sway-white-v0": ("nothing is wrong", ("ckf", "gsf_ekf", "two_pass", "gpf")),
    "sway-told-wrong-v0": ("told noise is wrong", ("ckf", "imm_ekf")),
    "sway-anyheading-v0": ("heading unknown", ("ckf", "inekf")),
    "flight-hotstart60-v0": ("flight, heading wrong by 60 deg (1 sigma)", ("ckf",)),
}
#: Tasks of the second figure, with the titles of their panels and the solvers that are drawn.
TIMES = {
    "sway-told-wrong-v0": ("told noise is wrong", ("ckf", "aukf", "imm_ekf")),
    "sway-anyheading-v0": ("heading unknown", ("ckf", "iekf", "gsf_ekf")),
}
SAMPLES = 80  #: number of points of a curve
TICKS = (0.5, 1, 2, 5)
BETTER = 0.9  #: a solver of the front is named if its error is at most so many times that of the next cheaper one


def draw(board: Board, folder: Path) -> None:
    """Write ``cost.svg`` and ``time.svg`` for the tasks that the board has."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, figure in (("cost", cost_figure(board)), ("time", time_figure(board))):
        path = folder / f"{name}.svg"
        with matplotlib.rc_context({"svg.hashsalt": name}):  # equal runs give an equal file
            figure.savefig(path, metadata={"Date": None})
        remark(f"figure: {path}, {path.stat().st_size / 1e3:.0f} kB")


def cost_figure(board: Board) -> Figure:
    """Draw the error over the bound against the cost of a step over that of ckf; solvers of the front are named."""
    figure = new_figure(9.0, 6.8)
    panels = figure.subplots(2, 2, sharex=True).ravel()
    for axes, (task, (title, named)) in zip(panels, COSTS.items(), strict=False):
        finish(axes, title, xscale="log", yscale="log")
        if task in board:
            _costs(axes, _placed(board, task), named)
    panels[0].set_xticks(TICKS, labels=[f"{tick:g}" for tick in TICKS])
    panels[0].set_xticks([], minor=True)
    for axes in panels[2:]:
        axes.set_xlabel("cost of a step / ckf")
    for axes in panels[::2]:
        axes.set_ylabel("azimuth error / bound")
    return figure


def _placed(board: Board, task: str) -> dict[str, Point]:
    """Return cost and error over the bound by solver.

    If a solver has another number of runs than ckf, its error is the paired ratio times the error of ckf.
    """
    lines = board[task]
    yardstick = next(one for one in lines if one.solver == suite.YARDSTICK)
    costs = _costs_of(board, navigates=yardstick.records.criteria.navigates)
    out = {}
    for one in lines:
        same = len(one.records) == len(yardstick.records)
        error = one.headline_ratio
        if not same:
            error = paired_ratio(one.records, yardstick.records)[0] * yardstick.headline_ratio
        if one.solver in costs and np.isfinite(error) and one.solver not in suite.AT_REST:
            out[one.solver] = (costs[one.solver], error)
    return out


def _costs_of(board: Board, navigates: bool) -> dict[str, float]:
    """Return the cost of a step over that of ckf by solver, measured on the one task of that kind."""
    measured = [one for task in suite.COSTED for one in board.get(task, ()) if one.cost]
    return {
        one.solver: one.cost.ratio
        for one in measured
        if one.records.criteria.navigates == navigates and one.cost.ratio is not None
    }


def _costs(axes: Axes, points: Mapping[str, Point], named: Sequence[str]) -> None:
    best = pareto_front(list(points.values()))
    axes.step(*np.array(best).T, where="post", color=COLOURS[0], linewidth=1, linestyle=(0, (2, 2)), zorder=1)
    axes.axhline(1.0, color="black", linewidth=1.1, zorder=1)
    leaders = {best[0], *(point for before, point in pairwise(best) if point[1] < BETTER * before[1])}
    for name, point in points.items():
        colour = COLOURS[1] if name == suite.YARDSTICK else COLOURS[0] if point in best else "0.55"
        told = point in leaders or name in named
        axes.plot(*point, "o", color=colour, markersize=6.5 if told else 4, markeredgewidth=0, zorder=3 if told else 2)
        if told:
            where = {"xytext": (3, 4), "textcoords": "offset points", "rotation": 30, "rotation_mode": "anchor"}
            axes.annotate(name, point, fontsize=9.5, color=colour, zorder=4, **where)
    axes.margins(x=0.12)
    axes.set_ylim(0.7, max(5.0, 2.0 * max(error for _, error in points.values())))


def time_figure(board: Board) -> Figure:
    """Draw the RMS of the azimuth error against time with 95 % bands, and the bound."""
    figure = new_figure(9.0, 3.9)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, (task, (title, solvers)) in zip(panels, TIMES.items(), strict=False):
        lines = {one.solver: one for one in board.get(task, ())}
        for i, solver in enumerate(name for name in solvers if name in lines):
            _curve(axes, lines[solver], i)
        finish(axes, title, xlabel="time, s", yscale="log")
        if lines:
            axes.legend(frameon=False, fontsize=9, loc="best")
    panels[0].set_ylabel("azimuth error, RMS over runs, deg")
    return figure


def _curve(axes: Axes, one: Results, i: int) -> None:
    t = np.asarray(one.records.criteria.history_t, dtype=float)
    picked = np.unique(np.linspace(0, len(t) - 1, SAMPLES).round().astype(int))
    label = f"{one.solver}, {100 * one.summary.success:.0f} % align"
    band(axes, t[picked], size_of(one.records.history[:, picked][..., [2]], False), DEG, label, i)
    if i == 0 and one.bound:
        axes.plot(one.bound.t, one.bound.sigma[:, 2] / DEG, **bound_style(one.bound))
    axes.set_xlim(0, t[-1])
