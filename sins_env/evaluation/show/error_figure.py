"""The figure of an evaluation: errors over time with their spread, and success against the threshold."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.evaluation.score.metrics import rms_band, success_profile
from sins_env.evaluation.score.quantities import QUANTITIES
from sins_env.evaluation.score.ranking import ranked
from sins_env.evaluation.score.results import Results, by_task
from sins_env.evaluation.show.style import (
    DOTTED,
    bound_style,
    finish,
    new_figure,
    oracle_style,
    say_unscored,
    shade_coarse,
    style,
    threshold_text,
)
from sins_env.units import ARCSEC, DEG

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Floats = NDArray[np.floating[Any]]  #: histories are kept in single precision


def error_figure(results: Sequence[Results]) -> Figure:
    """Draw a row per task: RMS of azimuth and level over time with 95 % bands, and success against the threshold.

    A task of navigation has position and velocity instead of level and success.
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
                say_unscored(axes)
        runs = sorted({len(one.records) for one in lines})
        count = f"{runs[0]} runs" if len(runs) == 1 else f"{runs[0]} to {runs[-1]} runs"
        part.suptitle(f"{group[0].task.name}   {count}, shaded: 95 % intervals", x=0.01, ha="left", fontsize=12)
        handles, labels = panels[0].get_legend_handles_labels()
        place = {"loc": "outside lower center", "ncols": min(len(labels), 6)}
        part.legend(handles, labels, frameon=False, fontsize=9, handlelength=3.2, **place)
    return figure


class _Curve(NamedTuple):
    """Curve of the RMS over runs of some components."""

    title: str
    parts: list[int]  #: indices of components in the layout SCORED
    unit: float
    unit_name: str
    of_component: bool = False  #: whether it is the RMS of a single component; if not, of the length of all


_ALIGNMENT = (
    _Curve("azimuth error, RMS over runs", [2], DEG, "deg"),
    _Curve("level error, RMS over runs of a component", [0, 1], ARCSEC, "arcsec", of_component=True),
)
_NAVIGATION = (
    _ALIGNMENT[0],
    _Curve("position error, RMS over runs", list(QUANTITIES["position"].parts), 1.0, "m"),
    _Curve("velocity error, RMS over runs", list(QUANTITIES["velocity"].parts), 1.0, "m/s"),
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
    oracle = next((one.oracle for one in lines if one.oracle and one.oracle.history.shape[1]), None)
    if oracle:
        size = size_of(oracle.history[:, :, curve.parts], curve.of_component)
        axes.plot(criteria.history_t, error_curve(size, curve.unit, 1)[0], **oracle_style())
    finish(axes, curve.title, xlabel="time, s", ylabel=curve.unit_name, yscale="log")
    axes.set_xlim(0, criteria.duration_s)
    if curve.parts[0] < 3:
        axes.axhline(criteria.delta[curve.parts[0]] / curve.unit, label=threshold_text(task), **DOTTED)
    shade_coarse(axes, criteria.coarse_s)


def _success(axes: Axes, lines: Sequence[Results], colours: Mapping[str, int]) -> None:
    task = lines[0].task
    for one in lines:
        if one.summary.scored:
            deltas, success, _, _ = success_profile(one.records)
            axes.step(deltas / DEG, 100 * success, where="post", **style(colours[one.label]))
    held = f"azimuth within the threshold for the last {task.hold_s:g} s"
    finish(axes, held, xlabel="threshold, deg", ylabel="% of runs", xscale="log", ylim=(-3, 103))
    axes.axvline(task.delta_azimuth_deg, **DOTTED)


def size_of(parts: Floats, of_component: bool) -> Floats:
    """Return the length (...) of errors or sigmas (..., parts), or for ``of_component`` the root of their mean square."""
    squares = np.square(parts, dtype=float)
    return np.sqrt(squares.mean(axis=-1) if of_component else squares.sum(axis=-1))


def error_curve(size: Floats, unit: float, resamples: int = 400) -> tuple[Floats, Floats, Floats]:
    """Return the RMS over runs and the ends of its band, in ``unit``: (R, S) -> three (S,). None is zero, for log axes."""
    value, low, high = (np.maximum(curve / unit, 1e-12) for curve in rms_band(size.astype(np.float32), resamples))
    return value, low, high


def band(axes: Axes, t: Any, size: Floats, unit: float, label: str, i: int) -> None:
    """Draw the RMS over runs of errors (R, S) with its 95 % band, in the style of the i-th solver."""
    value, low, high = error_curve(size, unit)
    if len(size) > 1:
        axes.fill_between(t, low, high, color=style(i)["color"], alpha=0.15, linewidth=0)
    axes.plot(t, value, label=label, **style(i))
