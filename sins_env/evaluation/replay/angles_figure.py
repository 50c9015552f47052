"""The figure of a replay: heading, pitch, roll over time in every window, and their spread over the windows."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.evaluation.replay.replaying import ANGLES, Replay, mean_angle
from sins_env.evaluation.replay.told import sigma_of_angles
from sins_env.evaluation.show.style import new_figure
from sins_env.recordings import seconds
from sins_env.states import ATTITUDE

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MOST_NAMED = 8  #: most windows for which the legend names each
JUMP_DEG = 20.0  #: jump between two epochs at which a line breaks; only a first guess turns so fast
_COLOUR, REFERENCE, _SPREAD = "#0072B2", "0.15", "#D55E00"


def replay_figure(one: Replay) -> Figure:
    """Draw each angle over time in every window, with the reference, and beside it the spread over the windows."""
    several = sum(not why for why in one.failed) > 1
    out = new_figure(12.0 if several else 9.0, 7.6)
    panels = out.subplots(3, 2 if several else 1, sharex=True, squeeze=False, width_ratios=[2, 1] if several else [1])
    for j, name in enumerate(ANGLES):
        _draw_angle(panels[j, 0], one, j, name)
        if several:
            _draw_spread(panels[j, 1], one, j, name)
    for axes in panels.ravel():
        axes.grid(alpha=0.35, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=9)
        if one.coarse_s:
            axes.axvspan(0, one.coarse_s, color="0.5", alpha=0.15, linewidth=0, label="coarse phase")
    for axes in panels[-1]:
        axes.set(xlabel="time in the window, s", xlim=(0, one.t[-1]))
    out.suptitle(f"{one.solver} on {one.recording}, {windows_text(one)}", x=0.01, ha="left", fontsize=12)
    named = dict(zip(*panels[0, 0].get_legend_handles_labels()[::-1], strict=True))
    for last in ("reference", "coarse phase"):
        if last in named:
            named[last] = named.pop(last)
    out.legend(named.values(), named.keys(), loc="outside lower center", ncols=5, frameon=False, fontsize=9)
    return out


def _draw_angle(axes: Axes, one: Replay, j: int, name: str) -> None:
    fine = one.t > one.coarse_s
    good = [i for i, why in enumerate(one.failed) if not why]
    seen = one.angles if one.reference is None else one.reference
    centre = mean_angle(seen[:, -1, j]) if np.isfinite(seen[:, -1, j]).any() else 0.0
    centre = float(centre) if np.isfinite(centre) else 0.0

    def degrees(values: Array) -> Array:
        """Return degrees that are continuous near the centre."""
        return np.degrees((centre % (2 * np.pi) if j == 0 else centre) + attitude.wrap(values - centre))

    shown = []
    for i, colour in enumerate(colours(len(one.starts))):
        label = window_label(one, i)
        line = degrees(one.angles[i, :, j])
        broken = np.where(np.abs(np.diff(line, prepend=line[:1])) > JUMP_DEG, np.nan, line)
        axes.plot(one.t, broken, color=colour, linewidth=1.0, alpha=0.8, label=label)
        if i in good:
            shown.append(line[fine])
        if one.told is not None and len(one.starts) == 1:
            two = 2 * np.degrees(
                sigma_of_angles(one.angles[i], one.told.cov[i][:, ATTITUDE["phi"], ATTITUDE["phi"]])[:, j]
            )
            axes.fill_between(one.t, line - two, line + two, color=colour, alpha=0.15, linewidth=0, label="2 sigma")
        if one.reference is not None:
            label = "reference" if i == 0 else None
            line = degrees(one.reference[i, :, j])
            axes.plot(one.t, line, color=REFERENCE, linewidth=0.8, linestyle=(0, (4, 2)), label=label)
            shown.append(line[fine])
    values = np.concatenate(shown) if shown else np.zeros(1)
    values = values[np.isfinite(values)]
    if len(values):
        low, high = np.percentile(values, [1, 99])
        margin = max(0.25 * (high - low), 0.01)
        axes.set_ylim(low - margin, high + margin)
    axes.ticklabel_format(axis="y", useOffset=False)
    said = ""
    if good:
        mean = float(np.degrees(mean_angle(one.angles[good][:, -1, j])))
        said = f"   at the end {mean % 360 if j == 0 else mean:.3f} deg{', the mean' * (len(good) > 1)}"
    axes.set_title(f"{name}{said}", fontsize=10, loc="left")
    axes.set_ylabel("deg")


def windows_text(one: Replay) -> str:
    """Return the number and length of the windows, or the start and end of a single one."""
    if len(one.starts) > 1:
        return f"{len(one.starts)} windows of {one.t[-1]:g} s"
    return f"{seconds(one.starts[0])} to {seconds(one.starts[0] + one.t[-1])} s"


def window_label(one: Replay, i: int) -> str | None:
    """Return the label of a window; None if the legend has no room for it."""
    return f"estimate from {seconds(one.starts[i])} s" if len(one.starts) <= MOST_NAMED or i == 0 else None


def colours(count: int) -> Any:
    """Return a colour per window, in order of time."""
    import matplotlib  # slow to import

    return [_COLOUR] if count == 1 else matplotlib.colormaps["viridis"](np.linspace(0.0, 0.88, count))


def _draw_spread(axes: Axes, one: Replay, j: int, name: str) -> None:
    spread = np.degrees(one.spread[:, j])
    of = "error" if one.reference is not None else "angle"
    axes.plot(one.t, np.maximum(spread, 1e-9), color=_SPREAD, linewidth=1.4)
    axes.set_yscale("log")
    axes.set_title(f"spread of its {of}   at the end {spread[-1]:.3g} deg", fontsize=10, loc="left")
    axes.set_ylabel("deg, 1 sigma")
    from matplotlib.ticker import FuncFormatter, NullFormatter  # slow to import

    there = spread[np.isfinite(spread) & (spread > 0)]
    if len(there):
        low, high = np.log10(np.percentile(there, [1, 100]))
        axes.set_ylim(10.0 ** np.floor(low), 10.0 ** np.ceil(high))
    axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())
