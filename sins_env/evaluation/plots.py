"""Figures of evaluations: errors over time with their spread, success against the threshold, one run."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.evaluation.board import by_task
from sins_env.evaluation.bounds import Bound
from sins_env.evaluation.episode import Course
from sins_env.evaluation.metrics import rms_band, success_profile
from sins_env.evaluation.monte_carlo import Results
from sins_env.evaluation.ranking import ranked
from sins_env.evaluation.tasks import EvaluationTask
from sins_env.specs import ARCSEC, DEG

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.floating[Any]]

#: Okabe and Ito: told apart with any colour vision; line styles tell solvers apart in print, too.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STYLES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
NO_REFERENCE = "no reference: errors are not scored"
_DOTTED: dict[str, Any] = {"color": "0.35", "linestyle": (0, (1, 1)), "linewidth": 1.2}


def style(i: int) -> dict[str, Any]:
    """Colour and line style of the i-th solver."""
    return {"color": COLOURS[i % len(COLOURS)], "linestyle": STYLES[i % len(STYLES)], "linewidth": 1.7}


def new_figure(width: float, height: float) -> Figure:
    """Empty, in inches, without pyplot."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def finish(axes: Axes, title: str, **settings: Any) -> None:
    """Title, settings, grid, and numbers instead of powers on log axes."""
    axes.set_title(title, fontsize=10, loc="left")
    axes.set(**settings)
    axes.grid(which="major", alpha=0.35, linewidth=0.6)
    axes.grid(which="minor", alpha=0.15, linewidth=0.4)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=9)
    from matplotlib.ticker import FuncFormatter

    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(FuncFormatter(few_labels(axis)))


def error_figure(results: Sequence[Results]) -> Figure:
    """A row per task: RMS of azimuth and level over time with 95 % bands, success against the threshold.

    Where a task navigates position and velocity stand in the place of level and success.
    """
    groups = list(by_task(results).values())
    figure = new_figure(13.0, 4.3 * len(groups) + 0.5)
    parts = figure.subfigures(len(groups), 1, squeeze=False)[:, 0]
    colours = {label: i for i, label in enumerate(dict.fromkeys(one.label for one in results))}
    for part, group in zip(parts, groups, strict=True):
        lines = [one for _, one in ranked(group)]
        panels = part.subplots(1, 3)
        navigates = lines[0].records.criteria.navigates
        curves = _NAVIGATION if navigates else _ALIGNMENT
        for axes, curve in zip(panels, curves, strict=False):
            _over_time(axes, curve, lines, colours)  # a solver looks the same in every task
        if not navigates:
            _success(panels[2], lines, colours)
        if not lines[0].records.criteria.scored:
            for axes in panels:
                _say_unscored(axes)
        runs = sorted({len(one.records) for one in lines})
        count = f"{runs[0]} runs" if len(runs) == 1 else f"{runs[0]} to {runs[-1]} runs"
        part.suptitle(f"{group[0].task.name}   {count}, shaded: 95 % intervals", x=0.01, ha="left", fontsize=12)
        handles, labels = panels[0].get_legend_handles_labels()
        place = {"loc": "outside lower center", "ncols": min(len(labels), 6)}
        part.legend(handles, labels, frameon=False, fontsize=9, handlelength=3.2, **place)
    return figure


class _Curve(NamedTuple):
    """RMS over runs of the length of some components, or of a component of them."""

    title: str
    parts: list[int]  #: of COMPONENTS
    unit: float
    unit_name: str
    of_component: bool = False


_ALIGNMENT = (
    _Curve("azimuth error, RMS over runs", [2], DEG, "deg"),
    _Curve("level error, RMS over runs of a component", [0, 1], ARCSEC, "arcsec", of_component=True),
)
_NAVIGATION = (
    _ALIGNMENT[0],
    _Curve("position error, RMS over runs", [6, 7, 8], 1.0, "m"),
    _Curve("velocity error, RMS over runs", [3, 4, 5], 1.0, "m/s"),
)


def _over_time(axes: Axes, curve: _Curve, lines: Sequence[Results], colours: Mapping[str, int]) -> None:
    task, criteria = lines[0].task, lines[0].records.criteria
    for one in lines:
        if one.summary.scored:
            size = size_of(one.records.history[:, :, curve.parts], curve.of_component)
            band(axes, criteria.history_t, size, curve.unit, one.label, colours[one.label])
    bound = next((one.bound for one in lines if one.bound), None)
    if bound and max(curve.parts) < bound.sigma.shape[1]:
        sigma = size_of(bound.sigma[:, curve.parts], curve.of_component) / curve.unit
        axes.plot(bound.t, sigma, **bound_style(bound))
    finish(axes, curve.title, xlabel="time, s", ylabel=curve.unit_name, yscale="log")
    axes.set_xlim(0, criteria.duration_s)
    if curve.parts[0] < 3:
        axes.axhline(criteria.delta[curve.parts[0]] / curve.unit, label=_told_threshold(task), **_DOTTED)
    _coarse(axes, criteria.coarse_s)


def _success(axes: Axes, lines: Sequence[Results], colours: Mapping[str, int]) -> None:
    task = lines[0].task
    for one in lines:
        if one.summary.scored:
            deltas, success, _, _ = success_profile(one.records)
            axes.step(deltas / DEG, 100 * success, where="post", **style(colours[one.label]))
    held = f"azimuth within the threshold for the last {task.hold_s:g} s"
    finish(axes, held, xlabel="threshold, deg", ylabel="% of runs", xscale="log", ylim=(-3, 103))
    axes.axvline(task.delta_azimuth_deg, **_DOTTED)


