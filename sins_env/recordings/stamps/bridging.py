"""Short gaps of a recording, filled with interpolated increments."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sins_env.arrays import Array
from sins_env.recordings.recording import Gap, Recording, frozen

BRIDGE_S = 0.1  #: longest gap that is filled by default, s
MOST_BRIDGE_S = 60.0  #: longest gap that may be filled, s


def bridged(recording: Recording, most_s: float = BRIDGE_S) -> Recording:
    """Return the recording with its gaps of up to ``most_s`` s filled, and told in ``bridged``.

    Rates change uniformly over a gap, from the mean of the samples before it to that of the samples after it. These means
    are taken over half its length, because the noise of a single sample would be repeated all along the gap.
    """
    missing = recording.missing
    if not missing.any() or not most_s > 0:
        return recording
    filled: list[Gap] = []
    both = np.hstack([recording.dtheta, recording.dvel])
    most = most_s * recording.rate_hz * (1 + 1e-9)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]).astype(np.int8)))
    limits = np.concatenate([[0], edges, [len(missing)]])
    for gap, i in zip(recording.gaps, range(1, len(limits) - 1, 2), strict=True):
        before, first, last, after = limits[i - 1 : i + 3]
        if gap.samples <= most and before < first and last < after:
            both[first:last] = _between(both[before:first], both[last:after], last - first)
            filled.append(gap)
    if not filled:
        return recording
    dtheta, dvel = frozen(both[:, :3].copy()), frozen(both[:, 3:].copy())
    return replace(recording, dtheta=dtheta, dvel=dvel, bridged=(*recording.bridged, *filled))


def _between(before: Array, after: Array, count: int) -> Array:
    """Return ``count`` increments between the last of ``before`` and the first of ``after``, (n, 6) each."""
    size = max(count // 2, 1)
    a, b = before[-size:], after[:size]
    at = np.array([-0.5 * (len(a) - 1) - 1.0, count + 0.5 * (len(b) - 1)])
    w = ((np.arange(count) - at[0]) / (at[1] - at[0]))[:, None]
    return (1.0 - w) * a.mean(axis=0) + w * b.mean(axis=0)


def unbridged(recording: Recording) -> Recording:
    """Return the recording with the gaps that were filled as gaps again, as its file has them."""
    if not recording.bridged:
        return recording
    dtheta, dvel = recording.dtheta.copy(), recording.dvel.copy()
    for gap in recording.bridged:
        first = round((gap.start - recording.t0) * recording.rate_hz)
        dtheta[first : first + gap.samples] = dvel[first : first + gap.samples] = np.nan
    return replace(recording, dtheta=frozen(dtheta), dvel=frozen(dvel), bridged=())
