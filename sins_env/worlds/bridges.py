"""The error that bridged samples of a recording bring into its epochs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.recordings import Recording
from sins_env.sensors.limits import MAX_ANGLE, MAX_SPEED, Field

_LIMIT = np.repeat([MAX_ANGLE, MAX_SPEED], 3)

#: The field that an observation has beside the others if some window has bridged samples.
BRIDGED = {
    "bridge_cov": Field(
        -np.outer(_LIMIT, _LIMIT),
        np.outer(_LIMIT, _LIMIT),
        "covariance of what bridged samples are off by in sum, angle rad and velocity m/s; zeros without any",
    )
}


class Bridges:
    """The bridges of a recording by their samples. The error of a bridge grows in equal independent steps along it."""

    def __init__(self, recording: Recording) -> None:
        gaps = recording.bridged
        first = np.array([round((gap.start - recording.t0) * recording.rate_hz) for gap in gaps], dtype=np.int64)
        count = np.array([gap.samples for gap in gaps], dtype=np.int64)
        order = np.argsort(first)
        self._first, self._last = first[order], (first + count)[order]
        self._step = (recording.bridge_cov / np.maximum(count, 1)[:, None, None])[order]  # (G, 6, 6) a sample

    def in_windows(self, first: NDArray[np.int64], samples: int) -> bool:
        """Return whether a window of so many samples, of those that begin at ``first`` (W,), has a bridged one."""
        return bool((self._span(first, samples) > 0).any())

    def _span(self, first: NDArray[np.int64], samples: int) -> NDArray[np.int64]:
        """Return the number of bridges (...) that the ``samples`` from ``first`` (...) on touch."""
        return np.searchsorted(self._first, first + samples) - np.searchsorted(self._last, first, side="right")

    def cov(self, first: NDArray[np.int64], samples: int) -> Array:
        """Return the covariance (..., 6, 6) of the errors in sum of the ``samples`` from ``first`` (...) on."""
        out = np.zeros((*first.shape, 6, 6))
        nearest, touched = np.searchsorted(self._last, first, side="right"), self._span(first, samples)
        for k in range(int(touched.max(initial=0))):
            here = touched > k
            i, at = nearest[here] + k, first[here]
            bridged = np.minimum(self._last[i], at + samples) - np.maximum(self._first[i], at)
            out[here] += bridged[:, None, None] * self._step[i]
        return out
