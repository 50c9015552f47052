"""Figures 2.3 to 2.5 of 000: misalignment left by 180 s of coarse alignment on the swaying base, fifty records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sins_env.evaluation.reproduction.pictures.common import legend, plain
from sins_env.evaluation.reproduction.pictures.courses import AXES
from sins_env.evaluation.reproduction.readings.common import FAILED, error, errors_at, mean_error
from sins_env.evaluation.reproduction.readings.sway import largest
from sins_env.evaluation.reproduction.tables import Group, Line, Picture, Source, Table
from sins_env.evaluation.reproduction.verdicts import Print, Printed, PrintedMean, Said
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.style import COLOURS, new_figure
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.units import ARCSEC, DEG

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RECORDS = 50  #: number of records in the thesis
RUNS, QUICK = 200, 40
COARSE_S = 180.0  #: length of the coarse phase; the default method takes the first of its two vectors at 50/180 of it
_LAST = 0.1  #: length of the fine phase, whose epoch is read; these estimators go on through it
ARCMIN = 60 * ARCSEC

TASK = EvaluationTask(
    "figure-2.3-sway-v0",
    f"swaying base, unknown attitude, white IMU errors, {COARSE_S:g} s of coarse alignment",
    "000 figures 2.3-2.5",
    "SINS/AlignSway-v0",
    1.5,
    600.0,
    {"imu": "thesis-white", "gps": "thesis", "start": "unknown", "coarse": COARSE_S - _LAST, "duration": COARSE_S},
)


class Sample(NamedTuple):
    """The printed mean and standard deviation of an error component over the records."""

    unit: float
    unit_name: str
    mean: float
    std: float


PRINTED = (
    Sample(ARCMIN, "arcmin", 1.515, 0.305),
    Sample(ARCMIN, "arcmin", -1.347, 1.927),
    Sample(DEG, "deg", -0.1545257, 0.5575518),
)
TWO_VECTORS: dict[str, Any] = {"method": "two_vector"}
#: Methods that came later.
LATER: tuple[tuple[str, str, dict[str, Any]], ...] = (
    ("SVD", "coarse_inertial", {"method": "svd"}),
    ("OBA, aided", "coarse_oba", {}),
)


def _line(label: str, read: Any, printed: Print | None = None) -> Line:
    return Line(f"{label}, two vectors", TASK, "coarse_inertial", read, TWO_VECTORS, printed)


def _lines(i: int, *more: Line) -> tuple[Line, ...]:
    """Return the lines of a component: mean and standard deviation from two vectors, and the latter of later methods."""
    unit, _, mean, std = PRINTED[i]
    spread = error(i, unit, FAILED * float(TASK.delta[i]), COARSE_S, about_mean=True)
    return (
        _line(f"{AXES[i]}: mean", mean_error(i, unit, COARSE_S), PrintedMean(mean, std, RECORDS)),
        _line(f"{AXES[i]}: std", spread, Printed(std, RECORDS, True, AXES[i])),
        *more,
        *(Line(f"{AXES[i]}: std, {label}", TASK, solver, spread, settings) for label, solver, settings in LATER),
    )


def _draw(results: Sequence[Results]) -> Figure:
    """Draw one point per run, as many as the thesis has, with mean and standard deviation of all our runs and of its own."""
    figure = new_figure(12.0, 3.6)
    for i, (axes, sample) in enumerate(zip(figure.subplots(1, len(AXES)), PRINTED, strict=True)):
        errors = errors_at(results[0], COARSE_S)[:, i] / sample.unit
        ours, spread = np.nanmean(errors), np.nanstd(errors, ddof=1)
        axes.plot(np.arange(1, RECORDS + 1)[: len(errors)], errors[:RECORDS], "o", color=COLOURS[0], markersize=3.5)
        axes.axhspan(ours - spread, ours + spread, color=COLOURS[0], alpha=0.13, linewidth=0, label="ours, mean ± std")
        axes.axhline(ours, color=COLOURS[0], linewidth=1.2)
        for y in (sample.mean - sample.std, sample.mean, sample.mean + sample.std):
            dashes = (0, (5, 2)) if y == sample.mean else (0, (1.5, 1.5))
            label = "printed mean" if y == sample.mean else "printed mean ± std" if y < sample.mean else None
            axes.axhline(y, color=COLOURS[1], linewidth=1.4, linestyle=dashes, label=label)
        axes.set_title(f"{AXES[i]}, two vectors", loc="left", fontsize=10)
        axes.set_ylabel(f"error after {COARSE_S:g} s, {sample.unit_name}")
        axes.set_xlabel("run")
        plain(axes)
    legend(figure, [axes])
    return figure


AZIMUTH_WHY = (
    "The text has the integral of the disturbance vanish. What enters is the sway's velocity at the end of the integral less "
    "that at its start, which does not average out: two vectors turned against each other by the earth's rotation alone make "
    "it an azimuth error. How large it is depends on the phases of the sway, which the thesis draws and does not state. "
    "All vectors, or the velocity of the fixes, are the cure."
)
LEVEL_WHY = (
    "The thesis' accelerometer biases are the same in all of its records, so that they are in its mean; ours draws them in each "
    "run, which puts them into the spread. But neither they nor the sway's velocity, which turns the longer vector by less than "
    "they do, account for the printed means and for the printed spread in north."
)
NEVER = Said("never beyond 1.5", high=1.5)

TABLES = (
    Table(
        "2.3",
        "coarse alignment in the inertial frame on a swaying base",
        "000",
        "Misalignment left by 180 s of coarse alignment from an unknown attitude, thesis sway, white IMU errors: mean over runs "
        "and standard deviation (std). As in the thesis from two vectors, at 50 s and at 180 s; then from all vectors (SVD), "
        "and with the velocity of the fixes over windows of 60 s (OBA).",
        (
            Group("levels", "arcmin", (*_lines(0), *_lines(1)), RUNS, QUICK, LEVEL_WHY),
            Group(
                "azimuth",
                "deg",
                _lines(2, _line(f"azimuth: largest of {RECORDS}", largest(2, DEG, COARSE_S, RECORDS), NEVER)),
                RUNS,
                QUICK,
                AZIMUTH_WHY,
            ),
        ),
        name="figures 2.3 to 2.5",
        pictures=(
            Picture(
                "figure-2-3",
                f"Misalignment after 180 s of coarse alignment from two vectors: {RECORDS} runs (points), mean and standard "
                "deviation of all of ours (line, shaded), of the printed records (dashed, dotted).",
                _draw,
                (Source(TASK, "coarse_inertial", TWO_VECTORS),),
                runs=RUNS,
                quick=QUICK,
            ),
        ),
    ),
)
