"""The figure of a replay that navigates: the ground track, and the errors of heading, velocity and position.

Without a reference the panels of errors have what the solver says against itself. These are the sigma of the heading, and the
innovations of the fixes in their band of 2 sigma, with residuals to withheld fixes. The last panel has the mean NIS in windows
and its chi-square band.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from sins_env import earth
from sins_env.arrays import Array
from sins_env.evaluation.replay.angles_figure import REFERENCE, colours, window_label, windows_text
from sins_env.evaluation.replay.consistency import Consistency, judge
from sins_env.evaluation.replay.replaying import Replay
from sins_env.evaluation.replay.track import Track
from sins_env.evaluation.show.style import COLOURS, finish, new_figure
from sins_env.states import FIX, NAVIGATION

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


_FIX, _UP = "#D55E00", "#009E73"
_KINDS = (("velocity error", "m/s"), ("position error", "m"), ("displacement error", "m"))


def track_figure(one: Replay) -> Figure:
    """Draw the ground track with reference and fixes, and beside it the errors over time."""
    track = one.track
    assert track is not None
    out = new_figure(13.0, 8.4)
    grid = out.add_gridspec(4, 2, width_ratios=[1, 1.25])
    way = out.add_subplot(grid[:, 0])
    panels = [out.add_subplot(grid[0, 1])]
    panels += [out.add_subplot(grid[i, 1], sharex=panels[0]) for i in (1, 2, 3)]
    _draw_way(way, one, track)
    _draw_heading(panels[0], one)
    judged = [judge(one, i) for i in range(len(one.starts))] if one.told is not None else []
    errors = [[(one.t, part[i]) for i in range(len(one.starts))] for part in (track.vel_error, track.pos_error)]
    errors.append([track.displacement_errors(i) for i in range(len(one.starts))])
    for axes, (name, unit), courses in zip(panels[1:], _KINDS, errors, strict=True):
        if any(np.isfinite(error).any() for _, error in courses) or not judged:
            _draw_errors(axes, one, name, unit, courses)
        elif name == "displacement error":
            _draw_means(axes, judged)
        else:
            _draw_innovations(axes, one, name.removesuffix(" error"), unit)
    for axes in panels:
        axes.set_xlim(0, one.t[-1])
        axes.grid(alpha=0.35, linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
        axes.tick_params(labelsize=9, labelbottom=axes is panels[-1])
        if one.coarse_s:
            axes.axvspan(0, one.coarse_s, color="0.5", alpha=0.15, linewidth=0)
    panels[-1].set_xlabel("time in the window, s" + ("; shaded: coarse phase" if one.coarse_s else ""))
    out.suptitle(f"{one.solver} on {one.recording}, {windows_text(one)}", x=0.01, ha="left", fontsize=12)
    return out


def _draw_way(axes: Axes, one: Replay, track: Track) -> None:
    """Draw the ground track in metres from the site; the reference is the estimate minus its error."""
    site, model = track.recording.site.pos, earth.get(track.recording.site.earth)

    def metres(pos: Array) -> tuple[Array, Array]:
        east, north, _ = np.moveaxis(earth.offset(model, np.broadcast_to(site, pos.shape), pos), -1, 0)
        return east, north

    for i, colour in enumerate(colours(len(one.starts))):
        fine = track.pos[i, track.fine]
        axes.plot(*metres(fine), color=colour, linewidth=1.4, label=window_label(one, i))
        axes.plot(*metres(fine[:1]), "o", color=colour, markersize=5, label="start" if i == 0 else None)
        if one.reference is not None:
            truth = earth.displace(model, fine, -track.pos_error[i, track.fine])
            label = "reference" if i == 0 else None
            axes.plot(*metres(truth), color=REFERENCE, linewidth=0.9, linestyle=(0, (4, 2)), label=label)
        label = "fixes of the antenna" if i == 0 else None
        axes.plot(*metres(track.fixes[i]), ".", color=_FIX, markersize=4, label=label)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set(xlabel="east of the site, m", ylabel="north of the site, m")
    axes.grid(alpha=0.35, linewidth=0.6)
    axes.set_title("the way after the coarse phase" if one.coarse_s else "the way", fontsize=10, loc="left")
    axes.legend(frameon=False, fontsize=9, loc="best")


def _draw_heading(axes: Axes, one: Replay) -> None:
    if one.reference is None:
        _draw_sigma(axes, one)
        return
    error = np.degrees(one.scatter[..., 0])
    for i, colour in enumerate(colours(len(one.starts))):
        axes.plot(one.t, error[i], color=colour, linewidth=1.1)
    late = np.abs(error[:, one.t > 0.5 * one.coarse_s])
    most = float(np.nanmax(late)) if np.isfinite(late).any() else 1.0
    axes.set_ylim(-1.1 * most, 1.1 * most)
    axes.axhline(0.0, color=REFERENCE, linewidth=0.8)
    rms = np.degrees(np.sqrt(np.nanmean(np.square(one.scatter[:, -1, 0]))))
    axes.set_title(f"heading error   at the end {rms:.3f} deg{' RMS' * (len(error) > 1)}", fontsize=10, loc="left")
    axes.set_ylabel("deg")


def _draw_sigma(axes: Axes, one: Replay) -> None:
    """Draw the sigma of the heading that the solver tells."""
    if one.told is None or not np.isfinite(one.told.cov).any():
        axes.set_title("no reference, and the solver tells no covariance", fontsize=10, loc="left")
        return
    up = NAVIGATION["phi"].stop - 1
    sigma = np.degrees(np.sqrt(np.abs(one.told.cov[:, :, up, up])))
    for line, colour in zip(sigma, colours(len(sigma)), strict=True):
        axes.plot(one.t, line, color=colour, linewidth=1.3)
        axes.fill_between(one.t, 0.1 * float(np.nanmin(sigma)), line, color=colour, alpha=0.12, linewidth=0)
    finish(axes, f"sigma of the heading   at the end {sigma[:, -1].max():.3g} deg", yscale="log", ylabel="deg")
    axes.set_ylim(0.5 * float(np.nanmin(sigma)))


def _draw_innovations(axes: Axes, one: Replay, name: str, unit: str) -> None:
    """Draw the innovations of the fixes with their 2 sigma, and residuals to withheld fixes."""
    told, track = one.told, one.track
    assert told is not None
    assert track is not None
    here, most = FIX["dv" if name == "velocity" else "dp"], 0.0
    for i in range(len(one.starts)):
        nu, S = told.innovations(i, FIX.size)
        nu = nu[:, here]
        seen = np.isfinite(nu).all(axis=-1)
        if not seen.any():
            continue
        t, two = one.t[seen], 2 * np.sqrt(np.abs(np.diagonal(S[seen][:, here, here], axis1=-2, axis2=-1)))
        for j, (axis, colour) in enumerate(zip(("east", "north", "up"), COLOURS, strict=False)):
            axes.plot(t, nu[seen, j], ".", color=colour, markersize=3, label=axis if i == 0 else None)
        tube, gap = two.max(axis=1), np.diff(t, prepend=t[0]) > 3.5 * np.median(np.diff(t)) if len(t) > 1 else t < t
        for part in np.split(np.arange(len(t)), np.flatnonzero(gap)):
            axes.fill_between(t[part], -tube[part], tube[part], color="0.5", alpha=0.18, linewidth=0)
        most = max(most, float(np.percentile(two, 90)), float(np.percentile(np.abs(nu[seen]), 99)))
    if most == 0.0:
        axes.set_title(f"{name}: no innovations are told", fontsize=10, loc="left")
        return
    text = f"innovations of {name}, and their 2 sigma"
    if name == "position" and track.outages_s:
        text += "; x: withheld fixes"
        for i in range(len(one.starts)):
            held = track.withheld(i)
            axes.plot(held.t, held.residual, "x", color=_FIX, markersize=5)
            most = max(most, float(np.abs(held.residual).max(initial=0.0)))
    axes.axhline(0.0, color=REFERENCE, linewidth=0.8)
    axes.set_ylim(-1.3 * most, 1.3 * most)
    axes.set_ylabel(unit)
    axes.set_title(text, fontsize=10, loc="left")
    axes.legend(fontsize=8, loc="upper right", ncols=3, framealpha=0.85, edgecolor="none")


def _draw_means(axes: Axes, judged: Sequence[Consistency]) -> None:
    """Draw the mean NIS in windows, over its expectation, with the band that a true model keeps."""
    drawn = False
    for one in judged:
        for (name, means), colour in zip(one.means.items(), COLOURS, strict=False):
            if not len(means.value):
                continue
            edges = np.append(means.begin, means.end[-1])
            label = name if not drawn or len(judged) == 1 else None
            axes.stairs(means.value, edges, color=colour, linewidth=1.5, label=label, baseline=None)
            if not drawn:
                axes.stairs(means.high, edges, baseline=means.low, fill=True, color="0.5", alpha=0.18, linewidth=0)
            drawn = True
    if not drawn:
        axes.set_title("too few innovations once the heading is known", fontsize=10, loc="left")
        return
    finish(axes, "mean NIS in windows, 1 expected, and its band", yscale="log", ylabel="NIS / components")
    axes.axhline(1.0, color=REFERENCE, linewidth=0.8)
    axes.legend(frameon=False, fontsize=8, loc="upper left", ncols=2)


def _draw_errors(axes: Axes, one: Replay, name: str, unit: str, courses: list[tuple[Array, Array]]) -> None:
    """Draw the horizontal and vertical error of each window after the coarse phase, as points if there are few."""
    shown = []
    for i, ((t, error), colour) in enumerate(zip(courses, colours(len(courses)), strict=True)):
        late = t > one.coarse_s
        style = {"marker": ".", "linestyle": "none"} if len(t) < 0.5 * len(one.t) else {"linewidth": 1.1}
        horizontal = np.linalg.norm(error[late, :2], axis=-1)
        for values, shade, label in ((horizontal, colour, "horizontal"), (error[late, 2], _UP, "up")):
            axes.plot(t[late], values, color=shade, label=label if i == 0 else None, **style)
        shown.append(error[late])
    everything = np.concatenate(shown)
    axes.axhline(0.0, color=REFERENCE, linewidth=0.8)
    axes.set_ylabel(unit)
    if not np.isfinite(everything).any():
        axes.set_title(f"{name}: nothing to compare with", fontsize=10, loc="left")
        return
    squares = np.nanmean(np.square(everything), axis=0)
    rms = f"RMS {np.sqrt(squares[:2].sum()):.3f} {unit} horizontal, {np.sqrt(squares[2]):.3f} {unit} up"
    axes.set_title(f"{name}   {rms}", fontsize=10, loc="left")
    axes.legend(frameon=False, fontsize=8, loc="upper left", ncols=2)
