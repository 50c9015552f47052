"""Figures of single runs over the band of a Monte Carlo, with the printed errors at their end."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.evaluation.reproduction.pictures.common import legend, plain
from sins_env.evaluation.reproduction.tables import Picture, Source
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.style import new_figure, style
from sins_env.units import ARCSEC

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class Panel(NamedTuple):
    """The column of a figure: an error component, and the scale on which it is drawn."""

    name: str
    component: int
    unit: float
    unit_name: str
    ends: float  #: the scale ends at plus and minus this
    linear: float  #: it is linear up to here and logarithmic beyond; the same as ``ends`` for a linear scale
    ticks: tuple[float, ...] = ()  #: labelled values above zero; empty leaves them to matplotlib


MISALIGNMENT = (
    Panel("East", 0, ARCSEC, "arcsec", 3000.0, 50.0, (50.0, 500.0)),
    Panel("North", 1, ARCSEC, "arcsec", 3000.0, 50.0, (50.0, 500.0)),
    Panel("azimuth", 2, ARCSEC, "arcsec", 60_000.0, 1000.0, (1000.0, 10_000.0)),
)
AXES = tuple(panel.name for panel in MISALIGNMENT)
BAND = (2.5, 97.5)  #: percentiles of the runs that limit the band
POINTS = 120  #: number of points of a curve; more make heavy files and cannot be seen
SIGMAS = 1.96  #: half width of the bound in sigmas, so that it is as wide as the band
PRINTED: dict[str, Any] = {"markeredgecolor": "black", "clip_on": False, "zorder": 5}


class Course(NamedTuple):
    """The curve of a single run, which the document shows, over the band of many runs."""

    label: str
    band: Source  #: the runs that make the band
    single: Source  #: the runs whose first one is drawn
    printed: tuple[float | None, ...] = (
        None,
        None,
        None,
    )  #: printed errors at the end, one for each panel, in its unit


Rows = Sequence[tuple[str, Sequence[Course]]]  #: rows of a figure: conditions in a few words, and their curves


def courses(
    name: str, caption: str, rows: Rows, until_s: float, panels: Sequence[Panel] = MISALIGNMENT, **more: int
) -> Picture:
    """Return a picture with a row for each condition and a column for each of ``panels``.

    Time ends ``until_s`` s from switch-on. ``more`` holds ``runs`` and ``quick`` of the picture.
    """
    each = [course for _, given in rows for course in given]
    bands, singles = tuple(one.band for one in each), tuple(one.single for one in each)
    return Picture(name, caption, partial(_draw, rows, until_s, panels), bands, singles, **more)


def _draw(rows: Rows, until_s: float, shown: Sequence[Panel], results: Sequence[Results]) -> Figure:
    figure = new_figure(12.0, 3.0 * len(rows) + 0.6)
    panels = figure.subplots(len(rows), len(shown), squeeze=False, sharex=True, sharey="col")
    pairs = iter(zip(results[: len(results) // 2], results[len(results) // 2 :], strict=True))
    for row, (title, given) in zip(panels, rows, strict=True):
        of_row = [(course, *next(pairs)) for course in given]
        for column, (axes, panel) in enumerate(zip(row, shown, strict=True)):
            for i, (course, band, single) in enumerate(of_row):
                _course(axes, panel, course.label, band, single, i, until_s)
                if course.printed[column] is not None:
                    axes.plot([until_s], [course.printed[column]], "o", color=style(i)["color"], **PRINTED)
            _bound(axes, panel, of_row[0][1])
            _scale(axes, panel)
            axes.set_title(f"{panel.name}: {title}", loc="left", fontsize=10)
            axes.set_xlim(0, until_s)
            plain(axes)
        row[0].set_ylabel(f"error, {shown[0].unit_name}")
    for axes in panels[-1]:
        axes.set_xlabel("time, s")
    legend(figure, panels.ravel())
    return figure


def _course(axes: Axes, panel: Panel, label: str, band: Results, single: Results, i: int, until_s: float) -> None:
    t, shown = _shown(band, until_s)
    look = style(i)
    low, high = np.nanpercentile(band.records.history[:, shown, panel.component] / panel.unit, BAND, axis=0)
    axes.fill_between(t, low, high, color=look["color"], alpha=0.13, linewidth=0)
    own, shown = _shown(single, until_s)
    error = single.records.history[0, shown, panel.component] / panel.unit
    axes.plot(own, error, label=label, **look | {"linewidth": 1.3})


def _shown(results: Results, until_s: float) -> tuple[Array, NDArray[np.int64]]:
    """Return the times up to ``until_s`` that are drawn, and their indices.

    They are all times at the start, while errors change fast, and then POINTS of them.
    """
    t = np.asarray(results.records.criteria.history_t)
    last = int(np.searchsorted(t, until_s - 1e-6))
    shown = np.unique(np.append(np.arange(min(POINTS // 4, last)), np.linspace(0, last, POINTS).astype(int)))
    return t[shown], shown


def _bound(axes: Axes, panel: Panel, band: Results) -> None:
    if band.bound is not None and band.bound.holds:
        sigma = SIGMAS * band.bound.sigma[:, panel.component] / panel.unit
        line: dict[str, Any] = {"color": "black", "linewidth": 1.0, "linestyle": (0, (4, 2))}
        axes.plot(band.bound.t, sigma, label="bound, 95 %", **line)
        axes.plot(band.bound.t, -sigma, **line)


def _scale(axes: Axes, panel: Panel) -> None:
    if panel.linear < panel.ends:
        axes.set_yscale("symlog", linthresh=panel.linear, linscale=2.0)
    axes.set_ylim(-panel.ends, panel.ends)
    if panel.ticks:
        ticks = [*(-y for y in reversed(panel.ticks)), 0.0, *panel.ticks]
        axes.set_yticks(ticks, [f"{y:,.0f}" for y in ticks])