def bound_style(bound: Bound, name: str = "Cramér-Rao bound") -> dict[str, Any]:
    """Solid where it holds, dashed where it is a reference only."""
    line = {"color": "black", "linewidth": 1.1, "zorder": 3}
    if bound.holds:
        return {"label": name, "linestyle": "-", **line}
    return {"label": f"{name}, a reference only", "linestyle": (0, (4, 3)), **line}


def _say_unscored(axes: Axes) -> None:
    axes.text(0.5, 0.5, NO_REFERENCE, transform=axes.transAxes, ha="center", va="center", fontsize=9, color="0.35")


def few_labels(axis: Any) -> Callable[[float, Any], str]:
    """Less than a decade and a half of a log axis needs labels between the decades."""

    def label(value: float, _: Any) -> str:
        low, high = sorted(axis.get_view_interval())
        return f"{value:g}" if high < 30 * low and f"{value:e}"[0] in "25" else ""

    return label


def size_of(parts: Array, of_component: bool) -> Array:
    """Length of errors or sigmas (..., parts), or the root of their mean square: (...)."""
    squares = np.square(parts, dtype=float)
    return np.sqrt(squares.mean(axis=-1) if of_component else squares.sum(axis=-1))


def error_curve(size: Array, unit: float, resamples: int = 400) -> tuple[Array, Array, Array]:
    """RMS over runs with its band, in ``unit``: (R, S) -> three of (S,); never zero, for log axes."""
    value, low, high = (np.maximum(curve / unit, 1e-12) for curve in rms_band(size.astype(np.float32), resamples))
    return value, low, high


def band(axes: Axes, t: Any, size: Array, unit: float, label: str, i: int) -> None:
    """RMS over runs of (R, S) with its 95 % band, in the look of the i-th solver."""
    value, low, high = error_curve(size, unit)
    if len(size) > 1:
        axes.fill_between(t, low, high, color=style(i)["color"], alpha=0.15, linewidth=0)
    axes.plot(t, value, label=label, **style(i))


def _told_threshold(task: EvaluationTask) -> str:
    return f"threshold of the task: {task.delta_azimuth_deg:g} deg, {task.delta_level_arcsec:g} arcsec"


def _coarse(axes: Axes, coarse_s: float) -> None:
    """Shade the coarse phase, which is not scored."""
    if coarse_s:
        axes.axvspan(0, coarse_s, color="0.5", alpha=0.15, linewidth=0, label="coarse phase, not scored")


class _Row(NamedTuple):
    """An error of one run."""

    name: str
    j: int  #: of COMPONENTS
    unit: float
    unit_name: str


_ANGLES = (_Row("azimuth", 2, DEG, "deg"), _Row("east", 0, ARCSEC, "arcsec"), _Row("north", 1, ARCSEC, "arcsec"))
_STATES = [
    tuple(_Row(f"{axis} {kind}", first + j, 1.0, unit) for j, axis in enumerate(("east", "north", "vertical")))
    for kind, first, unit in (("velocity", 3, "m/s"), ("position", 6, "m"))
]


def run_figure(task: EvaluationTask, label: str, course: Course) -> Figure:
    """The errors of one run at every epoch, with what the estimator says of them (3 sigma)."""
    criteria = course.records.criteria
    columns = [_ANGLES, *(_STATES if criteria.navigates else [])]
    figure = new_figure(9.0 + 4.0 * (len(columns) - 1), 7.2)
    panels = figure.subplots(3, len(columns), sharex=True, squeeze=False)
    bound = task.bound() if criteria.scored else None
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
        _say_unscored(axes)
    finish(axes, title, ylabel=row.unit_name)
    if delta is None:
        late = np.abs(error[len(error) // 5 :])  # the start, which is larger, is drawn logarithmic
        delta = _round_above(float(np.nan_to_num(late).max(initial=0.0)))
    axes.set_yscale("symlog", linthresh=2 * delta, linscale=2.0)
    _symlog_ticks(axes, delta, error)
    _coarse(axes, criteria.coarse_s)


def _verdict(course: Course) -> str:
    if not course.records.criteria.scored:
        return NO_REFERENCE
    time = float(course.records.aligned_s[0])
    return f"aligned {time:.1f} s into the fine phase" if np.isfinite(time) else "not aligned"


def _round_above(value: float) -> float:
    """The next of 1, 2 and 5 times a power of ten."""
    decade = 10.0 ** math.floor(math.log10(max(value, 1e-6)))
    return next(factor * decade for factor in (1.0, 2.0, 5.0, 10.0) if factor * decade >= value)


def _symlog_ticks(axes: Axes, delta: float, phi: Any) -> None:
    """Linear within twice the threshold, logarithmic beyond: zero, the threshold and the decades."""
    from matplotlib.ticker import FixedLocator, FuncFormatter, NullLocator

    top = max(float(np.nan_to_num(np.abs(phi)).max(initial=0.0)) * 1.5, 2.5 * delta)
    decades = [10.0**n for n in range(-6, 8) if 1.8 * delta < 10.0**n <= top]
    positive = [delta, *decades]
    axes.set_ylim(-top, top)
    axes.yaxis.set_major_locator(FixedLocator([*(-v for v in reversed(positive)), 0.0, *positive]))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_locator(NullLocator())
