"""Figures of examples 1 and 2 of 002: the noise as the adaptive filters estimate it, and the errors of all filters."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sins_env.evaluation.reproduction.pictures.common import legend, plain
from sins_env.evaluation.show.style import new_figure, style

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: For each example the statistics with the range that is drawn, and the states whose errors are drawn.
SHOWN: dict[int, tuple[dict[str, tuple[float, float]], tuple[int, ...]]] = {
    1: ({"q": (-0.2, 1.0), "Q": (-0.2, 1.8)}, (1, 3)),
    2: ({"R": (-0.5, 3.0)}, (2,)),
}
WHAT = {
    "q": "mean of the process noise",
    "Q": "variance of the process noise",
    "R": "variance of the measurement noise",
}
SMOOTHED = 25  #: number of steps over which an RMS is taken


def draw_example(number: int, example: Any) -> Figure:
    """Draw the figure of a ``solvers.toy_examples.Example``."""
    noises, states = SHOWN[number]
    figure = new_figure(11.0, 3.6 * len(states) + 0.4)
    panels = iter(figure.subplots(len(states), 2).ravel())
    for name, limits in noises.items():
        _noise(next(panels), example, name, limits)
    for state in states:
        _errors(next(panels), example, state)
    for axes in figure.axes:
        plain(axes)
        axes.set(xlim=(0, len(example.truth.x)), xlabel="step")
    legend(figure, figure.axes, columns=5)
    return figure


def _look(example: Any, label: str) -> dict[str, Any]:
    return style(list(example.tracks).index(label))


def _noise(axes: Axes, example: Any, name: str, limits: tuple[float, float]) -> None:
    """Draw the median and 5 to 95 % of the runs, and the first run as a thin line."""
    true = example.noise[name]
    k = np.arange(1, len(true) + 1)
    axes.step(k, true, where="mid", color="black", linewidth=1.0, label="truth")
    axes.axhspan(limits[0], 0.0 if name != "q" else limits[0], color="black", alpha=0.08, linewidth=0)
    for label in ("as printed", "safeguarded"):
        values, look = example.estimate(label, name), _look(example, label)
        low, middle, high = np.nanpercentile(values, [5, 50, 95], axis=1)
        axes.fill_between(k, low, high, color=look["color"], alpha=0.15, linewidth=0)
        axes.plot(k, middle, label=label, **look)
        axes.plot(k, values[:, 0], color=look["color"], linewidth=0.6)
    axes.set_title(f"estimate of {name}, the {WHAT[name]}", loc="left", fontsize=10)
    axes.set(ylim=limits, ylabel=name)


def _errors(axes: Axes, example: Any, state: int) -> None:
    half = SMOOTHED // 2
    for label in example.tracks:
        squares = np.mean(example.errors(label)[..., state - 1] ** 2, axis=1)
        rms = np.sqrt(np.convolve(squares, np.full(SMOOTHED, 1 / SMOOTHED), mode="valid"))
        axes.plot(np.arange(len(rms)) + half + 1, rms, label=label, **_look(example, label))
    axes.set_title(f"error of x{state}", loc="left", fontsize=10)
    axes.set_ylabel(f"RMS over runs and {SMOOTHED} steps")
    axes.set_ylim(bottom=0)
