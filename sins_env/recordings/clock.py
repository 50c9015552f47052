"""The uniform clock of a recording: its rate, gaps, stamps that jitter, repeat or run back, and resampling on demand."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.checks import refused
from sins_env.recordings.recording import Recording, Stamping, frozen, seconds
from sins_env.recordings.stamps.places import CRYSTAL, Places, fitted
from sins_env.recordings.stamps.wraps import check_increasing, counted, unrolled

GAP = 1.5  #: shortest step between stamps, in samples, that means missing samples
JITTER = 0.2  #: largest difference, in samples, between the sum of two steps and two samples for a jittering stamp
EVEN = 0.05  #: largest RMS of stamps about their places, in samples, that is rounding and no jitter
LEAST_FITTED, MOST_BACK = 20, 0.5  #: fewest samples for a fitted clock; longest step back, in samples, that is jitter
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
    counter: Array | None = None  #: (n,) counter of the device, which may wrap; it tells which samples are missing
    scale: str | None = None  #: "GPS" if the stamps are absolute, seconds of GPS time since 1980-01-06


class Clocked(NamedTuple):
    """Increments on a uniform clock, with NaN for missing samples."""

    t0: float  #: start of the first sample, s
    rate_hz: float
    dtheta: Array  #: (N, 3) angle increments, rad
    dvel: Array  #: (N, 3) velocity increments, m/s
    stamping: Stamping | None = None  #: how the stamps lay about the clock
    scale: str | None = None  #: "GPS" if times are absolute


def clocked(
    samples: Samples, rate_hz: float | None = None, resample_hz: float | None = None, drop_duplicates: bool = False
) -> Clocked:
    """Put samples on a uniform clock of ``rate_hz``, or resample them to ``resample_hz``.

    ``rate_hz`` None takes the rate that fits the stamps. Stamps that jitter about a uniform clock, as hosts write them,
    are evened out. A counter tells which samples are missing; without one the stamps do.

    Raises:
        ValueError: stamps that repeat (unless they are to be dropped), run back, or fit no uniform clock.
    """
    samples = replace(samples, t=unrolled(samples.t))
    whole = len(samples.t)
    found = _on_clock(samples, rate_hz)
    if found is None and drop_duplicates:
        samples = _each_once(samples)
        found = _on_clock(samples, rate_hz)
    dropped = whole - len(samples.t)
    step = f" by one sample of {rate_hz:g} Hz" if rate_hz else ""
    if found is None:
        check_increasing(samples.path, samples.name, samples.place, samples.t, False, step)
        rate = rate_hz or fitted_rate(samples)
        if resample_hz is None:
            sample_index(samples, rate)
            raise AssertionError("unreachable")
        return _resampled(samples, samples.t, rate, resample_hz, Stamping(0.0, 0.0, 1, False, dropped))
    places, evened = found
    stamping = Stamping(places.jitter_s, places.worst_s, places.batch, evened, dropped)
    if resample_hz is not None:
        return _resampled(samples, places.ends if evened else samples.t, places.rate_hz, resample_hz, stamping)
    index, rate = places.place, places.rate_hz
    steps = np.diff(index, prepend=index[0] - 1) / rate
    dtheta = on_grid(index, _integrated(samples.dtheta, samples.gyro_rates, samples.trapezoid, steps, 1 / rate))
    samples = replace(samples, dtheta=dtheta[:0])  # what was read makes room
    dvel = on_grid(index, _integrated(samples.dvel, samples.accel_rates, samples.trapezoid, steps, 1 / rate))
    return Clocked(places.begin, rate, dtheta, dvel, stamping, samples.scale)


def _resampled(samples: Samples, t: Array, rate: float, hz: float, stamping: Stamping) -> Clocked:
    steps = np.diff(t, prepend=t[0] - 1 / rate)
    both = ((samples.dtheta, samples.gyro_rates), (samples.dvel, samples.accel_rates))
    increments = [_integrated(values, rates, samples.trapezoid, steps, 1 / rate) for values, rates in both]
    new = resampled(t, np.hstack(increments), rate, hz)
    return new._replace(stamping=stamping, scale=samples.scale)


def _on_clock(samples: Samples, rate_hz: float | None) -> tuple[Places, bool] | None:
    """Return the places of samples, and whether jitter was evened out; None if they belong to no uniform clock."""
    t = samples.t
    if samples.counter is not None:
        index = counted(samples.counter)
        found = fitted(t, rate_hz, index, counted=True)
        if found is None:
            raise ValueError(
                f"{samples.path}: {samples.name} does not follow the counter; allowed: the counter of the samples, the "
                "rate that fits both, or a mapping without the counter"
            )
        return found, found.jitter_s * found.rate_hz > EVEN
    regular = _regular(samples, rate_hz) if (np.diff(t) > 0).all() else None
    if regular is not None and regular.jitter_s * regular.rate_hz <= EVEN:
        return regular, False
    if len(t) >= LEAST_FITTED and not _mostly_copies(samples):
        starts = [None] if regular is None else [regular.place, None]
        for start in starts:
            found = fitted(t, rate_hz, start)
            if found is not None and np.diff(t).min() * found.rate_hz > -MOST_BACK and found.place[-1] < 2 * len(t):
                return found, True
    return None if regular is None else (regular, False)


def _regular(samples: Samples, rate_hz: float | None) -> Places | None:
    """Return the places of stamps that lie near a uniform clock which begins at the first one; None if they do not."""
    rate = rate_hz or fitted_rate(samples)
    try:
        index = sample_index(samples, rate)
    except ValueError:
        return None
    off = samples.t - samples.t[0] - index / rate
    off = off - np.median(off)
    jitter, worst = float(np.sqrt(np.mean(off * off))), float(np.abs(off).max())
    return Places(index, rate, float(samples.t[0]) - 1 / rate, jitter, worst, 1)


def _same_stamp(samples: Samples) -> NDArray[np.int64]:
    return np.flatnonzero(np.diff(samples.t) == 0) + 1


def _mostly_copies(samples: Samples) -> bool:
    """Return whether most samples with the stamp of the one before have its values, too: rows that were written twice."""
    same = _same_stamp(samples)
    copies = [(values[same] == values[same - 1]).all(axis=1) for values in (samples.dtheta, samples.dvel)]
    return bool(len(same)) and float((copies[0] & copies[1]).mean()) > 0.5


def _each_once(samples: Samples) -> Samples:
    """Return the samples without those that have the stamp of the one before."""
    keep = np.delete(np.arange(len(samples.t)), _same_stamp(samples))
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
    usual = np.median(np.diff(t))
    if not usual > 0:
        return float((len(t) - 1) / max(t[-1] - t[0], 1e-300))
    steps = np.concatenate([[0.0], np.cumsum(np.rint(np.diff(t) / usual))])
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
    count = int(index[-1]) + 1
    if count == len(values) and values.base is None and values.flags.c_contiguous and values.dtype == np.float64:
        return frozen(values)  # there is no gap, and no one else has them
    grid = np.full((count, values.shape[1]), np.nan)
    grid[index] = values
    return frozen(grid)


def _integrated(values: Array, rates: bool, trapezoid: bool, steps: Array, sample_s: float) -> Array:
    """Integrate ``values`` that are rates over the time since the stamp before, but at most over one sample; the rest is a gap.

    A rate is held over the sample that it ends, because an IMU delivers the mean since its last output. Every sample
    then counts once, and its noise stays white. If rates are values at the stamps, held rates would lag by half a sample;
    ``trapezoid`` takes the mean of neighbours instead.
    """
    if not rates:
        return values
    whole = steps < GAP * sample_s
    dt = np.where(whole, steps, sample_s)[:, None]
    if not trapezoid:
        return values * dt
    mean = 0.5 * (values + np.concatenate([values[:1], values[:-1]]))
    return np.where(whole[:, None], mean, values) * dt


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
    return replace(
        recording,
        t0=new.t0,
        rate_hz=new.rate_hz,
        dtheta=new.dtheta,
        dvel=new.dvel,
        bridged=(),
        bridge_cov=np.zeros((0, 6, 6)),
    )
