"""All azimuths that 000 prints in chapters 3 to 5, together beside the bound, because each alone may be luck."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from sins_env.evaluation.reproduction.documents.thesis_filters import (
    AZIMUTH,
    BASES,
    MARKOV,
    MATCHED,
    PRINTINGS,
    QUICK,
    RUNS,
    WHITE,
    cap,
    task_of,
)
from sins_env.evaluation.reproduction.readings.common import bound_at, errors_at
from sins_env.evaluation.reproduction.tables import Group, Line, Picture, Source, Table
from sins_env.evaluation.reproduction.verdicts import Estimate, Printed, capped_rms
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.style import COLOURS, new_figure
from sins_env.units import ARCSEC

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIRST = "UKF"  #: the filter that is said not to converge
Azimuth = tuple[str, float, float]  #: label, time in s, printed azimuth in arcsec


def azimuths(noise: str, new: bool) -> list[Azimuth]:
    """Return the azimuths printed at the end of a run, of the new filters or of the UKF.

    A figure that several tables repeat counts once.
    """
    found = {
        (column.solver, p.end_s): (column.label, p.end_s, column.printed[AZIMUTH])
        for p in PRINTINGS
        for column in p.columns
        if p.noise == noise and column.printed and (column.label != FIRST) == new
    }
    return list(found.values())


def printed_extremes() -> tuple[float, float]:
    """Return the smallest and the largest size among the azimuths of the new filters, arcsec."""
    sizes = [abs(value) for noise in BASES for *_, value in azimuths(noise, new=True)]
    return min(sizes), max(sizes)


class _Together:
    """Reader of the RMS azimuth over runs and some times, arcsec, with its bound."""

    def __init__(self, noise: str, times_s: Sequence[float]) -> None:
        self._times, self._cap = times_s, cap(noise, MATCHED, AZIMUTH) / ARCSEC

    def __call__(self, results: Results) -> Estimate:
        squares = [np.square(errors_at(results, t)[:, AZIMUTH] / ARCSEC) for t in self._times]
        bound = [(bound_at(results, AZIMUTH, t) / ARCSEC) ** 2 for t in self._times]
        return capped_rms(np.sqrt(np.mean(squares, axis=0)), self._cap, bound=math.sqrt(np.mean(bound)))


def _lines(noise: str) -> Iterator[Line]:
    for new, who in ((True, "new filters"), (False, FIRST)):
        printed = azimuths(noise, new)
        read = _Together(noise, [t for _, t, _ in printed])
        rms = math.sqrt(np.mean([value**2 for *_, value in printed]))
        for records, words in ((len(printed), "each a record of its own"), (1, "one record in all"))[: 1 + new]:
            yield Line(f"{who}, {words}", task_of(noise, MATCHED), "ckf", read, {}, Printed(rms, records))


def _draw(results: Sequence[Results]) -> Figure:
    figure = new_figure(10.0, 4.8)
    axes = figure.subplots(1, 2, sharey=True)
    for ax, noise, one in zip(axes, BASES, results, strict=True):
        t = np.asarray(one.records.criteria.history_t)
        rms = np.sqrt(np.mean(np.square(one.records.history[:, :, AZIMUTH], dtype=float), axis=0)) / ARCSEC
        ax.plot(t, rms, color=COLOURS[0], linewidth=1.6, label=f"CKF, matched prior: RMS of {len(one.records)} runs")
        if one.bound is not None:
            sigma = one.bound.sigma[:, AZIMUTH] / ARCSEC
            ax.plot(one.bound.t, sigma, color="black", linewidth=1.2, label="Cramér-Rao bound of these sensors")
            ax.fill_between(one.bound.t, 0.1, sigma, color="black", alpha=0.07, linewidth=0)
        for new, colour, marker, who in ((True, COLOURS[1], "o", "new filters"), (False, COLOURS[2], "s", FIRST)):
            printed = azimuths(noise, new)
            times, sizes = [at for _, at, _ in printed], [abs(value) for *_, value in printed]
            ax.plot(times, sizes, marker, color=colour, label=f"printed in 000: {who}")
            if new:
                _names(ax, printed)
        ax.set_title(noise, loc="left", fontsize=11)
        ax.set(xlabel="time, s", yscale="log", ylim=(10, 6e4), xlim=(0, t[-1] * 1.22))
        ax.grid(which="major", alpha=0.35, linewidth=0.6)
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("azimuth error, arcsec")
    axes[0].legend(frameon=False, fontsize=9, loc="upper right")
    return figure


def _names(ax: Axes, printed: Sequence[Azimuth]) -> None:
    """Write names beside the points, at the first time to their left; names at one time are kept apart."""
    times = sorted({t for _, t, _ in printed})
    for at in times:
        x, side = (at - 8, "right") if at == times[0] else (at + 8, "left")
        low = 0.0
        for name, _, value in sorted((one for one in printed if one[1] == at), key=lambda one: abs(one[2])):
            low = max(math.log10(abs(value)), low + 0.11)
            ax.text(x, 10**low, name, fontsize=7.5, va="center", ha=side)


def _group(noise: str) -> Group:
    title = (
        f"{noise}, {len(azimuths(noise, True))} azimuths of new filters, {len(azimuths(noise, False))} of the {FIRST}"
    )
    return Group(title, "arcsec", tuple(_lines(noise)), RUNS, QUICK, WHY)


WHY = (
    "Filters in one run have nearly the same errors, so that their printed azimuths are not so many independent records; but even "
    "if all of them were one, it would have to be a lucky one, and then the UKF's error in the same run would be as small."
)
PICTURE = Picture(
    "000-azimuths",
    "Every azimuth that 000 prints at the end of a run of chapters 3 to 5, beside what its sensors allow (grey: below the bound, "
    "1 sigma) and what a CKF with a matched prior has.",
    _draw,
    tuple(Source(task_of(noise, MATCHED), "ckf") for noise in (WHITE, MARKOV)),
    runs=RUNS,
    quick=QUICK,
)
TABLES = (
    Table(
        "000.azimuths",
        "chapters 3 to 5 at once",
        "000",
        "RMS of the azimuths printed at the end of a run, over filters and tables, beside that of the CKF with a matched prior "
        "at the same times. What a table repeats from another counts once.",
        (_group(WHITE), _group(MARKOV)),
        name="all azimuths",
        pictures=(PICTURE,),
    ),
)
