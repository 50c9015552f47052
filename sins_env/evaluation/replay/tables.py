"""Tables of a replay: angles at the end of each window, and the RMS of navigation errors."""

from __future__ import annotations

import math

import numpy as np
from rich.markup import escape
from rich.table import Table

from sins_env.arrays import Array
from sins_env.evaluation.replay.replaying import ANGLES, Replay, mean_angle
from sins_env.evaluation.replay.track import Track
from sins_env.evaluation.show.rich_tables import titled
from sins_env.recordings import seconds

MOST_ROWS = 24  #: most windows with a row of their own


def table(one: Replay) -> Table:
    """Return a table with a row per window, and the mean, spread and RMS over the windows."""
    out = titled(f"{one.solver} on {one.recording}, at the end of each window")
    out.add_column("window, s", no_wrap=True)
    scored = one.reference is not None
    for name in ANGLES:
        out.add_column(f"{name}, deg", justify="right")
    for name in ANGLES if scored else ():
        out.add_column(f"{name} error, deg", justify="right")
    last, error = np.degrees(one.angles[:, -1]), np.degrees(one.scatter[:, -1])
    for i, start in enumerate(one.starts[:MOST_ROWS]):
        cells = [f"{value:.3f}" for value in last[i]] + [f"{value:+.5f}" for value in error[i] if scored]
        cells = [escape(one.failed[i]), *[""] * (len(cells) - 1)] if one.failed[i] else cells
        out.add_row(f"{seconds(start)} to {seconds(start + one.t[-1])}", *cells, end_section=i + 1 == len(one.starts))
    if len(one.starts) > MOST_ROWS:
        out.add_row(f"... {len(one.starts) - MOST_ROWS} more", end_section=True)
    good = [not why for why in one.failed]
    if sum(good) > 1:
        mean = np.degrees(mean_angle(one.angles[good][:, -1]))
        mean[0] %= 360.0
        spread = np.degrees(one.spread[-1])
        if scored:
            rms = np.sqrt(np.mean(error[good] ** 2, axis=0))
            blank = ["", "", ""]
            out.add_row("mean", *blank, *[f"{value:+.5f}" for value in error[good].mean(axis=0)])
            out.add_row("spread (1 sigma)", *blank, *[f"{value:.5f}" for value in spread])
            out.add_row("RMS", *blank, *[f"{value:.5f}" for value in rms])
        else:
            out.add_row("mean", *[f"{value:.3f}" for value in mean])
            out.add_row("spread (1 sigma)", *[f"{value:.5f}" for value in spread])
    return out


def add_rows(table: Table, errors: Array) -> None:
    """Add rows to the table of a run: errors (D, 3) m of the displacements, against those from carrier phase.

    They are a check that does not depend on the reference.
    """
    for name, part in (("hor.", errors[:, :2]), ("vert.", errors[:, 2:])):
        if len(part):
            squares = np.square(part).sum(axis=1)
            table.add_row(
                f"displacement, {name}", f"{math.sqrt(squares[-1]):.3f} m", f"{math.sqrt(squares.mean()):.3f} m"
            )


def _withheld(track: Track, window: int) -> dict[str, tuple[float, float]]:
    """Return the horizontal and vertical RMS residual to the fixes that were withheld from a window, m, if there are some."""
    residual = track.withheld(window).residual
    if not len(residual):
        return {}
    east, north, up = np.square(residual).mean(axis=0)
    return {"withheld fixes, m": (math.sqrt(east + north), math.sqrt(up))}


def track_table(one: Replay, most: int) -> Table:
    """Return a table of a replay that navigates, with a row for each of the first ``most`` windows."""
    track = one.track
    assert track is not None
    out = titled(f"{one.solver} on {one.recording}, RMS after the coarse phase, horizontal and vertical")
    out.add_column("window, s", no_wrap=True)
    coarse = int((~track.fine).sum())
    aligned = one.reference is not None and coarse > 0
    if aligned:
        out.add_column(f"heading error\nat {track.t[coarse - 1]:g} s, deg", justify="right")
    scores = [track.scores(i) | _withheld(track, i) for i in range(min(len(one.starts), most))]
    names = list(dict.fromkeys(name for each in scores for name in each))
    for name in names:
        out.add_column(name, justify="right")
    nothing = ["nothing to compare with"] if not (names or aligned) else []
    if nothing:
        out.add_column("errors")
    for i, each in enumerate(scores):
        cells = [f"{np.degrees(one.scatter[i, coarse - 1, 0]):+.3f}"] if aligned else []
        cells += [f"{each[name][0]:.3f}  {each[name][1]:.3f}" if name in each else "-" for name in names]
        out.add_row(f"{seconds(one.starts[i])} to {seconds(one.starts[i] + one.t[-1])}", *cells, *nothing)
    count = len(track.displacement_errors(0)[0])
    if count:
        span = track.recording.displacements.span_s  # type: ignore[union-attr]
        out.caption = (
            f"displacements: of the antenna in {span:g} s, less what the phase of the carrier says; {count} in a window"
        )
        out.caption_justify = "left"
    return out
