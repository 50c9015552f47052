"""Short gaps of a recording, filled with interpolated increments, and what such a bridge is off by.

Rates change uniformly over a gap, from the mean of the samples before it to that of the samples after it. These means are taken
over half its length, because the noise of a single sample would be repeated all along the gap.

What a bridge is off by is measured. Bridges of the same kind are built over stretches of the recording that have their samples.
The second moment of their errors holds the motion that nobody saw and the noise at both ends. An axis in which the other
stretches were quiet need not be quiet in the gap. With n stretches beside one another, one more is therefore counted whose
error has the mean size in all three axes.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.recordings.recording import Gap, Recording, frozen

BRIDGE_S = 0.1  #: longest gap that is filled by default, s
MOST_BRIDGE_S = 60.0  #: longest gap that may be filled, s
NEAR_S = 120.0  #: least time on either side of a gap in which bridges are tried, s
MOST_TRIALS = 1000  #: number of stretches on which a bridge is tried


class Bridge(NamedTuple):
    """A line of increments in place of missing ``samples``, through the means of those ``before`` and ``after`` them."""

    before: int
    samples: int
    after: int

    def at(self, place: Any, first: Array, last: Array) -> Array:
        """Return the increments (..., m) at places (...) from 0 to samples - 1, for the means before and after."""
        share = (place + 0.5 * (self.before + 1)) / (self.samples + 0.5 * (self.before + self.after))
        return (1.0 - share) * first + share * last

    def fill(self, increments: Array, first: int) -> None:
        """Fill in the increments (N, m) of a gap that begins at the sample ``first``, in place."""
        last = first + self.samples
        ends = increments[first - self.before : first].mean(axis=0), increments[last : last + self.after].mean(axis=0)
        increments[first:last] = self.at(np.arange(self.samples)[:, None], *ends)

    def cov(self, increments: Array, there: Mask) -> Array | None:
        """Return the covariance (6, 6) of what such a bridge is off by in sum; None without a stretch whose samples are all there.

        ``increments`` (N, 6) are those of ``there`` (N,). At most MOST_TRIALS stretches are taken.
        """
        length = self.before + self.samples + self.after
        sums, missing = _sums(np.where(there[:, None], increments, 0.0)), _sums(~there[:, None])[:, 0]
        start = np.arange(len(there) - length + 1)
        start = start[missing[start + length] == missing[start]]
        if not len(start):
            return None
        number = 1.0 + (len(start) - 1) / length  # of stretches beside one another
        a, b, c, d = (sums[start[:: -(-len(start) // MOST_TRIALS)] + edge] for edge in np.cumsum([0, *self]))
        errors = self.samples * self.at(0.5 * (self.samples - 1), (b - a) / self.before, (d - c) / self.after) - (c - b)
        total = number * errors.T @ errors / len(errors)
        for part in (slice(3), slice(3, 6)):
            total[part, part] += np.trace(total[part, part]) / (3.0 * number) * np.eye(3)
        return np.asarray(total / (number + 1.0))


def _sums(values: Array | Mask) -> Array:
    """Return the sums (N + 1, ...) of the values (N, ...) before each of them, and of all."""
    return np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])


def bridged(recording: Recording, most_s: float = BRIDGE_S) -> Recording:
    """Return the recording with its gaps of up to ``most_s`` s filled, and told in ``bridged`` and ``bridge_cov``.

    A gap stays one if the recording has nowhere the samples of such a bridge, which would tell its error.
    """
    missing = recording.missing
    if not missing.any() or not most_s > 0:
        return recording
    filled: list[Gap] = []
    covs: list[Array] = []
    parts = recording.dtheta.copy(), recording.dvel.copy()
    there = ~missing
    for gap in recording.bridged:
        there[_samples(recording, gap)] = False
    block = math.ceil(NEAR_S * recording.rate_hz)

    @cache
    def cov_in(bridge: Bridge, number: int) -> Array | None:
        """Return the covariance by the stretches of a block of samples and its neighbours, or if there is none by all."""
        near = slice(max(number - 1, 0) * block, (number + 2) * block)
        found = (bridge.cov(np.hstack([x[span] for x in parts]), there[span]) for span in (near, slice(None)))
        return next((cov for cov in found if cov is not None), None)

    most = most_s * recording.rate_hz * (1 + 1e-9)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8)))
    limits = np.concatenate([[0], edges, [len(missing)]])
    for gap, i in zip(recording.gaps, range(1, len(limits) - 1, 2), strict=True):
        before, first, last, after = limits[i - 1 : i + 3].tolist()
        size = max(gap.samples // 2, 1)
        bridge = Bridge(min(size, first - before), gap.samples, min(size, after - last))
        if gap.samples <= most and bridge.before and bridge.after:
            cov = cov_in(bridge, first // block)
            if cov is not None:
                for increments in parts:
                    bridge.fill(increments, first)
                filled.append(gap)
                covs.append(cov)
    if not filled:
        return recording
    dtheta, dvel = map(frozen, parts)
    told = frozen(np.concatenate([recording.bridge_cov, covs]))
    return replace(recording, dtheta=dtheta, dvel=dvel, bridged=(*recording.bridged, *filled), bridge_cov=told)


def _samples(recording: Recording, gap: Gap) -> slice:
    first = round((gap.start - recording.t0) * recording.rate_hz)
    return slice(first, first + gap.samples)


def unbridged(recording: Recording) -> Recording:
    """Return the recording with the gaps that were filled as gaps again, as its file has them."""
    if not recording.bridged:
        return recording
    dtheta, dvel = recording.dtheta.copy(), recording.dvel.copy()
    for gap in recording.bridged:
        dtheta[_samples(recording, gap)] = dvel[_samples(recording, gap)] = np.nan
    none = np.zeros((0, 6, 6))
    return replace(recording, dtheta=frozen(dtheta), dvel=frozen(dvel), bridged=(), bridge_cov=none)
