"""The figure of a forecast: each error over time with what is wanted, and below it what it is made of."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.planning.curves import Curves, Reached
from sins_env.evaluation.planning.quantities import QUANTITIES
from sins_env.evaluation.show.style import COLOURS, DOTTED, finish, new_figure, style

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

SHOWN = ("azimuth", "level", "velocity", "position")  #: quantities with a panel
LEAST_SHARE, MOST_SOURCES = 0.03, 7  #: sources that never reach this share, or are too many, are drawn as one


def forecast_figure(one: Curves) -> Figure:
    """Draw the bound over time; below it the shares of the sources of error, or beside it the members of a family."""
    names = [name for name in SHOWN if name in one.sigma]
    shared = bool(one.sources) and not one.family
    figure = new_figure(4.1 * len(names), 6.6 if shared else 4.3)
    panels = figure.subplots(1 + shared, len(names), sharex=True, squeeze=False)
    for axes, name in zip(panels[0], names, strict=True):
        _curves(axes, one, name)
    if shared:
        layers = _layers(one, names)
        for axes, name in zip(panels[1], names, strict=True):
            _shares(axes, one, name, layers)
    for axes in panels[-1]:
        axes.set_xlabel("time, s")
        axes.set_xlim(0, one.t[-1])
    reference = "" if one.holds else ", a reference only"
    title = f"{one.task.name}: Cramér-Rao bound, 1 sigma{reference}"
    figure.suptitle(title, x=0.01, ha="left", fontsize=12)
    handles, labels = panels[-1, 0].get_legend_handles_labels()
    if labels:
        columns = min(len(labels), max(2, round(1.1 * len(names))))
        figure.legend(handles, labels, loc="outside lower center", ncols=columns, frameon=False, fontsize=9)
    return figure


def _curves(axes: Axes, one: Curves, name: str) -> None:
    q = QUANTITIES[name]
    members: dict[str, Curves] = {"as it is": one, **one.family} if one.family else {"": one}
    for i, (label, member) in enumerate(members.items()):
        line = {"color": "black", "linewidth": 1.4} if not i else style(i - 1)
        axes.plot(member.t, member.sigma[name] / q.unit, label=label or None, **line)
    finish(axes, q.what, ylabel=q.unit_name, yscale="log")
    low, high = axes.get_ylim()
    asked = []
    for found in (found for found in one.reached if found.wanted.quantity == name):
        size = found.wanted.size / q.unit
        asked.append(axes.axhline(size, label=_asked(found, bool(one.family)), **DOTTED))
        low, high = min(low, size / 1.3), max(high, 1.3 * size)
        if math.isfinite(found.holds_s) and not one.family:
            axes.plot([found.holds_s], [size], "o", color=COLOURS[1], markersize=5, zorder=4)
    axes.set_ylim(low, high)
    if asked:
        axes.legend(handles=asked, loc="upper right", fontsize=8, framealpha=0.9, edgecolor="none")


def _asked(found: Reached, of_family: bool) -> str:
    """Return the label of a wanted accuracy, with the time from which on it holds."""
    if of_family:
        return found.wanted.text
    if math.isfinite(found.holds_s):
        return f"{found.wanted.text} from {found.holds_s:.0f} s on"
    return f"{found.wanted.text}: {'never' if math.isinf(found.first_s) else 'not to the end'}"


def _layers(one: Curves, names: list[str]) -> list[tuple[str, list[int], Any]]:
    """Return the layers of the shares, the largest first: label, indices of sources, colour. The small ones are one layer."""
    shares = np.array([one.shares[name] for name in names])  # (quantities, times, sources)
    order = np.argsort(-shares[:, -1].max(axis=0), kind="stable").tolist()
    often = np.argsort(-shares.mean(axis=1).max(axis=0), kind="stable")[:MOST_SOURCES].tolist()
    large = [s for s in order if s in often and shares[..., s].max() >= LEAST_SHARE]
    small = [s for s in order if s not in large]
    colours = (*COLOURS[:-1], "0.35")
    layers: list[tuple[str, list[int], Any]] = [(one.sources[s], [s], colours[i]) for i, s in enumerate(large)]
    return [*layers, ("all others", small, "0.8")] if small else layers


def _shares(axes: Axes, one: Curves, name: str, layers: list[tuple[str, list[int], Any]]) -> None:
    parts: list[Array] = [100 * one.shares[name][:, sources].sum(axis=1) for _, sources, _ in layers]
    labels, colours = [label for label, _, _ in layers], [colour for _, _, colour in layers]
    axes.stackplot(one.budget_t, parts, labels=labels, colors=colours, alpha=0.85, linewidth=0.4, edgecolor="white")
    finish(axes, f"{name}: share in the variance", ylabel="%", ylim=(0, 100))
    axes.grid(visible=False)
