"""Windows of a recording: their starts, whether fixes lie within epochs, and checks that samples and reference are there."""

from __future__ import annotations

import math

import numpy as np

from sins_env.recordings import MOST_BRIDGE_S, Recording, bridged, on_clock, seconds
from sins_env.worlds.settings import check_timing

ON_TIME_S = 1e-4  #: largest distance of a fix from the end of an epoch that is on time, s


class Windows:
    """Windows of equal length. ``first_samples`` (W,) are their first samples, ``starts`` (W,) their starts in s.

    ``aged`` is whether fixes lie within epochs, and not at their ends.

    Args:
        recording: the recording.
        epoch_s: length of an epoch, s.
        n_sub: IMU samples in an epoch.
        coarse_s: length of the coarse phase, s.
        window: (start, length) of the first window, s; None takes the whole recording, or its longest part without a gap.
        duration: length of a window, s, if ``window`` is None; None takes the whole recording.
        stride: time from one start to the next, s; None makes one window.
        told: whether the reference must be there at the start itself, and not only from the end of the first epoch on.

    Raises:
        ValueError: a window outside recording or reference, over a gap, or too short.
    """

    def __init__(
        self,
        recording: Recording,
        epoch_s: float,
        n_sub: int,
        coarse_s: float,
        window: tuple[float | str, float] | None,
        duration: float | None,
        stride: float | None,
        told: bool,
    ) -> None:
        self.recording, self.epoch_s, self.n_sub = recording, epoch_s, n_sub
        self.half_sample = 0.5 / recording.rate_hz * (1 + 1e-6)
        begin, end = self._covered(told)
        start, length = self._whole(begin, end) if window is None else (on_clock(recording, window[0]), window[1])
        length = length if duration is None else duration
        whole = math.floor(length / epoch_s + 1e-4) if math.isfinite(length) else 0
        length = length if abs(length / epoch_s - whole) < 1e-6 else whole * epoch_s
        check_timing(epoch_s, length, coarse_s, "window length" if duration is None else "duration")
        self.num_epochs = round(length / epoch_s)
        slack = self.half_sample
        if start < begin - slack or start + length > end + slack:
            by = "samples" if recording.reference is None else "samples and reference"
            raise ValueError(
                f"window from {seconds(start)} to {seconds(start + length)} s of {recording.name}; allowed: "
                f"within {seconds(begin)} to {seconds(end)} s, which {by} cover"
            )
        count = 1 if stride is None else 1 + math.floor((end + slack - start - length) / stride)
        begins = start + np.arange(count) * (stride or 0.0)
        self.first_samples = np.rint((begins - recording.t0) * recording.rate_hz).astype(np.int64)
        last = len(recording.dtheta) - self.num_epochs * n_sub
        self.first_samples = np.clip(self.first_samples, 0, last)
        self.starts = recording.t0 + self.first_samples / recording.rate_hz
        self._check_gaps()
        self.aged = self._between()

    def _covered(self, told: bool) -> tuple[float, float]:
        """Return the earliest start and the latest end of a window, s."""
        recording = self.recording
        ref = recording.reference
        if ref is None:
            return recording.t0, recording.end
        begin = ref.t_s[0] - (0.0 if told else self.epoch_s)
        return max(recording.t0, float(begin)), min(recording.end, float(ref.t_s[-1]))

    def _whole(self, begin: float, end: float) -> tuple[float, float]:
        """Return start and length of the longest window without a gap.

        It begins a whole number of epochs from the first fix, or without fixes at a whole number of epochs on the clock.
        """
        recording, rate = self.recording, self.recording.rate_hz
        edges = [begin, *(t for gap in recording.gaps for t in (gap.start, gap.end) if begin < t < end), end]
        if begin < edges[1] < end and any(gap.start <= begin < gap.end for gap in recording.gaps):
            edges = edges[1:]
        spans = list(zip(edges[::2], edges[1::2], strict=False))
        begin, end = max(spans, key=lambda span: span[1] - span[0])
        origin = 0.0 if recording.gnss is None else round(float(recording.gnss.t_s[0]) * rate) / rate
        start = origin + math.ceil((begin - origin - self.half_sample) / self.epoch_s) * self.epoch_s
        return start, math.floor((end + self.half_sample - start) / self.epoch_s) * self.epoch_s

    def _check_gaps(self) -> None:
        missing = np.isnan(self.recording.dtheta[:, 0])
        before = np.concatenate([[0], np.cumsum(missing)])
        inside = before[self.first_samples + self.num_epochs * self.n_sub] - before[self.first_samples]
        if inside.any():
            window = int(np.argmax(inside > 0))
            first = self.first_samples[window]
            at = self.recording.t0 + (first + np.argmax(missing[first:])) / self.recording.rate_hz
            longest = max((gap.end - gap.start for gap in self.recording.gaps if gap.end > at), default=0.0)
            fill = math.ceil(10 * longest) / 10
            filled = bridged(self.recording, min(fill, MOST_BRIDGE_S)).missing
            mends = not any(filled[one : one + self.num_epochs * self.n_sub].any() for one in self.first_samples)
            bridge = f", or bridge = {fill:g} s (--bridge {fill:g})" if mends else ""
            raise ValueError(
                f"{self.recording.name}: IMU samples are missing from {seconds(at)} s on, inside the window "
                f"from {seconds(self.starts[window])} s; allowed: windows without a gap{bridge}"
            )

    def _between(self) -> bool:
        """Return whether some fix in a window lies off the ends of epochs."""
        gnss = self.recording.gnss
        if gnss is None:
            return False
        for start in self.starts:
            t = gnss.t_s - start
            t = t[(t > ON_TIME_S) & (t <= self.num_epochs * self.epoch_s + ON_TIME_S)]
            if (np.abs(t - np.rint(t / self.epoch_s) * self.epoch_s) > min(ON_TIME_S, self.half_sample)).any():
                return True
        return False
