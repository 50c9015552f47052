"""Scores across runs, with intervals: pure functions of :class:`Records`. docs/tasks_and_scores.md#alignment-criterion.

No run is dropped. A run that diverged enters with its errors. A run that raised an exception enters with the worst
possible error from there on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.play.criteria import NEES_AT, PHI
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.score import navigation
from sins_env.evaluation.score.consistency import Nees, consistency
from sins_env.evaluation.score.navigation import Navigation
from sins_env.evaluation.score.resampling import (
    CONFIDENCE,
    NO_INTERVAL,
    SEED,
    Estimate,
    Interval,
    median_interval,
    rms_intervals,
)
from sins_env.states import answered
from sins_env.units import ARCSEC

TOGETHER = 64  #: number of solvers that are resampled together, limited by memory


def restricted_mean(times: Array, horizon: float) -> float:
    """Return the mean of min(t, horizon), s: the mean time to alignment as far as the episode can show it."""
    return float(np.minimum(times, horizon).mean())


def success_profile(records: Records, points: int = 80) -> tuple[Array, Array, Array, Array]:
    """Return success against the threshold delta: azimuth deltas, success, level deltas, success, (points,) each.

    Deltas are in rad. A run succeeds at delta if its largest error in the last ``hold_s`` is within delta. The curves show
    whether an order of solvers depends on the choice of delta.
    """
    out = []
    for largest, delta in (
        (records.hold_max[:, 2], records.criteria.delta[2]),
        (records.hold_max[:, :2].max(axis=1), records.criteria.delta[0]),
    ):
        deltas = delta * np.geomspace(0.03, 10.0, points)
        out += [deltas, (largest[:, None] <= deltas).mean(axis=0)]
    return out[0], out[1], out[2], out[3]


def bound_ratios(records: Records, bound: Bound) -> dict[str, float]:
    """Return the RMS over runs and steady state, divided by that of the bound in the same epochs, by axis."""
    rms = np.sqrt(np.square(records.steady_rms).mean(axis=0))
    with np.errstate(divide="ignore", invalid="ignore"):  # a bound of zero, which a file may hold
        return _by_axis(rms / bound.steady[PHI])


def known_headings(records: Records) -> Array:
    """Return the final headings, rad, without those of runs that raised an exception or were lost."""
    return records.heading[np.isfinite(records.heading) & ~records.unfinished]


def heading_deviations(known: Array) -> Array:
    """Return deviations from the mean, rad, scaled so that their mean square is the unbiased variance.

    The result is empty for fewer than two headings.
    """
    if len(known) < 2:
        return np.empty(0)
    centre = np.angle(np.exp(1j * known).mean())
    away = np.angle(np.exp(1j * (known - centre)))
    out: Array = (away - away.mean()) * math.sqrt(len(known) / (len(known) - 1))
    return out


def heading_spread(known: Array) -> float:
    """Return the repeatability, the standard deviation of the final heading over runs, rad; NaN for fewer than two."""
    away = heading_deviations(known)
    return math.sqrt(np.square(away).mean()) if len(away) else math.nan


@dataclass(frozen=True, repr=False)
class Summary:
    """Scores of a solver on a task. Errors are in arcsec by axis; times are in s from the start of fine alignment."""

    runs: int
    success: float  #: share of the runs whose three errors have all converged
    success_by_axis: dict[str, float]
    t_conv_median_s: float  #: median time to convergence; inf if most runs are censored
    t_conv_ci_s: Interval
    t_conv_restricted_mean_s: float
    coarse_s: float  #: length of the coarse alignment, to be added for times from switch-on
    steady_s: float  #: length of the steady state
    mean: dict[str, float]  #: mean over runs of the mean error in the steady state
    std: dict[str, float]  #: mean over runs of the standard deviation of the error in the steady state
    rms: dict[str, float]  #: RMS over runs and the steady state
    rms_ci: dict[str, Interval]
    rms_final: dict[str, float]  #: RMS over runs at T
    nees: tuple[Nees, ...]
    spread_deg: float  #: standard deviation of the final heading over runs; useful only if all have the same truth
    spread_runs: int  #: number of runs with a final heading, which those that raised or were lost do not have
    counts: dict[str, int]  #: number of runs by failure: diverged, frozen, raised, lost, repaired
    fallbacks: float  #: number of times per run that a safeguard replaced the solver's own rule; not a failure
    scored: bool = True  #: whether there is a reference; without one, times, success and errors are NaN
    navigation: Navigation | None = None  #: scores of navigation, for a task that navigates

    def __repr__(self) -> str:
        return f"<Summary of {self.runs} runs: {self.success:.0%} aligned, azimuth RMS {self.rms['U']:.4g} arcsec>"

    @property
    def failures(self) -> int:
        """Runs that diverged, froze, raised, were lost, or needed a repair: each counted once."""
        return self.counts["any"]

    @property
    def nees_of_all(self) -> tuple[Nees, ...]:
        """NEES of all scored errors: attitude, and in navigation velocity and position with it."""
        return self.nees if self.navigation is None else self.navigation.nees

    @property
    def nees_dof(self) -> int:
        """Mean of :attr:`nees_of_all` if the covariance is right."""
        return answered(self.navigation is not None).size

    @property
    def t_conv_from_switch_on_s(self) -> float:
        """Median time to convergence from switch-on, s."""
        return self.t_conv_median_s + self.coarse_s


def failure_counts(records: Records) -> dict[str, int]:
    """Return the number of runs by failure; ``repaired`` may overlap with the others, ``any`` counts each run once."""
    counts = {name: int((records.status == name).sum()) for name in ("diverged", "frozen", "raised", "lost")}
    counts["repaired"] = int((records.repairs > 0).sum())
    counts["any"] = int(((records.status != "ok") | (records.repairs > 0)).sum())
    return counts


def summaries(parts: Sequence[Records]) -> list[Summary]:
    """Summarise every set of runs; sets of equal size share one bootstrap, which is several times faster."""
    found: list[list[Estimate]] = [[] for _ in parts]
    for runs in {len(one) for one in parts}:
        same = [i for i, one in enumerate(parts) if len(one) == runs]
        for first in range(0, len(same), TOGETHER):
            some = same[first : first + TOGETHER]
            intervals = rms_intervals(np.hstack([parts[i].steady_rms for i in some]))
            for j, i in enumerate(some):
                found[i] = intervals[3 * j : 3 * j + 3]
    return [_summary(one, rms) for one, rms in zip(parts, found, strict=True)]


def _summary(records: Records, steady: Sequence[Estimate]) -> Summary:
    c = records.criteria
    aligned = records.aligned_s
    median, interval = median_interval(aligned) if c.scored else (math.nan, NO_INTERVAL)
    headings = known_headings(records)
    return Summary(
        runs=len(records),
        success=float(_converged(aligned).mean()),
        success_by_axis=_by_axis(_converged(records.t_conv).mean(axis=0)),
        t_conv_median_s=median,
        t_conv_ci_s=interval,
        t_conv_restricted_mean_s=restricted_mean(aligned, c.horizon_s),
        coarse_s=c.coarse_s,
        steady_s=(c.num_epochs - c.steady_from + 1) * c.epoch_s,
        mean=_by_axis(records.steady_mean.mean(axis=0) / ARCSEC),
        std=_by_axis(records.steady_std.mean(axis=0) / ARCSEC),
        rms=_by_axis([value / ARCSEC for value, _ in steady]),
        rms_ci={axis: _arcsec(ci) for axis, (_, ci) in zip("ENU", steady, strict=True)},
        rms_final=_by_axis(np.sqrt(np.square(records.final).mean(axis=0)) / ARCSEC),
        nees=consistency(c, records.nees),
        spread_deg=math.degrees(heading_spread(headings)),
        spread_runs=len(headings),
        counts=failure_counts(records),
        fallbacks=float(records.fallbacks.mean()),
        scored=c.scored,
        navigation=navigation.navigation_scores(records) if c.navigates else None,
    )


def _converged(times: Array) -> Array:
    """Return 1 for converged, 0 for not, and NaN for not scored."""
    return np.where(np.isnan(times), np.nan, np.isfinite(times))


def _by_axis(values: Array | list[float]) -> dict[str, float]:
    return {axis: float(value) for axis, value in zip("ENU", values, strict=True)}


def _arcsec(interval: Interval) -> Interval:
    return interval[0] / ARCSEC, interval[1] / ARCSEC


def rms_band(history: NDArray[np.float32], resamples: int = 400) -> tuple[Array, Array, Array]:
    """Return the RMS over runs at each time with the ends of its 95 % percentile-bootstrap band: (R, S) -> three (S,).

    A run whose history has ended is left out of the curve from there on.
    """
    known = np.isfinite(history)
    squares = np.where(known, np.square(history, dtype=float), 0.0)
    weights = np.random.default_rng(SEED).multinomial(len(history), [1 / len(history)] * len(history), resamples)
    with np.errstate(invalid="ignore", divide="ignore"):
        drawn = np.sqrt((weights @ squares) / (weights @ known.astype(float)))
        value = np.sqrt(squares.sum(axis=0) / known.sum(axis=0))
    filled = np.where(np.isnan(drawn), np.inf, drawn)
    tail = 50 * (1 - CONFIDENCE)
    low, high = np.percentile(filled, [tail, 100 - tail], axis=0, method="inverted_cdf")
    return value, low, np.where(np.isinf(high), value, high)


assert len(NEES_AT) == 4  # the store has one column for each
