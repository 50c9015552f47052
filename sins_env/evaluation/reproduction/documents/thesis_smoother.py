"""The smoother of 000 section 4.3.3, whose name (SPS) stands in tables 4.1 and 4.2: an H-infinity UKF, and back in time.

A smoother tells what an earlier epoch was, seen from later. At the end it has nothing that the filter lacks.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.reproduction.documents.thesis_filters import AZIMUTH, MATCHED, PRINTINGS, THESIS, cap, task_of
from sins_env.evaluation.reproduction.pictures.common import legend, plain
from sins_env.evaluation.reproduction.tables import Claim, Group, Picture, Table
from sins_env.evaluation.reproduction.verdicts import SMALLER, Estimate, Printed, capped_rms, ratio
from sins_env.evaluation.score import losses
from sins_env.evaluation.show.style import new_figure, style
from sins_env.evaluation.tasks.task import run_seed
from sins_env.units import ARCSEC

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SOLVER, END_S, LAST_S = "hinf_ukf", 300.0, 100.0
RUNS, QUICK = 40, 0
WHY = (
    "The last estimate of a smoother is the filter's: it has seen the same fixes. Earlier estimates are better than the filter's "
    "were at the time, and steadier, but an alignment ends at its end."
)
PRINTED = {p.noise: p.columns[1] for p in PRINTINGS if p.number in ("4.1", "4.2")}
"""The column of the filter with the smoother's name under each noise."""


class Smoothing(NamedTuple):
    """Azimuth errors once a second, arcsec, as the filter had them and as they are seen from the end."""

    t: Array  #: (S,) s
    filtered: Array  #: (R, S)
    smoothed: Array  #: (R, S)

    def last(self, errors: Array) -> Array:
        """Return the errors of the last LAST_S seconds."""
        return errors[:, self.t > END_S - LAST_S + 1e-6]


@lru_cache(maxsize=4)
def smoothing(noise: str, prior: str, runs: int) -> Smoothing:
    """Play the first runs of a task until END_S, and smooth them back from there."""
    task = task_of(noise, prior)
    env: Any = task.make(runs, duration=END_S)
    smooth: Any = finding.find("solvers.pipeline.smoother:smooth_navigation")
    found = smooth(finding.make(SOLVER), env, seed=[run_seed(task, run) for run in range(runs)])
    shown = slice(round(1.0 / env.unwrapped.task.epoch_s) - 1, None, round(1.0 / env.unwrapped.task.epoch_s))
    true = env.unwrapped.episode.world.trajectory.chunk(0, len(found.filtered.t)).state.q_nb.swapaxes(0, 1)
    env.close()
    tracks = (found.filtered, found.smoothed)
    errors = (attitude.misalignment(one.nav.q_nb[shown], true[shown])[..., AZIMUTH].T / ARCSEC for one in tracks)
    return Smoothing(found.filtered.t[shown], *errors)


def figures(noise: str, prior: str, runs: int) -> list[Estimate]:
    """Return the estimates of the lines of a group."""
    found, most = smoothing(noise, prior, runs), cap(noise, prior, AZIMUTH) / ARCSEC
    late = found.last(found.smoothed)
    both = found.smoothed, found.filtered
    spread, filter_spread = (found.last(errors).std(axis=1, ddof=1) for errors in both)
    end, filter_end = (losses.capped(errors[:, -1], most) for errors in both)
    return [
        ratio(end, filter_end),
        ratio(losses.capped(spread, most), losses.capped(filter_spread, most)),
        capped_rms(late.mean(axis=1), most),
        capped_rms(spread, most),
        capped_rms(filter_spread, most),
    ]


def _group(noise: str, prior: str) -> Group:
    column = PRINTED[noise]
    assert column.printed
    assert column.std
    claims = (
        Claim(f"azimuth at {END_S:g} s, smoothed / filter, quotient", SMALLER),
        Claim(f"standard deviation over the last {LAST_S:g} s, smoothed / filter, quotient", SMALLER),
        Claim(f"azimuth, mean of the last {LAST_S:g} s, smoothed", Printed(column.printed[AZIMUTH], 1)),
        # the variance of a random walk about its own mean scatters as if it had two to three degrees of freedom
        Claim(
            f"azimuth, standard deviation over the last {LAST_S:g} s, smoothed", Printed(column.std, 3, about_mean=True)
        ),
        Claim(
            f"azimuth, standard deviation over the last {LAST_S:g} s, filter", Printed(column.std, 3, about_mean=True)
        ),
    )
    compute = partial(figures, noise, prior)
    return Group(f"{noise}, {prior}", "arcsec unless said", (), RUNS, QUICK, WHY, claims, compute)


def _draw() -> Figure:
    figure = new_figure(11.0, 3.0 * len(PRINTED) + 0.6)
    panels = figure.subplots(len(PRINTED), 2, squeeze=False, sharex=True)
    for of_row, (noise, column) in zip(panels, PRINTED.items(), strict=True):
        for axes, prior in zip(of_row, (MATCHED, THESIS), strict=True):
            found = smoothing(noise, prior, RUNS)
            for i, (label, errors) in enumerate((("H-infinity UKF", found.filtered), ("smoothed", found.smoothed))):
                rms = np.sqrt(np.mean(np.square(errors), axis=0))
                axes.plot(found.t, rms, label=f"{label}, RMS of {len(errors)} runs", **style(i))
                axes.plot(
                    found.t,
                    np.abs(errors[0]),
                    label=f"{label}, size in one run",
                    color=style(i)["color"],
                    linewidth=0.6,
                )
            assert column.printed
            printed = abs(column.printed[AZIMUTH])
            axes.plot([END_S - LAST_S, END_S], [printed] * 2, label="printed", color="black", linewidth=1.2)
            axes.set(yscale="log", ylim=(5, 6e4), xlim=(0, END_S))
            axes.set_title(f"azimuth: {noise}, {prior}", loc="left", fontsize=10)
            plain(axes)
        of_row[0].set_ylabel("error, arcsec")
    for axes in panels[-1]:
        axes.set_xlabel("time, s")
    legend(figure, panels.ravel())
    return figure


TABLES = (
    Table(
        "4.smoother",
        "the smoother of the H-infinity UKF, 300 s",
        "000",
        f"An H-infinity UKF over {END_S:g} s, and back from there to the start: what each second was, seen from the end. Tables "
        "4.1 and 4.2 have the smoother in the name of their column, and the filter in the text below them.",
        tuple(_group(noise, prior) for noise in PRINTED for prior in (MATCHED, THESIS)),
        name="section 4.3.3",
        pictures=(
            Picture(
                "figure-4-5",
                "Azimuth error of the H-infinity UKF and of its smoother, after figures 4.5 and 4.8: RMS over runs, and one run. "
                f"Black: the printed azimuth, over the {LAST_S:g} s of which table 4.3 says that it is the mean.",
                lambda _: _draw(),
                quick=0,
            ),
        ),
    ),
)
