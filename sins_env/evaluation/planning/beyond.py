"""What the bound tends to: the last part of a motion is repeated again and again.

Many epochs together take P to Q + Phi (P^-1 + G)^-1 Phi'. Three matrices hold the map, two maps in a row are another one of the
same form, and so a map joined to itself ten times spans a thousand repetitions. See docs/mathematics/bound.md#beyond.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.bound.error_dynamics import ErrorDynamics, Reading
from sins_env.evaluation.planning.recursion import corrected, predicted

REPEATED_S = 120.0  #: longest part of the motion that is repeated, s; at most half of it
HORIZON_S = 86_400.0  #: time after which the bound counts as what it tends to, s
WITHOUT_END = 1e12  #: variance over that of the start, from which on it counts as infinite
SETTLED = 1e-3  #: relative change of a bound over half of the horizon, below which it has settled


class Span(NamedTuple):
    """What some epochs do to a covariance: (runs, n, n) each."""

    Phi: Array  #: transition of the errors under the gains of a start without errors
    G: Array  #: information on the start
    Q: Array  #: covariance of the end for a start without errors

    def after(self, P: Array) -> Array:
        """Return the covariance (runs, n, n) after these epochs."""
        eye = np.eye(P.shape[-1])
        out: Array = self.Q + self.Phi @ P @ np.linalg.solve(eye + self.G @ P, self.Phi.mT)
        return 0.5 * (out + out.mT)

    def then(self, other: Span) -> Span:
        """Return the map of these epochs and then those of the other one."""
        between = np.linalg.inv(np.eye(self.Q.shape[-1]) + self.Q @ other.G)
        G = self.G + self.Phi.mT @ other.G @ between @ self.Phi
        Q = other.Q + other.Phi @ between @ self.Q @ other.Phi.mT
        return Span(other.Phi @ between @ self.Phi, 0.5 * (G + G.mT), 0.5 * (Q + Q.mT))


class Recorder:
    """Joins epochs to one map. States are in units of their spread at the start, so that no number is tiny or huge."""

    def __init__(self, model: ErrorDynamics, runs: int) -> None:
        spread = np.sqrt(np.diagonal(model.P0))
        self.scale = np.where(spread > 0, spread, 1.0)
        shape = (runs, model.n, model.n)
        eye = np.broadcast_to(np.eye(model.n), shape)
        self.span = Span(eye.copy(), np.zeros(shape), np.zeros(shape))

    def add(self, F: Array, added: Array, readings: Sequence[Reading], R: dict[str, Array], k: int) -> None:
        """Join epoch ``k`` of a chunk, with F (runs, n, n) and the variance ``added`` (n,) that comes in."""
        F = F * (self.scale / self.scale[:, None])
        Phi, G, Q = F @ self.span.Phi, self.span.G, predicted(self.span.Q[None], F, (added / self.scale**2)[None])
        for one in readings:
            if one.there[k]:
                H = one.H[:, k] * self.scale
                S = H @ Q[0] @ H.mT + R[one.name]
                seen = H @ Phi
                G = G + seen.mT @ np.linalg.solve(S, seen)
                Q, K = corrected(Q, H, R[one.name][None], 1)
                Phi = Phi - K[0] @ seen
        self.span = Span(Phi, G, Q[0])


class Course(NamedTuple):
    """Covariances at the ends of 0, 1, 2, 4, 8 ... repetitions of a span, and the maps between them."""

    times: list[float]  #: s after the end of the motion
    P: list[Array]
    spans: list[Span]  #: maps of 1, 2, 4 ... repetitions
    units: Array  #: (n, n) units of the covariances of the spans
    span_s: float

    def first(self, reached: Callable[[Array], bool]) -> float:
        """Return after how many seconds ``reached`` of the covariance is true for the first time; inf within the horizon.

        It is found to the length of a repetition, for a condition that stays true.
        """
        ends = [i for i, P in enumerate(self.P) if reached(P)]
        if not ends:
            return np.inf
        if ends[0] < 2:
            return self.times[ends[0]]
        count, P = 2 ** (ends[0] - 2), self.P[ends[0] - 1]
        for power in range(ends[0] - 3, -1, -1):
            ahead = self.spans[power].after(P / self.units) * self.units
            if not reached(ahead):
                count, P = count + 2**power, ahead
        return (count + 1) * self.span_s


def repeated(recorder: Recorder, P: Array, span_s: float) -> Course:
    """Return how P (runs, n, n) goes on, in units of the states, if the span of ``span_s`` s is repeated to the horizon."""
    units = recorder.scale[:, None] * recorder.scale
    start, now = P / units, recorder.span
    times, found, spans = [0.0], [P], []
    length = span_s
    while True:
        after = now.after(start)
        grown = not np.abs(after).max() < WITHOUT_END  # also if it is not a number
        spans.append(now)
        times.append(length)
        found.append(np.full_like(P, np.inf) if grown else after * units)
        if grown or length >= HORIZON_S:
            break
        now, length = now.then(now), 2 * length
    return Course(times, found, spans, units, span_s)
