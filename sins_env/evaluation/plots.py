"""Figures of evaluations: errors over time with their spread, success against the threshold, one run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from sins_env.evaluation.board import by_task, ranked
from sins_env.evaluation.bounds import Bound
from sins_env.evaluation.episode import Course
from sins_env.evaluation.metrics import rms_band, success_profile
from sins_env.evaluation.monte_carlo import Results
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


def _new(width: float, height: float) -> Figure:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def _axes(axes: Axes, title: str, **settings: Any) -> None:
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


def error_figure(results: Sequence[Results]) -> Figure:
    """A row per task: RMS of azimuth and level over time with 95 % bands, success against the threshold."""
    groups = list(by_task(results).values())
    figure = _new(13.0, 4.3 * len(groups) + 0.5)
    parts = figure.subfigures(len(groups), 1, squeeze=False)[:, 0]
    colours = {label: i for i, label in enumerate(dict.fromkeys(one.label for one in results))}
    for part, group in zip(parts, groups, strict=True):
        lines = [one for _, one in ranked(group)]
        azimuth, level, profile = part.subplots(1, 3)
        for one in lines:
            if not one.summary.scored:
                continue
            i = colours[one.label]  # a solver looks the same in every task
            t = one.records.criteria.history_t
            _band(azimuth, t, one.records.history[:, :, 2:], DEG, one.label, i)
            _band(level, t, one.records.history[:, :, :2], ARCSEC, one.label, i)
            deltas, success, _, _ = success_profile(one.records)
            profile.step(deltas / DEG, 100 * success, where="post", **style(i))
        task, criteria = group[0].task, lines[0].records.criteria
        bound = next((one.bound for one in lines if one.bound), None)
        if bound:
            azimuth.plot(bound.t, bound.sigma[:, 2] / DEG, **_bound_style(bound))
            level.plot(bound.t, np.sqrt(np.square(bound.sigma[:, :2]).mean(axis=1)) / ARCSEC, **_bound_style(bound))
        _axes(azimuth, "azimuth error, RMS over runs", xlabel="time, s", ylabel="deg", yscale="log")
        _axes(level, "level error, RMS over runs", xlabel="time, s", ylabel="arcsec", yscale="log")
        for axes, delta in ((azimuth, task.delta_azimuth_deg), (level, task.delta_level_arcsec)):
            axes.set_xlim(0, criteria.duration_s)
            axes.axhline(delta, label=_told_threshold(task), **_DOTTED)
            _coarse(axes, criteria.coarse_s)
        held = f"azimuth within the threshold for the last {task.hold_s:g} s"
        _axes(profile, held, xlabel="threshold, deg", ylabel="% of runs", xscale="log", ylim=(-3, 103))
        profile.axvline(task.delta_azimuth_deg, **_DOTTED)
        if not criteria.scored:
            for axes in (azimuth, level, profile):
                _say_unscored(axes)
        runs = sorted({len(one.records) for one in lines})
        count = f"{runs[0]} runs" if len(runs) == 1 else f"{runs[0]} to {runs[-1]} runs"
        part.suptitle(f"{task.name}   {count}, shaded: 95 % intervals", x=0.01, ha="left", fontsize=12)
        handles, labels = azimuth.get_legend_handles_labels()
        place = {"loc": "outside lower center", "ncols": min(len(labels), 6)}
        part.legend(handles, labels, frameon=False, fontsize=9, handlelength=3.2, **place)
    return figure


def _bound_style(bound: Bound, name: str = "Cramér-Rao bound") -> dict[str, Any]:
    """Solid where it holds, dashed where it is a reference only."""
    line = {"color": "black", "linewidth": 1.1, "zorder": 3}
    if bound.holds:
        return {"label": name, "linestyle": "-", **line}
    return {"label": f"{name}, a reference only", "linestyle": (0, (4, 3)), **line}


def _say_unscored(axes: Axes) -> None:
    axes.text(0.5, 0.5, NO_REFERENCE, transform=axes.transAxes, ha="center", va="center", fontsize=9, color="0.35")


def error_curve(history: Array, unit: float, resamples: int = 400) -> tuple[Array, Array, Array]:
    """RMS over runs and components with its band, in ``unit``: (R, S, parts) -> three of (S,); never zero, for log axes."""
    length = np.sqrt(np.square(history, dtype=float).mean(axis=2)).astype(np.float32)
    value, low, high = (np.maximum(curve / unit, 1e-12) for curve in rms_band(length, resamples))
    return value, low, high


def _band(axes: Axes, t: Any, history: Array, unit: float, label: str, i: int) -> None:
    value, low, high = error_curve(history, unit)
    if len(history) > 1:
        axes.fill_between(t, low, high, color=style(i)["color"], alpha=0.15, linewidth=0)
    axes.plot(t, value, label=label, **style(i))


def _told_threshold(task: EvaluationTask) -> str:
    return f"threshold of the task: {task.delta_azimuth_deg:g} deg, {task.delta_level_arcsec:g} arcsec"


def _coarse(axes: Axes, coarse_s: float) -> None:
    """Shade the coarse phase, which is not scored."""
    if coarse_s:
        axes.axvspan(0, coarse_s, color="0.5", alpha=0.15, linewidth=0, label="coarse phase, not scored")


def run_figure(task: EvaluationTask, label: str, course: Course) -> Figure:
    """The errors of one run at every epoch, with what the estimator says of them (3 sigma)."""
    criteria = course.records.criteria
    figure = _new(9.0, 7.2)
    panels = figure.subplots(3, 1, sharex=True)
    bound = task.bound() if criteria.scored else None
    rows = (("azimuth", 2, DEG, "deg"), ("east", 0, ARCSEC, "arcsec"), ("north", 1, ARCSEC, "arcsec"))
    for axes, (name, j, unit, unit_name) in zip(panels, rows, strict=True):
        phi, sigma = course.phi[:, j] / unit, course.sigma[:, j] / unit
        delta = criteria.delta[j] / unit
        if np.isfinite(sigma).any():
            three = 3 * np.where(np.isfinite(sigma), sigma, 0.0)
            shade = {"color": COLOURS[0], "alpha": 0.15, "linewidth": 0}
            axes.fill_between(course.t, -three, three, label="3 sigma, the estimator's own", **shade)
        axes.plot(course.t, phi, color=COLOURS[0], linewidth=1.3, label="error")
        for sign in (-1, 1):
            told = {} if sign > 0 else {"label": "_"}
            axes.axhline(
                sign * delta, color=COLOURS[1], linestyle="--", linewidth=1.0, **{"label": "threshold", **told}
            )
            if bound:
                limit = {**_bound_style(bound, "3 sigma of the Cramér-Rao bound"), "linewidth": 0.8, **told}
                axes.plot(bound.t, 3 * sign * bound.sigma[:, j] / unit, **limit)
        last = f"   at the end {phi[-1]:+.3g} {unit_name}" if len(phi) and criteria.scored else ""
        title = f"{name} error{last}"
        if not criteria.scored:
            _say_unscored(axes)
        _axes(axes, title, ylabel=unit_name)
        axes.set_yscale("symlog", linthresh=2 * delta, linscale=2.0)
        _symlog_ticks(axes, delta, phi)
        _coarse(axes, criteria.coarse_s)
    panels[-1].set(xlabel="time, s", xlim=(0, criteria.duration_s))
    status, reason = str(course.records.status[0]), course.records.reason[0]
    verdict = _verdict(course) if status == "ok" else f"{status}: {reason}"
    run = int(course.records.run[0])
    figure.suptitle(f"{label} on {task.name}, run {run}   {verdict}", x=0.01, ha="left", fontsize=12)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False, fontsize=9)
    return figure


def _verdict(course: Course) -> str:
    if not course.records.criteria.scored:
        return NO_REFERENCE
    time = float(course.records.aligned_s[0])
    return f"aligned {time:.1f} s into the fine phase" if np.isfinite(time) else "not aligned"


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
