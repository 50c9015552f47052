"""Figures of single runs over the band of a Monte Carlo, with the printed errors at their end."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.evaluation.reproduction.tables import Picture, Source
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.style import new_figure, style
from sins_env.units import ARCSEC
from sins_env.writing.files import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


AXES = ("East", "North", "azimuth")
BAND = (2.5, 97.5)  #: percentiles of the runs that limit the band
POINTS = 120  #: number of points of a curve; more make heavy files and cannot be seen
SIGMAS = 1.96  #: half width of the bound in sigmas, so that it is as wide as the band


class Course(NamedTuple):
    """The curve of a single run, which the document shows, over the band of many runs."""

    label: str
    band: Source  #: the runs that make the band
    single: Source  #: the runs whose first one is drawn
    #: Printed errors at the end in the order E, N, U, arcsec.
    printed: tuple[float | None, float | None, float | None] = (None, None, None)


Rows = Sequence[tuple[str, Sequence[Course]]]  #: rows of a figure: conditions in a few words, and their curves


def courses(name: str, caption: str, rows: Rows, until_s: float, **more: int) -> Picture:
    """Return a picture with a row for each condition and columns for East, North and azimuth.

    Errors are in arcsec, on a scale that is linear about zero and logarithmic beyond. Time ends ``until_s`` s from
    switch-on. ``more`` holds ``runs`` and ``quick`` of the picture.
    """
    each = [course for _, given in rows for course in given]
    bands, singles = tuple(one.band for one in each), tuple(one.single for one in each)
    return Picture(name, caption, partial(_draw, rows, until_s), bands, singles, **more)


def _draw(rows: Rows, until_s: float, results: Sequence[Results]) -> Figure:
    figure = new_figure(12.0, 3.0 * len(rows) + 0.6)
    panels = figure.subplots(len(rows), len(AXES), squeeze=False, sharex=True, sharey="col")
    pairs = iter(zip(results[: len(results) // 2], results[len(results) // 2 :], strict=True))
    for row, (title, given) in zip(panels, rows, strict=True):
        of_row = [(course, *next(pairs)) for course in given]
        for component, (axes, name) in enumerate(zip(row, AXES, strict=True)):
            for i, (course, band, single) in enumerate(of_row):
                _course(axes, course, band, single, component, i, until_s)
            _bound(axes, of_row[0][1], component)
            _scale(axes, component)
            axes.set_title(f"{name}: {title}", loc="left", fontsize=10)
            axes.set_xlim(0, until_s)
            axes.grid(alpha=0.3, linewidth=0.6)
            axes.spines[["top", "right"]].set_visible(False)
            axes.tick_params(labelsize=9)
        row[0].set_ylabel("error, arcsec")
    for axes in panels[-1]:
        axes.set_xlabel("time, s")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False, fontsize=9)
    return figure


def _course(axes: Axes, course: Course, band: Results, single: Results, component: int, i: int, until_s: float) -> None:
    t, shown = _shown(band, until_s)
    look = style(i)
    low, high = np.nanpercentile(band.records.history[:, shown, component] / ARCSEC, BAND, axis=0)
    axes.fill_between(t, low, high, color=look["color"], alpha=0.13, linewidth=0)
    own, shown = _shown(single, until_s)
    axes.plot(
        own, single.records.history[0, shown, component] / ARCSEC, label=course.label, **look | {"linewidth": 1.3}
    )
    printed = course.printed[component]
    if printed is not None:
        axes.plot([until_s], [printed], "o", color=look["color"], markeredgecolor="black", clip_on=False, zorder=5)


def _shown(results: Results, until_s: float) -> tuple[Array, NDArray[np.int64]]:
    """Return the times up to ``until_s`` that are drawn, and their indices.

    They are all times at the start, while errors change fast, and then POINTS of them.
    """
    t = np.asarray(results.records.criteria.history_t)
    last = int(np.searchsorted(t, until_s - 1e-6))
    shown = np.unique(np.append(np.arange(min(POINTS // 4, last)), np.linspace(0, last, POINTS).astype(int)))
    return t[shown], shown


def _bound(axes: Axes, band: Results, component: int) -> None:
    if band.bound is not None and band.bound.holds:
        sigma = SIGMAS * band.bound.sigma[:, component] / ARCSEC
        line: dict[str, Any] = {"color": "black", "linewidth": 1.0, "linestyle": (0, (4, 2))}
        axes.plot(band.bound.t, sigma, label="bound, 95 %", **line)
        axes.plot(band.bound.t, -sigma, **line)


def _scale(axes: Axes, component: int) -> None:
    linear = 1000.0 if component == 2 else 50.0
    axes.set_yscale("symlog", linthresh=linear, linscale=2.0)
    axes.set_ylim(*((-60_000, 60_000) if component == 2 else (-3000, 3000)))
    ticks = [1000, 10_000] if component == 2 else [50, 500]
    axes.set_yticks(
        [-ticks[1], -ticks[0], 0, ticks[0], ticks[1]], [f"{y:,}" for y in (-ticks[1], -ticks[0], 0, *ticks)]
    )


def save(figure: Figure, path: Path) -> None:
    """Save a figure as SVG, with fonts as text and without date, so that equal figures make equal files."""
    import matplotlib as mpl  # slow to import

    with replacing([path]) as (new,), mpl.rc_context({"svg.hashsalt": path.stem, "svg.fonttype": "none"}):
        figure.savefig(new, format="svg", metadata={"Date": None})
