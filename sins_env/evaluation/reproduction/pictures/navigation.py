"""Figures of navigation: RMS over runs against time, and a score against a setting."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.evaluation.reproduction.pictures.common import legend, plain
from sins_env.evaluation.reproduction.readings.common import armse
from sins_env.evaluation.reproduction.tables import Picture, Source
from sins_env.evaluation.reproduction.verdicts import Estimate
from sins_env.evaluation.score.quantities import QUANTITIES, length
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.error_figure import error_curve
from sins_env.evaluation.show.style import few_labels, new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS = 225  #: number of points of a curve, so that the file stays small
BLACK: dict[str, Any] = {"color": "black", "linewidth": 1.1, "zorder": 3}


class Curve(NamedTuple):
    """The curve of a filter."""

    label: str
    source: Source


class Row(NamedTuple):
    """A row of a figure: conditions in a few words, and the filters that are drawn under them."""

    words: str
    curves: Sequence[Curve]


def rms_over_time(
    name: str, caption: str, rows: Sequence[Row], printed: Mapping[str, Sequence[float]], **more: Any
) -> Picture:
    """Return a picture of the RMS over time, with a row for each condition and a column for each quantity.

    Args:
        name: name of the file.
        caption: caption.
        rows: conditions and their curves.
        printed: printed time means of the curves for each quantity, in its unit; empty if none is printed.
        more: ``runs`` and ``quick`` of the picture.
    """
    sources = tuple(curve.source for row in rows for curve in row.curves)
    return Picture(name, caption, partial(_draw_rms, rows, printed), sources, **more)


def _draw_rms(rows: Sequence[Row], printed: Mapping[str, Sequence[float]], results: Sequence[Results]) -> Figure:
    figure = new_figure(12.0, 3.2 * len(rows) + 0.5)
    panels = figure.subplots(len(rows), len(printed), squeeze=False, sharex=True, sharey="col")
    left = iter(results)
    for of_row, row in zip(panels, rows, strict=True):
        drawn = [(curve.label, next(left)) for curve in row.curves]
        for axes, (name, figures) in zip(of_row, printed.items(), strict=True):
            _rms(axes, name, drawn, figures)
            axes.set_title(f"{QUANTITIES[name].name}: {row.words}", loc="left", fontsize=9)
    for axes in panels[-1]:
        axes.set_xlabel("time, s")
    for column, name in zip(panels.T, printed, strict=True):
        _log(column)
        for axes in column:
            axes.set_ylabel(f"RMS, {QUANTITIES[name].unit_name}")
    legend(figure, panels.ravel(), columns=5)
    return figure


def _rms(axes: Axes, name: str, drawn: Sequence[tuple[str, Results]], printed: Sequence[float]) -> None:
    quantity = QUANTITIES[name]
    for i, (label, one) in enumerate(drawn):
        t = np.asarray(one.records.criteria.history_t)
        value, low, high = error_curve(length(one.records.history.astype(float), quantity), quantity.unit)
        some = slice(None, None, max(len(t) // POINTS, 1))
        axes.fill_between(t[some], low[some], high[some], color=style(i)["color"], alpha=0.2, linewidth=0)
        axes.plot(t[some], value[some], label=label, **style(i))
    for i, figure in enumerate(printed):
        label = f"{drawn[i][0]}, printed average"
        axes.axhline(figure, color=style(i)["color"], linestyle=":", linewidth=1.4, label=label)
    bound = drawn[0][1].bound
    if bound is not None and bound.holds and quantity.bounded:
        sigma = np.sqrt(np.square(bound.sigma[:, quantity.bounded]).sum(axis=1)) / quantity.unit
        some = slice(None, None, max(len(sigma) // POINTS, 1))
        axes.plot(bound.t[some], sigma[some], label="Cramér-Rao bound", **BLACK)
    axes.set_xlim(0, drawn[0][1].records.criteria.duration_s)
    plain(axes)


def against_setting(
    name: str,
    caption: str,
    setting: str,
    quantity: str,
    curve: Sequence[Source],
    beside: Sequence[Curve],
    label: str,
    **more: Any,
) -> Picture:
    """Return a picture of the time mean of the RMS of a quantity against a setting; other filters are lines across.

    Args:
        name: name of the file.
        caption: caption.
        setting: name of the setting.
        quantity: name of the quantity.
        curve: runs of a solver, one for each value of the setting.
        beside: filters without this setting.
        label: label of the solver.
        more: ``runs`` and ``quick`` of the picture.
    """
    values = [float(source.settings[setting]) for source in curve]
    draw = partial(_draw_setting, setting, quantity, values, label, [one.label for one in beside])
    return Picture(name, caption, draw, (*curve, *(one.source for one in beside)), **more)


def _draw_setting(
    setting: str, quantity: str, values: Sequence[float], label: str, beside: Sequence[str], results: Sequence[Results]
) -> Figure:
    figure = new_figure(7.5, 4.6)
    axes = figure.subplots()
    found = [armse(quantity)(one) for one in results]
    own, others = found[: len(values)], found[len(values) :]
    y = np.array([one.value for one in own])
    away = np.abs([[one.value - one.low for one in own], [one.high - one.value for one in own]])
    axes.errorbar(values, y, away, label=label, marker="o", markersize=4, capsize=3, **style(0))
    for i, (name, one) in enumerate(zip(beside, others, strict=True), start=1):
        _across(axes, one, name, i)
    if np.isfinite(own[0].bound):
        axes.axhline(own[0].bound, label="Cramér-Rao bound", **BLACK)
    axes.set(xlabel=setting, ylabel=f"{QUANTITIES[quantity].name}, {QUANTITIES[quantity].unit_name}", xscale="log")
    axes.set_xticks(values, [f"{value:g}" for value in values])
    axes.minorticks_off()
    plain(axes)
    legend(figure, [axes], columns=3)
    return figure


def _across(axes: Axes, one: Estimate, label: str, i: int) -> None:
    axes.axhspan(one.low, one.high, color=style(i)["color"], alpha=0.1, linewidth=0)
    axes.axhline(one.value, label=label, **style(i))


def _log(column: NDArray[np.object_]) -> None:
    """Set the scale of all panels of a column; intervals of few runs, which reach down to zero, are cut."""
    from matplotlib.ticker import FuncFormatter  # slow to import

    axes = column[0]
    axes.set_yscale("log")
    axes.set_ylim(bottom=0.7 * min(np.min(line.get_ydata()) for one in column for line in one.lines))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(FuncFormatter(few_labels(axes.yaxis)))
