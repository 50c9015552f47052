"""The figure of a bank: headings of its slices, and probabilities of its models and regimes, over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from sins_env.arrays import Array
from sins_env.evaluation.show.style import COLOURS, finish, new_figure
from sins_env.units import DEG

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEAST_WEIGHT = 1e-3  #: weight below which a slice is not drawn
LARGEST = 40.0  #: points^2, area of the dot of a slice of weight one


def bank_figure(
    t: ArrayLike, facts: Sequence[Mapping[str, Array]], labels: Mapping[str, Sequence[str]], title: str
) -> Figure:
    """Draw what the ``diagnostics()`` of a bank told of one run at the times ``t`` (K,), s.

    ``facts`` are K of them, and ``labels`` name the entries of ``model_probabilities`` and ``regime_probabilities``.
    """
    t = np.asarray(t)
    figure = new_figure(9.0, 8.0)
    top, *others = figure.subplots(1 + len(labels), 1, sharex=True)
    weights, headings = (np.array([one[name] for one in facts]) for name in ("slice_weights", "slice_headings_rad"))
    shown = weights > LEAST_WEIGHT
    times = np.broadcast_to(t[:, None], weights.shape)[shown]
    top.scatter(times, headings[shown] / DEG, s=LARGEST * weights[shown], color=COLOURS[0], linewidths=0)
    finish(top, "headings of the slices, by weight", ylabel="deg")
    for axes, (name, entries) in zip(others, labels.items(), strict=True):
        _stack(axes, t, np.array([one[name] for one in facts]), name.replace("_", " "), entries)
    others[-1].set(xlabel="time, s", xlim=(t[0], t[-1]))
    figure.suptitle(title, x=0.01, ha="left", fontsize=12)
    return figure


def _stack(axes: Axes, t: Array, shares: Array, title: str, entries: Sequence[str]) -> None:
    axes.stackplot(t, shares.T, labels=entries, colors=COLOURS, alpha=0.85)
    finish(axes, title)
    axes.set_ylim(0.0, 1.0)
    axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False, fontsize=9)
