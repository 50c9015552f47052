"""Places of jittered stamps on a uniform clock: which samples are missing, and which line the stamps scatter about.

A stamp is its place on the clock, a delay of the host, and nothing else. Place k of sample i is i plus the samples missing
before it. So ``t * rate - i`` is a staircase with noise: its level rises for good where samples are missing, and returns
after a delay. Medians before and after each sample tell both apart; a robust line through stamps and places is the clock.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array

Index = NDArray[np.int64]

CRYSTAL = 1e-4  #: largest relative error of an oscillator that is meant to run at a whole number of Hz
NOMINAL = 1e-3  #: largest relative difference of the rate from the one told, which is then the nominal one
TOGETHER, BATCHED = (
    0.25,
    0.3,
)  #: step, in samples, within one batch; share of such steps from which on stamps come in batches
HARD = 6.0  #: step between batches, in usual ones, that is a gap and no delay
DRIFT = 0.5  #: drift over all samples, in samples, at which a told or whole rate is as good as the fitted one
STEP = 0.7  #: change of the level, in samples, that is a missing sample; noise makes less
EXTRA = 0.9  #: fall of the level, in samples, that is a sample too many
LEAST_SPAN, MOST_SPAN = 50, 1000  #: fewest and most samples whose median is a level, on each side
USUAL = 200  #: number of stamps over which the usual rate is taken
ROUNDS = 30  #: most corrections of the places
MOST_JITTER_S, MOST_JITTER = 0.05, 1.0  #: largest RMS about the line, s or samples, of stamps that belong to one clock
HUBER = 1.345  #: residual, in robust standard deviations, from which on a stamp counts less


class Places(NamedTuple):
    """Samples on a uniform clock."""

    place: Index  #: (n,) place of each sample, from 0
    rate_hz: float
    begin: float  #: start of the first sample, s
    jitter_s: float  #: RMS of the stamps about the clock, s
    worst_s: float  #: largest distance of a stamp from the clock, s
    batch: int  #: number of samples that share a stamp, usually; 1 without batches

    @property
    def ends(self) -> Array:
        """End of each sample on the clock, (n,) s."""
        return self.begin + (self.place + 1) / self.rate_hz


def fitted(t: Array, rate_hz: float | None, start: Index | None = None, counted: bool = False) -> Places | None:
    """Fit a uniform clock to stamps ``t`` (n,), s; None if they belong to none.

    Args:
        t: stamps.
        rate_hz: rate, nominal perhaps; None fits it, and takes a whole number of Hz that is as good.
        start: places to begin with, (n,); None counts the samples.
        counted: whether ``start`` is sure, because the device has counted.
    """
    if len(t) < 3:
        return None
    index = np.arange(len(t)) if start is None else start - start[0]
    rate = _usual_rate(t, index)
    if rate is None:
        return None
    batch, ends = _batches(t, rate)
    rate = _usual_rate(t[ends], index[ends]) or rate
    if not counted:
        last = index[ends] if start is not None else _with_hard_gaps(t[ends], rate, index[ends], batch)
        found = _levelled(t[ends], rate, last, np.diff(ends))
        if found is None:
            return None
        missing = np.zeros(len(t), dtype=np.int64)  # before a batch, because nothing tells where within
        missing[np.append(0, ends[:-1] + 1)] = np.diff(found - index[ends], prepend=0)
        index = index + np.cumsum(missing)
    rate, first = _line(t[ends], index[ends])
    if not (np.isfinite(rate) and rate > 0):
        return None
    off = t[ends] - first - index[ends] / rate
    spread = float(np.std(off))
    if spread > max(MOST_JITTER_S, MOST_JITTER / rate):
        return None
    sure = (
        3.0 * spread * rate * np.sqrt(12.0 / len(off))
    )  # samples by which the line may drift, from its standard error
    told = _told(rate, rate_hz, int(index[-1]), sure)
    if told is None:
        return None
    if told != rate:
        first, rate = float(np.median(t[ends] - index[ends] / told)), told
    off = t - first - index / rate
    jitter, worst = float(np.sqrt(np.mean(off * off))), float(np.abs(off).max())
    return Places(index, rate, first - 1.0 / rate, jitter, worst, batch)


def _told(rate: float, told: float | None, places: int, sure: float) -> float | None:
    """Return the rate to use: the told or a whole one if the stamps cannot tell them apart, else that of the stamps.

    None if the told one is another.
    """
    if told is not None:
        if abs(told / rate - 1.0) * places <= max(DRIFT, sure):
            return told
        return rate if abs(told / rate - 1.0) < NOMINAL else None
    whole = float(round(rate))
    drift = abs(whole / rate - 1.0)
    near = drift < CRYSTAL or drift * places < sure
    return whole if whole and near and drift * places <= max(DRIFT, sure) else rate


def _usual_rate(t: Array, index: Index) -> float | None:
    """Return the median rate over spans that are long enough for jitter, and too short for missing samples to matter, Hz."""
    for span in (min(len(t) - 1, USUAL), len(t) - 1):
        step = float(np.median((t[span:] - t[:-span]) / (index[span:] - index[:-span]))) if span else 0.0
        if np.isfinite(step) and step > 0:
            return 1.0 / step
    return None


def _batches(t: Array, rate: float) -> tuple[int, Index]:
    """Return the usual number of samples in a batch, and the last sample of each batch.

    The last one waits the least for its stamp. Without batches each sample is one.
    """
    apart = np.abs(np.diff(t)) * rate >= TOGETHER
    if 1.0 - apart.mean() < BATCHED:
        return 1, np.arange(len(t))
    ends = np.append(np.flatnonzero(apart), len(t) - 1)
    return max(round(len(t) / len(ends)), 1), ends


def _with_hard_gaps(t: Array, rate: float, index: Index, batch: int) -> Index:
    """Return the places of batches with those gaps that no delay explains."""
    extra = np.diff(t) * rate - np.diff(index)
    wide = extra > HARD * batch
    return np.concatenate([index[:1], index[1:] + np.cumsum(np.where(wide, np.rint(extra), 0).astype(np.int64))])


def _levelled(t: Array, rate: float, index: Index, least: Index) -> Index | None:
    """Return the places (n,) at which the level of the stamps is the same all the way; None if there are none.

    ``least`` (n - 1,) has the number of samples, and so of places, from each stamp to the next.
    """
    from scipy.ndimage import median_filter  # slow to import

    r = (t - t[0]) * rate - index
    noise = 1.4826 * float(np.median(np.abs(np.diff(r) - np.median(np.diff(r))))) / np.sqrt(2.0)
    wanted = max(LEAST_SPAN, (1.25 * np.sqrt(2.0) * noise / 0.1) ** 2)
    half = max(min(int(wanted), MOST_SPAN, len(t) // 4), 1)
    at = np.arange(1, len(t))
    for _ in range(ROUNDS):
        rate = _usual_rate(t, index) or rate
        r = (t - t[0]) * rate - index
        middle = median_filter(r, 2 * half + 1, mode="nearest")
        middle[:half], middle[len(r) - half :] = middle[half], middle[len(r) - half - 1]  # no level reaches over an end
        before, after = middle[np.maximum(at - 1 - half, 0)], middle[np.minimum(at + half, len(t) - 1)]
        rise = after - before
        change = (np.sign(rise) * np.floor(np.abs(rise) + 1.0 - STEP)).astype(np.int64)
        add = np.zeros(len(at), dtype=np.int64)
        edges = np.flatnonzero(np.diff(np.concatenate([[0], np.sign(change), [0]])))
        done = -1
        for a, b in pairwise(edges.tolist()):
            if not change[a] or a <= done:
                continue
            done = b + half  # what else is near is seen better in the next round
            peak = int(change[a:b][np.argmax(np.abs(change[a:b]))])
            size = peak if abs(peak) > 2 else int(np.sign(peak))  # two losses in one span are found one after the other
            first, last = max(a - half, 0), min(b + half, len(at))
            if size > 0:  # the step of this size that fits best in the least squares
                add[first + int(np.argmin(np.cumsum(r[first:last] - before[a] - 0.5 * size)))] += size
            else:  # places may be taken away only where some are empty
                empty = (np.diff(index) - least)[first:last]
                most = int(np.argmax(empty))
                if empty[most] < 1 and rise[a:b].min() < -EXTRA:
                    return None
                add[first + most] -= min(-size, max(int(empty[most]), 0))
        if not add.any():
            return index
        index = np.concatenate([index[:1], index[1:] + np.cumsum(add)])
    return None


def _line(t: Array, index: Index) -> tuple[float, float]:
    """Return the rate, Hz, and the time of place 0, s, of the line through stamps that few outliers do not bend."""
    x, y = index - index.mean(), t - t[0]
    weight = np.ones(len(t))
    slope = offset = 0.0
    for _ in range(8):
        total = weight.sum()
        mx, my = (weight @ x) / total, (weight @ y) / total
        slope = float((weight * (x - mx)) @ (y - my) / ((weight * (x - mx)) @ (x - mx)))
        offset = float(my - slope * mx)
        off = np.abs(y - offset - slope * x)
        scale = 1.4826 * float(np.median(off))
        if scale <= 0:
            break
        weight = np.minimum(1.0, HUBER * scale / np.maximum(off, 1e-300))
    return 1.0 / slope if slope else np.inf, float(t[0] + offset - slope * index.mean())
