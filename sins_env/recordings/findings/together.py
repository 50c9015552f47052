"""Checks of the inertial sensors against the fixes: the clocks of both, the axes, and the course against the forward axis.

The specific force, turned by the gyros into body axes frozen at the start of a span, is integrated from fix to fix. In a
frame of navigation frozen at the start, the same integrals follow from the velocities of the fixes, gravity and the earth's
rate. One rotation takes the first to the second (Wahba's problem, as in docs/mathematics/coarse_alignment.md#recordings).
What is left over tells a lag of one clock, axes that are mirrored, and gyros that turn otherwise than the vehicle.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.recordings.findings.course import MOST_COURSE_DEG, off_course
from sins_env.recordings.findings.finding import Finding
from sins_env.recordings.findings.fixes import is_null
from sins_env.recordings.recording import Recording
from sins_env.recordings.summary import carried

LEG_S = 2.0  #: least time between fixes that are compared; the noise of their velocities counts less in longer ones
SPAN_S = 120.0  #: length of the span that is fitted, in which gyros of any grade hold the attitude well enough
LAG_S, COARSE_S, FINE_S = 30.0, 0.5, 0.05  #: lags of the fixes behind the IMU that are tried, first in coarse steps
LAST_S = 0.01  #: last steps of the lag, whose squares are compared, for most of a steady acceleration tells no lag
MOST_LAG_S, WRONG_LAG_S = 0.2, 0.5  #: lag from which on it is told, and from which on results are wrong
CLEARER = 1.5  #: factor by which the misfit must fall, so that a lag or a mirror is believed
LEAST_CHANGES, LEAST_CHANGE_MPS = (
    8,
    0.5,
)  #: number of changes of the horizontal velocity that a verdict needs, and their size
SURE_MISFIT = 0.3  #: largest misfit at which a lag is believed, of the same kind
MOST_MISFIT = 0.6  #: largest misfit of the changes of velocity, as a share of their size
LEAP_S = (17.0, 18.0, 19.0)  #: differences of GPS time and UTC, s


class _Fit(NamedTuple):
    """How well both sides agree."""

    misfit: float  #: median difference of the horizontal changes, as a share of those of the IMU
    mirrored: float  #: the same with a mirror besides the rotation
    square: float  #: mean square of the horizontal differences, m^2/s^2
    R: Array  #: (3, 3) rotation from the frozen body frame to the frozen navigation frame


class _Span(NamedTuple):
    """The integrals of both sides over a span of fixes."""

    t: Array  #: (n + 1,) times of the fixes, s
    vel: Array  #: (n + 1, 3) their velocities E, N, U, m/s
    change: Array  #: (n, 3) changes that the fixes say, frozen navigation frame, m/s
    level: Array  #: (n,) changes of the horizontal velocity, m/s
    clock: Array  #: (S + 1,) times at which the carried integrals are known, s
    velocity: Array  #: (S + 1, 3) integral of the specific force in the frozen body frame, m/s
    turn: Array  #: (S + 1, 4) attitude relative to the start

    def fit(self, lag: float) -> _Fit | None:
        """Fit the two sides if the fixes lag by ``lag`` s; None if too little of the span is left."""
        at = self.t - lag
        known = (at >= self.clock[0]) & (at <= self.clock[-1])
        use = known[1:] & known[:-1]
        if use.sum() < LEAST_CHANGES:
            return None
        felt = np.diff(np.column_stack([np.interp(at, self.clock, column) for column in self.velocity.T]), axis=0)
        a, b = felt[use], self.change[use]
        u, _, vt = np.linalg.svd(b.T @ a)
        sign = float(np.sign(np.linalg.det(u) * np.linalg.det(vt)))
        plain, mirrored = (u @ np.diag([1.0, 1.0, last]) @ vt for last in (sign, -sign))
        level = np.linalg.norm((a @ plain.T)[:, :2], axis=1)
        moves = level > LEAST_CHANGE_MPS
        if moves.sum() < LEAST_CHANGES:
            return None
        off = [np.linalg.norm((b - a @ R.T)[moves, :2], axis=1) for R in (plain, mirrored)]
        share = [float(np.median(one) / np.median(level[moves])) for one in off]
        return _Fit(share[0], share[1], float(np.mean(off[0] ** 2)), plain)

    def fits(self, lags: Array) -> dict[float, _Fit]:
        """Return the fits of these lags, without those that leave too little of the span."""
        return {lag: one for lag in np.round(lags, 3).tolist() if (one := self.fit(lag)) is not None}


def clocks_and_axes(recording: Recording) -> Iterator[Finding]:
    """Fit the accelerations of the fixes with the turned specific force: the lag of the fixes, and axes that are wrong."""
    span = _span(recording)
    if span is None:
        return
    fits = span.fits(np.arange(-LAG_S, LAG_S + COARSE_S, COARSE_S))
    if fits:
        near = min(fits, key=lambda lag: fits[lag].misfit)
        fits |= span.fits(near + np.arange(-COARSE_S, COARSE_S + FINE_S, FINE_S))
    if not fits:
        return
    here = fits.get(0.0)
    lag = min(fits, key=lambda lag: fits[lag].misfit)
    if abs(lag) > MOST_LAG_S:
        last = span.fits(lag + np.arange(-2 * FINE_S, 2 * FINE_S + LAST_S, LAST_S))
        fits |= last
        lag = min(last, key=lambda lag: last[lag].square, default=lag)
    best, time = fits[lag], (float(span.t[0]), float(span.t[-1]))
    clear = here is None or here.misfit > max(CLEARER * best.misfit, SURE_MISFIT if abs(lag) > 1.0 else 0.0)
    if abs(lag) <= MOST_LAG_S or not clear or best.misfit > SURE_MISFIT:
        if here is None:
            return
        lag, best = 0.0, here
    else:
        leap = ": UTC against GPS time?" if any(abs(abs(lag) - x) < 0.3 for x in LEAP_S) else ""
        side = "behind" if lag > 0 else "before"
        text = (
            f"the accelerations of the fixes fit those of the IMU best if the stamps of the fixes lie {abs(lag):.2f} s {side} "
            f'theirs{leap}; "fix_shift_s": {-lag:.2f} in the mapping moves them'
        )
        yield Finding("clock_offset", abs(lag), MOST_LAG_S, "s", time, text, abs(lag) > WRONG_LAG_S)
    if best.misfit > MOST_MISFIT:
        mirrored = best.mirrored < best.misfit / CLEARER
        why = (
            "mirrored axes of the gyros or the accelerometers would fit"
            if mirrored
            else "axes, signs or units of a sensor are wrong"
        )
        text = f"the turned specific force does not fit the accelerations of the fixes: {why}"
        yield Finding("axes", best.misfit, MOST_MISFIT, "", time, text)
    else:
        yield from _course(span, best.R, lag, time)


def _course(span: _Span, R: Array, lag: float, time: tuple[float, float]) -> Iterator[Finding]:
    """Compare the forward axis with the course over ground."""
    at = np.searchsorted(span.clock, span.t - lag).clip(0, len(span.clock) - 1)
    found = off_course(attitude.multiply(attitude.from_dcm(R), span.turn[at]), span.vel, LEAST_CHANGES)
    if found is not None and abs(off := found[0]) > MOST_COURSE_DEG:
        text = (
            f"the forward axis points {abs(off):.0f} deg {'right' if off > 0 else 'left'} of the course: other axes than "
            "those named, a mounting angle, or a vehicle that drives backwards"
        )
        yield Finding("course", abs(off), MOST_COURSE_DEG, "deg", time, text, False)


def _span(recording: Recording) -> _Span | None:
    """Return the span with the largest changes of velocity; None without fixes of velocity, or if they change too little."""
    gnss = recording.gnss
    if gnss is None or gnss.vel is None:
        return None
    keep = ~is_null(gnss) & (gnss.t_s > recording.t0) & (gnss.t_s <= recording.end)
    t, vel = gnss.t_s[keep], gnss.vel[keep]
    if len(t) < LEAST_CHANGES + 1:
        return None
    step = float(np.median(np.diff(t)))
    every = max(round(LEG_S / step), 1)
    t, vel = t[::every], vel[::every]
    dt = np.diff(t)
    level = np.linalg.norm(np.diff(vel[:, :2], axis=0), axis=1) * (dt < 1.5 * every * step)
    size = max(round(SPAN_S / (every * step)), LEAST_CHANGES)
    total = np.concatenate([[0.0], np.cumsum(level)])
    count = max(len(level) - size, 0) + 1
    begin = int(np.argmax(total[np.minimum(np.arange(count) + size, len(level))] - total[:count]))
    part = slice(begin, begin + size + 1)
    t, vel, level = t[part], vel[part], level[begin : begin + size]
    if (level > LEAST_CHANGE_MPS).sum() < LEAST_CHANGES:
        return None
    edges = [round((x - recording.t0) * recording.rate_hz) for x in (t[0] - LAG_S, t[-1] + LAG_S)]
    first, last = max(edges[0], 0), min(edges[1], len(recording.dtheta))
    gap = np.flatnonzero(recording.missing[first:last])
    if len(gap) or last - first < 2:
        return None
    turn, velocity, samples = carried(recording, first, last)
    clock = recording.t0 + (first + samples * np.arange(len(velocity) + 1)) / recording.rate_hz
    site = recording.site
    model = earth.get(site.earth)
    w = earth.rate_n(model, site.latitude)
    g = np.array([0.0, 0.0, -float(earth.gravity(model, site.latitude, site.height))])
    q = attitude.from_rotvec(w * (t - t[0])[:, None])
    dt = np.diff(t)[:, None]
    middle = attitude.to_dcm(attitude.from_rotvec(w * (0.5 * (t[1:] + t[:-1]) - t[0])[:, None]))
    inertial = np.matmul(attitude.to_dcm(q), vel[..., None])[..., 0]
    force = np.matmul(middle, (np.cross(w, 0.5 * (vel[1:] + vel[:-1])) - g)[..., None])[..., 0]
    change = np.diff(inertial, axis=0) + force * dt
    return _Span(
        t, vel, change, level, clock, np.vstack([np.zeros(3), velocity]), np.vstack([[1.0, 0.0, 0.0, 0.0], turn])
    )
