"""The uniform clock of a recording: its rate, gaps, stamps that repeat or run back, and resampling on demand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.checks import refused
from sins_env.recordings.recording import Recording, first_few, frozen, seconds

GAP = 1.5  #: shortest step between stamps, in samples, that means missing samples
JITTER = 0.2  #: largest difference, in samples, between the sum of two steps and two samples for a jittering stamp
CRYSTAL = 1e-4  #: largest relative error of an oscillator that is meant to run at a whole number of Hz
FINEST = 1000  #: most new samples for each old one when a recording is resampled
WHOLE_HZ = 0.25  #: largest distance of stamps, in samples, from the clock of a whole number of Hz


@dataclass(frozen=True)
class Samples:
    """The samples of a file: stamps at their ends, with increments or rates in the order Right, Forward, Up."""

    path: str
    name: str  #: name of the stamps in errors
    place: Callable[[int], str]  #: function that tells the place of a sample in its file, such as "line 17"
    t: Array  #: (n,) stamps, s
    dtheta: Array  #: (n, 3) angle increments, rad, or rates, rad/s
    dvel: Array  #: (n, 3) velocity increments, m/s, or specific force, m/s^2
    gyro_rates: bool = False  #: whether ``dtheta`` holds rates
    accel_rates: bool = False  #: whether ``dvel`` holds specific force
    trapezoid: bool = False  #: whether rates are values at the stamps, and not means over the sample


class Clocked(NamedTuple):
    """Increments on a uniform clock, with NaN for missing samples."""

    t0: float  #: start of the first sample, s
    rate_hz: float
    dtheta: Array  #: (N, 3) angle increments, rad
    dvel: Array  #: (N, 3) velocity increments, m/s


def clocked(
    samples: Samples, rate_hz: float | None = None, resample_hz: float | None = None, drop_duplicates: bool = False
) -> Clocked:
    """Put samples on a uniform clock of ``rate_hz``, or resample them to ``resample_hz``.

    ``rate_hz`` None takes the rate that fits the stamps.

    Raises:
        ValueError: stamps that repeat (unless they are to be dropped), run back, or fit no uniform clock.
    """
    step = f" by one sample of {rate_hz:g} Hz" if rate_hz else ""
    samples = _increasing(samples, drop_duplicates, step)
    rate = rate_hz or fitted_rate(samples)
    if resample_hz is None:
        index = sample_index(samples, rate)
        samples = _integrated(samples, np.diff(index, prepend=index[0] - 1) / rate, 1 / rate)
        return Clocked(
            float(samples.t[0]) - 1 / rate, rate, on_grid(index, samples.dtheta), on_grid(index, samples.dvel)
        )
    samples = _integrated(samples, np.diff(samples.t, prepend=samples.t[0] - 1 / rate), 1 / rate)
    return resampled(samples.t, np.hstack([samples.dtheta, samples.dvel]), rate, resample_hz)


def check_increasing(
    path: str, name: str, place: Callable[[int], str], t: Array, drop: bool = False, step: str = ""
) -> None:
    """Check that stamps increase.

    Raises:
        ValueError: stamps that run back, or that repeat unless ``drop``; the error has their times.
    """
    back = np.flatnonzero(np.diff(t) < 0)
    if len(back):
        i = int(back[0])
        week = "; a new GPS week?" if t[i] - t[i + 1] > 604_000 else ""
        times = f"{seconds(t[i + 1])} s after {seconds(t[i])} s{week}"
        raise ValueError(f"{path}: {name} does not increase{step} at {place(i + 1)}: {times}")
    same = np.flatnonzero(np.diff(t) == 0) + 1
    if len(same) and not drop:
        first, many = place(int(same[0])), len(same) > 1
        listed = first_few([f"{seconds(t[i])} s" for i in same[:6]] + [""] * (len(same) - 6))
        raise ValueError(
            f"{path}: {name} does not increase{step} at {first}: {len(same)} repeated stamp{'s' * many}, {listed}; allowed: "
            "each stamp once, or drop_duplicates, which keeps the first sample of each"
        )


def _increasing(samples: Samples, drop: bool, step: str) -> Samples:
    check_increasing(samples.path, samples.name, samples.place, samples.t, drop, step)
    keep = np.concatenate([[0], np.flatnonzero(np.diff(samples.t) > 0) + 1])
    if len(keep) == len(samples.t):
        return samples
    return replace(
        samples,
        t=samples.t[keep],
        dtheta=samples.dtheta[keep],
        dvel=samples.dvel[keep],
        place=lambda i: samples.place(int(keep[i])),
    )


def fitted_rate(samples: Samples) -> float:
    """Return the rate in Hz that fits the stamps.

    It is a whole number if the stamps fit its clock as well as their own, else their number of steps over their span.

    Raises:
        ValueError: fewer than two samples.
    """
    t = samples.t
    if len(t) < 2:
        raise ValueError(f"{samples.path}: {len(t)} sample; allowed: at least 2, or the rate given")
    steps = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(t) / np.median(np.diff(t))))])
    rate = float(steps[-1] / (t[-1] - t[0]))
    whole = float(round(rate))
    scatter, of_whole = (np.ptp((t - t[0]) * hz - steps) for hz in (rate, whole))
    as_good = of_whole <= 1.5 * scatter + 0.01 or abs(whole / rate - 1) < CRYSTAL
    return whole if whole and as_good and of_whole <= 2 * WHOLE_HZ else rate


def sample_index(samples: Samples, rate: float) -> NDArray[np.int64]:
    """Return the place of each sample on a uniform clock, (n,); steps over two or more places are gaps.

    A single stamp that is off while its neighbours lie two samples apart is jitter, and is put between them.

    Raises:
        ValueError: two samples in one place, or more places empty than filled.
    """
    t = samples.t.copy()
    jitter = np.flatnonzero(np.abs(t[2:] - t[:-2] - 2 / rate) < JITTER / rate) + 1
    t[jitter] = 0.5 * (t[jitter - 1] + t[jitter + 1])
    span = (t[-1] - t[0]) * rate + 1.0
    if not span < 2 * len(t) + 0.5:
        raise ValueError(
            f"{samples.path}: {samples.name} spans {span:.0f} samples of {rate:g} Hz; only {len(t)} are there"
        )
    index = np.rint((t - t[0]) * rate).astype(np.int64)
    back = np.flatnonzero(np.diff(index) < 1)
    if len(back):
        i = int(back[0])
        raise ValueError(
            f"{samples.path}: {samples.name} does not increase by one sample of {rate:g} Hz at {samples.place(i + 1)}: "
            f"{seconds(samples.t[i + 1])} s after {seconds(samples.t[i])} s; allowed: a uniform clock, or resampling"
        )
    return index


def on_grid(index: NDArray[np.int64], values: Array) -> Array:
    """Put values (n, m) at their places on the clock, with NaN elsewhere: (N, m), read-only."""
    grid = np.full((int(index[-1]) + 1, values.shape[1]), np.nan)
    grid[index] = values
    return frozen(grid)


def _integrated(samples: Samples, steps: Array, sample_s: float) -> Samples:
    """Integrate rates over the time since the stamp before, but at most over one sample; the rest is a gap.

    A rate is held over the sample that it ends, because an IMU delivers the mean since its last output. Every sample
    then counts once, and its noise stays white. If rates are values at the stamps, held rates would lag by half a sample;
    ``trapezoid`` takes the mean of neighbours instead.
    """
    whole = steps < GAP * sample_s
    dt = np.where(whole, steps, sample_s)[:, None]

    def integral(rates: Array) -> Array:
        if not samples.trapezoid:
            return rates * dt
        mean = 0.5 * (rates + np.concatenate([rates[:1], rates[:-1]]))
        return np.where(whole[:, None], mean, rates) * dt

    return replace(
        samples,
        dtheta=integral(samples.dtheta) if samples.gyro_rates else samples.dtheta,
        dvel=integral(samples.dvel) if samples.accel_rates else samples.dvel,
    )


def hz_of(step_s: float) -> float:
    """Return the rate, Hz, of a sample interval in s; a whole number if only rounding keeps it from being one."""
    hz = 1.0 / step_s
    return float(round(hz)) if abs(hz - round(hz)) < 1e-9 * hz else hz


def check_hz(name: str, hz: float) -> float:
    """Return the rate in Hz.

    Raises:
        ValueError: a rate that is not finite or not positive.
    """
    if not (np.isfinite(hz) and hz > 0):
        raise refused(name, hz, "a positive number of Hz")
    return float(hz)


def resampled(t: Array, increments: Array, rate: float, hz: float) -> Clocked:
    """Resample increments (n, 6) that end at stamps ``t``, s, to the clock whose ticks are multiples of 1 / ``hz``.

    The running sum is interpolated by a cubic spline and differenced. Nothing is lost, for any sum over new samples is
    that over the old ones. Gaps stay gaps: a new sample must lie between old stamps.

    Raises:
        ValueError: a rate that is none, a sample longer than the recording, or too many new samples.
    """
    from scipy.interpolate import CubicSpline  # slow to import

    check_hz("resample_hz", hz)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(t) > GAP / rate) + 1, [len(t)]])
    begin = float(t[0]) - 1 / rate
    tick = np.ceil(begin * hz - 1e-6)
    count = int(np.floor(float(t[-1]) * hz + 1e-6) - tick)
    if count < 1:
        raise refused("resample_hz", hz, f"samples shorter than the recording, {seconds(float(t[-1]) - begin)} s")
    if count > FINEST * len(t):
        raise refused("resample_hz", hz, f"at most {FINEST} new samples for each of the {len(t)} that are there")
    grid = np.full((count, increments.shape[1]), np.nan)
    for a, b in pairwise(starts):
        edges = np.concatenate([[t[a] - 1 / rate], t[a:b]])
        total = np.concatenate([np.zeros((1, increments.shape[1])), np.cumsum(increments[a:b], axis=0)])
        first, last = int(np.ceil(edges[0] * hz - 1e-6) - tick), int(np.floor(edges[-1] * hz + 1e-6) - tick)
        if last <= first:
            continue
        ticks = (tick + np.arange(first, last + 1)) / hz
        origin = edges[0]
        if len(edges) > 3:
            sums = CubicSpline(edges - origin, total)(np.clip(ticks, edges[0], edges[-1]) - origin)
        else:
            sums = np.column_stack([np.interp(ticks, edges, column) for column in total.T])
        grid[first:last] = np.diff(sums, axis=0)
    return Clocked(float(tick / hz), float(hz), frozen(grid[:, :3].copy()), frozen(grid[:, 3:].copy()))


def resample(recording: Recording, hz: float) -> Recording:
    """Return the recording at another rate; fixes and reference stay the same.

    Raises:
        ValueError: a rate that is none, or one too low for the length of the recording.
    """
    here = np.flatnonzero(~recording.missing)
    t = recording.t0 + (here + 1) / recording.rate_hz
    new = resampled(t, np.hstack([recording.dtheta[here], recording.dvel[here]]), recording.rate_hz, hz)
    return replace(recording, t0=new.t0, rate_hz=new.rate_hz, dtheta=new.dtheta, dvel=new.dvel)
