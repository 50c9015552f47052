"""The figure of one run: its errors, the sigma that the filter reports, and the bound."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sins_env.evaluation.bound import bounds
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.play.one_run import Course
from sins_env.evaluation.show.style import (
    COLOURS,
    NO_REFERENCE,
    bound_style,
    finish,
    new_figure,
    say_unscored,
    shade_coarse,
)
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.units import ARCSEC, DEG

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class _Row(NamedTuple):
    """Panel of one error component."""

    name: str
    j: int  #: index of the component in the layout SCORED
    unit: float
    unit_name: str


_ANGLES = (_Row("azimuth", 2, DEG, "deg"), _Row("east", 0, ARCSEC, "arcsec"), _Row("north", 1, ARCSEC, "arcsec"))
_STATES = [
    tuple(_Row(f"{axis} {kind}", first + j, 1.0, unit) for j, axis in enumerate(("east", "north", "vertical")))
    for kind, first, unit in (("velocity", 3, "m/s"), ("position", 6, "m"))
]


def run_figure(task: EvaluationTask, label: str, course: Course) -> Figure:
    """Draw the errors of one run at every epoch, with the 3 sigma that the estimator reports."""
    criteria = course.records.criteria
    columns = [_ANGLES, *(_STATES if criteria.navigates else [])]
    figure = new_figure(9.0 + 4.0 * (len(columns) - 1), 7.2)
    panels = figure.subplots(3, len(columns), sharex=True, squeeze=False)
    bound = bounds.find(task) if criteria.scored else None
    for axes, row in zip(panels.T.ravel(), [row for rows in columns for row in rows], strict=True):
        _run_panel(axes, row, course, bound)
    for axes in panels[-1]:
        axes.set(xlabel="time, s", xlim=(0, criteria.duration_s))
    status, reason = str(course.records.status[0]), course.records.reason[0]
    verdict = _verdict(course) if status == "ok" else f"{status}: {reason}"
    run = int(course.records.run[0])
    figure.suptitle(f"{label} on {task.name}, run {run}   {verdict}", x=0.01, ha="left", fontsize=12)
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def _run_panel(axes: Axes, row: _Row, course: Course, bound: Bound | None) -> None:
    criteria, j = course.records.criteria, row.j
    error, sigma = course.errors[:, j] / row.unit, course.sigma[:, j] / row.unit
    delta = criteria.delta[j] / row.unit if j < 3 else None
    if np.isfinite(sigma).any():
        three = 3 * np.where(np.isfinite(sigma), sigma, 0.0)
        shade: dict[str, Any] = {"color": COLOURS[0], "alpha": 0.15, "linewidth": 0}
        axes.fill_between(course.t, -three, three, label="3 sigma, the estimator's own", **shade)
    axes.plot(course.t, error, color=COLOURS[0], linewidth=1.3, label="error")
    for sign in (-1, 1):
        told = {} if sign > 0 else {"label": "_"}
        if delta is not None:
            line: dict[str, Any] = {"label": "threshold", "color": COLOURS[1], "linestyle": "--", "linewidth": 1.0}
            axes.axhline(sign * delta, **{**line, **told})
        if bound and j < bound.sigma.shape[1]:
            limit = {**bound_style(bound, "3 sigma of the Cramér-Rao bound"), "linewidth": 0.8, **told}
            axes.plot(bound.t, 3 * sign * bound.sigma[:, j] / row.unit, **limit)
    last = f"   at the end {error[-1]:+.3g} {row.unit_name}" if len(error) and criteria.scored else ""
    title = f"{row.name} error{last}"
    if not criteria.scored:
        say_unscored(axes)
    finish(axes, title, ylabel=row.unit_name)
    if delta is None:
        late = np.abs(error[len(error) // 5 :])  # the start, which is larger, is drawn logarithmic
        delta = _round_above(float(np.nan_to_num(late).max(initial=0.0)))
    axes.set_yscale("symlog", linthresh=2 * delta, linscale=2.0)
    _symlog_ticks(axes, delta, error)
    shade_coarse(axes, criteria.coarse_s)


def _verdict(course: Course) -> str:
    if not course.records.criteria.scored:
        return NO_REFERENCE
    time = float(course.records.aligned_s[0])
    return f"aligned {time:.1f} s into the fine phase" if np.isfinite(time) else "not aligned"


def _round_above(value: float) -> float:
    """Return the least of 1, 2 and 5 times a power of ten that is not below the value."""
    decade = 10.0 ** math.floor(math.log10(max(value, 1e-6)))
    return next(factor * decade for factor in (1.0, 2.0, 5.0, 10.0) if factor * decade >= value)


def _symlog_ticks(axes: Axes, delta: float, phi: Any) -> None:
    """Set ticks at zero, the threshold and the decades; the axis is linear within twice the threshold."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator  # slow to import

    top = max(float(np.nan_to_num(np.abs(phi)).max(initial=0.0)) * 1.5, 2.5 * delta)
    decades = [10.0**n for n in range(-6, 8) if 1.8 * delta < 10.0**n <= top]
    positive = [delta, *decades]
    axes.set_ylim(-top, top)
    axes.yaxis.set_major_locator(FixedLocator([*(-v for v in reversed(positive)), 0.0, *positive]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
