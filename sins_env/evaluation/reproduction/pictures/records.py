"""Figures of parked-car records: what several filters make of each record, in small panels."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sins_env.evaluation.reproduction.pictures.common import legend, plain
from sins_env.evaluation.reproduction.readings.car import ANGLES, courses_of
from sins_env.evaluation.reproduction.tables import Picture, Source
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.style import new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LINE = {"linewidth": 1.1}


class Record(NamedTuple):
    """The panel of a record: a title, the run that plays it, and for each filter the printed value at the end, deg."""

    title: str
    run: int
    printed: Mapping[str, float] = {}


def headings(
    name: str,
    caption: str,
    filters: Mapping[str, Source],
    records: Sequence[Record],
    columns: int,
    ends_deg: float,
    **more: Any,
) -> Picture:
    """Return a picture of the azimuth error over time, with a panel for each record.

    Args:
        name: name of the file.
        caption: caption.
        filters: runs of each filter, by label.
        records: the panels.
        columns: number of panels side by side.
        ends_deg: the scale ends at plus and minus this.
        more: ``runs`` and ``quick`` of the picture.
    """
    draw = partial(_headings, list(filters), records, columns, ends_deg)
    return Picture(name, caption, draw, tuple(filters.values()), **more)


def _headings(
    labels: Sequence[str], records: Sequence[Record], columns: int, ends_deg: float, results: Sequence[Results]
) -> Figure:
    rows = math.ceil(len(records) / columns)
    figure = new_figure(1.5 * columns + 1.0, 1.35 * rows + 0.9)
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    criteria = results[0].records.criteria
    t = np.asarray(criteria.history_t)
    fine = t > criteria.coarse_s
    for axes, record in zip(panels.ravel(), records, strict=False):
        for i, (label, one) in enumerate(zip(labels, results, strict=True)):
            if record.run < len(one.records):  # a first look has fewer runs
                error = np.degrees(one.records.history[record.run, fine, 2])
                axes.plot(t[fine], error, label=label, **style(i) | LINE)
            if label in record.printed:
                axes.plot(t[-1], record.printed[label], "o", color=style(i)["color"], markersize=3.5, clip_on=False)
        axes.set_title(record.title, loc="left", fontsize=9)
        plain(axes)
        axes.tick_params(labelsize=8)
    panels[0, 0].set(xlim=(criteria.coarse_s, t[-1]), ylim=(-ends_deg, ends_deg))
    for axes in panels.ravel()[len(records) :]:
        axes.set_visible(False)
    for axes in panels[-1]:
        axes.set_xlabel("time, s", fontsize=9)
    figure.supylabel("azimuth error, deg", fontsize=9)
    legend(figure, [panels[0, 0]])
    return figure


class Played(NamedTuple):
    """A row of a figure: a record in a few words, and the runs of each filter on it, by label."""

    words: str
    filters: Mapping[str, Source]


def attitudes(name: str, caption: str, rows: Sequence[Played], **more: Any) -> Picture:
    """Return a picture of heading, pitch and roll of a car over time as filters have them, with a row for each record.

    The first run of each source is drawn. Black is the car itself.
    """
    sources = tuple(source for row in rows for source in row.filters.values())
    return Picture(name, caption, partial(_attitudes, rows), singles=sources, **more)


def _attitudes(rows: Sequence[Played], results: Sequence[Results]) -> Figure:
    figure = new_figure(12.0, 2.8 * len(rows) + 0.6)
    panels = figure.subplots(len(rows), len(ANGLES), squeeze=False, sharex=True)
    left = iter(results)
    for of_row, row in zip(panels, rows, strict=True):
        for i, label in enumerate(row.filters):
            t, found, true = courses_of(next(left))
            for axes, own, car in zip(of_row, found.T, true.T, strict=True):
                if i == 0:
                    axes.plot(t, car, label="the car", color="black", linewidth=0.9)
                axes.plot(t, own, label=label, **style(i) | LINE)
        for axes, angle in zip(of_row, ANGLES, strict=True):
            _end(axes, angle)
            axes.set_title(f"{angle}: {row.words}", loc="left", fontsize=10)
            axes.set_xlim(t[0], t[-1])
        of_row[0].set_ylabel("from the angle at switch-on, deg")
    for axes in panels[-1]:
        axes.set_xlabel("time, s")
    legend(figure, panels.ravel())
    return figure


def _end(axes: Axes, angle: str) -> None:
    plain(axes)
    if angle == "heading":  # coarse alignment leaves more than can be seen of the rest
        axes.set_ylim(-0.5, 0.5)
