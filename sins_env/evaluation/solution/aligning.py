"""How an alignment converged: heading, pitch and roll with their sigmas, a line for each doubling of the time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.table import Table

from sins_env.evaluation.show.rich_tables import titled
from sins_env.evaluation.solution.epochs import Epochs

FIRST_S = 10.0  #: time of the first line, s from the start

Line = dict[str, float]


def course(one: Epochs) -> list[Line]:
    """Return angles and sigmas in deg at 10, 20, 40 ... s from the start, and at the end."""
    start = float(one.replay.starts[0])
    since = one.time - start
    wanted = FIRST_S * 2.0 ** np.arange(64)
    times = [*wanted[wanted < since[-1] - 1e-6], since[-1]]
    k = np.searchsorted(since, np.array(times) - 1e-6)
    angles, sigmas = np.degrees(one.angles[k]), np.degrees(one.sigma_attitude[k])
    names = ("heading_deg", "pitch_deg", "roll_deg")
    return [
        {
            "after_s": float(t),
            **dict(zip(names, a.tolist(), strict=True)),
            **{f"sigma_{n}": float(v) for n, v in zip(names, s, strict=True)},
        }
        for t, a, s in zip(since[k], angles, sigmas, strict=True)
    ]


def table(lines: Sequence[Line]) -> Table:
    """Return the lines of a course as a table."""
    out = titled("how it converged, deg")
    for name in ("after, s", "heading", "sigma", "pitch", "sigma", "roll", "sigma"):
        out.add_column(name, justify="right", no_wrap=True)
    for line in lines:
        pairs = [(line[f"{name}_deg"], line[f"sigma_{name}_deg"]) for name in ("heading", "pitch", "roll")]
        out.add_row(
            f"{line['after_s']:g}", *[text for angle, sigma in pairs for text in (f"{angle:.4f}", f"{sigma:.2g}")]
        )
    return out
