"""Figures of sets of points in the plane."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.reproduction.pictures.common import plain
from sins_env.evaluation.reproduction.tables import Picture
from sins_env.evaluation.show.style import COLOURS, new_figure

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FAINT: dict[str, Any] = {"color": "0.6", "linewidth": 0.9, "zorder": 1}
FEW = 20  #: most points that are drawn as large as they weigh, with their weights written beside them


class Cloud(NamedTuple):
    """A set of points, which is made when it is drawn."""

    title: str
    make: Callable[[], tuple[Array, Array | None]]  #: function to points (N, 2) and, for few points, weights (N,)


def clouds(
    name: str, caption: str, rows: Sequence[Sequence[Cloud]], ends: tuple[float, float], circles: Sequence[float] = ()
) -> Picture:
    """Return a picture with a square panel for each cloud, both axes from ``ends[0]`` to ``ends[1]``.

    ``circles`` are the radii of circles about zero. Nothing has to be run.
    """
    return Picture(name, caption, lambda _: _draw(rows, ends, circles))


def _draw(rows: Sequence[Sequence[Cloud]], ends: tuple[float, float], circles: Sequence[float]) -> Figure:
    most = max(map(len, rows))
    figure = new_figure(2.7 * most if len(rows) > 1 else 4.2 * most, (2.5 if len(rows) > 1 else 4.3) * len(rows))
    for panels, row in zip(figure.subplots(len(rows), most, squeeze=False), rows, strict=True):
        for axes, cloud in zip(panels, row, strict=True):
            points, weights = cloud.make()
            _circles(axes, circles)
            if weights is None:
                axes.plot(
                    points[:, 0], points[:, 1], ".", color=COLOURS[0], markersize=2.0 if len(points) > 500 else 4.0
                )
            else:
                _weighted(axes, points, weights)
            axes.set(xlim=ends, ylim=ends, aspect="equal")
            axes.set_title(cloud.title, loc="left", fontsize=10)
            plain(axes)
    return figure


def _circles(axes: Axes, radii: Sequence[float]) -> None:
    angle = np.linspace(0.0, 2 * np.pi, 181)
    for radius in radii:
        axes.plot(radius * np.cos(angle), radius * np.sin(angle), **FAINT)


def _weighted(axes: Axes, points: Array, weights: Array) -> None:
    axes.scatter(points[:, 0], points[:, 1], 900 * weights, color=COLOURS[0], zorder=3)
    for (x, y), weight in zip(points, weights, strict=True):
        axes.annotate(f"{weight:.3g}", (x, y), (0, 16), textcoords="offset points", ha="center", fontsize=9, zorder=4)
