"""Windows of a recording: their starts, and checks that samples, fixes and reference are all there."""

from __future__ import annotations

import math

import numpy as np

from sins_env.recordings import Recording, seconds
from sins_env.worlds.settings import check_timing


class Windows:
    """Windows of equal length. ``first_samples`` (W,) are their first samples, ``starts`` (W,) their starts in s.

    Args:
        recording: the recording.
        epoch_s: length of an epoch, s.
        n_sub: IMU samples in an epoch.
        coarse_s: length of the coarse phase, s.
        window: (start, length) of the first window, s; None takes the whole recording.
        duration: length of a window, s, if ``window`` is None; None takes the whole recording.
        stride: time from one start to the next, s; None makes one window.
        told: whether the reference must be there at the start itself, and not only from the end of the first epoch on.

    Raises:
        ValueError: a window outside recording or reference, over a gap, or with fixes between epochs.
    """

    def __init__(
        self,
        recording: Recording,
        epoch_s: float,
        n_sub: int,
        coarse_s: float,
        window: tuple[float, float] | None,
        duration: float | None,
        stride: float | None,
        told: bool,
    ) -> None:
        self.recording, self.epoch_s, self.n_sub = recording, epoch_s, n_sub
        self.half_sample = 0.5 / recording.rate_hz * (1 + 1e-6)
        begin, end = self._covered(told)
        start, length = window or self._whole(begin, end)
        length = length if duration is None else duration
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
        self._check_fixes()

    def _covered(self, told: bool) -> tuple[float, float]:
        """Return the earliest start and the latest end of a window, s."""
        recording = self.recording
        ref = recording.reference
        if ref is None:
            return recording.t0, recording.end
        begin = ref.t_s[0] - (0.0 if told else self.epoch_s)
        return max(recording.t0, float(begin)), min(recording.end, float(ref.t_s[-1]))

    def _whole(self, begin: float, end: float) -> tuple[float, float]:
        """Return start and length of the longest window.

        It begins a whole number of epochs from the first fix, or without fixes at a whole number of epochs on the clock.
        """
        gnss, rate = self.recording.gnss, self.recording.rate_hz
        origin = 0.0 if gnss is None else round(float(gnss.t_s[0]) * rate) / rate
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
            raise ValueError(
                f"{self.recording.name}: IMU samples are missing from {seconds(at)} s on, inside the window "
                f"from {seconds(self.starts[window])} s; allowed: windows without a gap"
            )

    def _check_fixes(self) -> None:
        gnss = self.recording.gnss
        if gnss is None:
            return
        for start in self.starts:
            t = gnss.t_s - start
            t = t[(t > self.half_sample) & (t <= self.num_epochs * self.epoch_s + self.half_sample)]
            off = _off(t, self.epoch_s)
            bad = np.flatnonzero(np.abs(off) > self.half_sample)
            if len(bad):
                raise ValueError(self._advice(start, t, t[bad[0]], off[bad[0]]))

    def _advice(self, start: float, t: np.ndarray, fix: float, off: float) -> str:
        """Return the text of the error, with a start or a length of epoch at which every fix would fit."""
        fits = []
        if np.all(np.abs(_off(t - off, self.epoch_s)) <= self.half_sample):
            fits.append(f"a window that begins at {start + off % self.epoch_s:g} s modulo {self.epoch_s:g} s")
        for parts in range(2, self.n_sub + 1):
            epoch = self.epoch_s / parts
            if self.n_sub % parts == 0 and np.all(np.abs(_off(t, epoch)) <= self.half_sample):
                fits.append(f"epochs of {epoch:g} s")
                break
        allowed = " or ".join(fits) or "fixes within half a sample of one"
        return (
            f"{self.recording.name}: the fix at {seconds(start + fix)} s is {abs(off):.3g} s off the end of "
            f"an epoch of the window from {seconds(start)} s; allowed: {allowed}"
        )


def _off(t: np.ndarray, epoch: float) -> np.ndarray:
    """Return how far each time lies after the nearest end of an epoch, s."""
    return t - np.rint(t / epoch) * epoch
