"""Damped second-order modes and their closed-form response to steps, blows and bursts.

A mode obeys q'' + 2 zeta w q' + w^2 q = w^2 u(t), with u in units of the deflection at which the load would settle. An
input is a finite sum of exponentials while it lasts, and constant afterwards:

    u(t) = a Re sum_k c_k exp(i v_k (t - t0))    t0 <= t < t0 + T          a s    t >= t0 + T

Three shapes are used:

    a step, a raised cosine       c = 1/2, -1/2    v = 0, pi/T      s = 1
    a blow                        c = 1/2, -1/2    v = 0, 2 pi/T    s = 0
    a burst, a sinusoid under Hann's window, which is three exponentials

Each has continuous u and u', so that q, q', q'' and q''' are continuous. The response is

    q = Re(sum_k a c_k H(i v_k) exp(i v_k t) + h exp(L t))    while the input lasts
    q = a s + Re(h' exp(L t))                                 afterwards

with H(p) = w^2 / (p^2 + 2 zeta w p + w^2) and L = -zeta w + i w sqrt(1 - zeta^2).
See docs/mathematics/simulation.md#parked-car.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask

Complex = NDArray[np.complex128]

SPAN_S = 4.0  #: length of the intervals of time that share one table of exp(L t)


class Shape(NamedTuple):
    """The course u of an input of unit size, in the symbols of the module's docstring."""

    weight: tuple[complex, complex, complex]  #: weights c_k of the exponentials
    turn: tuple[float, float, float]  #: their frequencies v_k, rad/s
    settled: float  #: the constant s at which the input ends


def step(length: float) -> Shape:
    """Return a step from 0 to 1 within ``length`` s, along a raised cosine."""
    return Shape((0.5, -0.5, 0.0), (0.0, np.pi / length, 0.0), 1.0)


def blow(length: float) -> Shape:
    """Return a blow from 0 to 1 and back within ``length`` s; its integral is half the length."""
    return Shape((0.5, -0.5, 0.0), (0.0, 2 * np.pi / length, 0.0), 0.0)


def burst(length: float, hz: float) -> Shape:
    """Return sin(2 pi hz t) under Hann's window of ``length`` s."""
    v, slow = 2 * np.pi * hz, 2 * np.pi / length
    return Shape((-0.5j, 0.25j, 0.25j), (v, v + slow, v - slow), 0.0)


class Input(NamedTuple):
    """One input that acts on all modes."""

    begin: float  #: start t0, s
    length: float  #: duration T, s
    shape: Shape
    size: Array  #: (modes,) the size a in each mode: rad or m


class Modes:
    """The responses of a batch of equal oscillators, each to inputs of its own.

    Args:
        hz: undamped frequencies, (modes,).
        damping: damping ratios zeta, (modes,), below 1.
    """

    def __init__(self, hz: Sequence[float], damping: Sequence[float]) -> None:
        self.omega, self.damping = 2 * np.pi * np.asarray(hz, dtype=float), np.asarray(damping, dtype=float)
        self._decay, self._swing = self.damping * self.omega, self.omega * np.sqrt(1 - self.damping**2)
        self.root = -self._decay + 1j * self._swing  #: L, (modes,)

    def drive(self, inputs: Sequence[Sequence[Input]]) -> None:
        """Begin at rest, with these inputs for each oscillator of the batch."""
        flat = [one for row in inputs for one in row]
        self._rows = len(inputs)
        self._row = np.repeat(np.arange(len(inputs)), [len(row) for row in inputs])
        self._begin, self._length = (np.array([one[i] for one in flat], dtype=float) for i in (0, 1))
        self._end = self._begin + self._length
        weight, turn, settled = (np.array([one.shape[i] for one in flat]) for i in range(3))
        size = np.array([one.size for one in flat]).reshape(-1, len(self.omega))
        self._turn = 1j * turn.reshape(-1, 3)
        self._settled = settled.reshape(-1, 1) * size
        p = self._turn[..., None]
        H = self.omega**2 / (p**2 + 2 * self._decay * p + self.omega**2)
        driven = weight.reshape(-1, 3, 1) * H * size[:, None]  # (inputs, k, modes)
        self._driven = np.moveaxis(_powers(p, driven), 0, 2)  # (inputs, k, derivatives, modes)
        self._first = self._free(-driven.real.sum(axis=1), -(p * driven).real.sum(axis=1))
        swung = driven * np.exp(p * self._length[:, None, None])
        last = self._first * np.exp(self.root * self._length[:, None])
        q = (swung.sum(axis=1) + last).real - self._settled
        self._last = self._free(q, ((p * swung).sum(axis=1) + self.root * last).real)

    def _free(self, q: Array, rate: Array) -> Complex:
        """Return h of the free oscillation that has this deflection and rate at time 0: Re h = q, Re(L h) = q'."""
        return q - 1j * (rate + self._decay * q) / self._swing

    def response(self, t: Array, rows: slice = slice(None)) -> Array:
        """Return deflection, rate and acceleration of these rows at ascending times ``t``: (3, modes, rows, len(t))."""
        begin, end, _ = rows.indices(self._rows)
        out = np.empty((3, len(self.omega), end - begin, len(t)))
        borders = [0, *(np.flatnonzero(np.diff(t // SPAN_S)) + 1), len(t)]
        for first, last in itertools.pairwise(borders):
            self._span(t[first:last], begin, out[..., first:last])
        return out

    def _span(self, t: Array, begin: int, out: Array) -> None:
        """Write the response of the rows from ``begin`` on into ``out`` (3, modes, rows, len(t))."""
        rows, modes = out.shape[2], len(self.omega)
        here = (self._row >= begin) & (self._row < begin + rows)
        past, now = here & (self._end <= t[0]), here & (self._end > t[0]) & (self._begin < t[-1])
        settled, free = np.zeros((rows, modes)), np.zeros((rows, modes), dtype=complex)
        # one input after the other: the bits of a row do not depend on its neighbours
        np.add.at(settled, self._row[past] - begin, self._settled[past])
        np.add.at(free, self._row[past] - begin, self._since(self._last, self._end, past, t[0]))
        swing = _powers(self.root[:, None], np.exp(self.root[:, None] * (t - t[0])))[:, :, None]
        _real(free.T[..., None], swing, out)
        out[0] += settled.T[..., None]
        if now.any():
            self._add_under_way(now, t, swing, self._row[now] - begin, out)

    def _since(self, h: Complex, at: Array, which: Mask, t: float) -> Complex:
        """Carry the free oscillations h from their times ``at`` to the time t: (inputs, modes)."""
        moved: Complex = h[which] * np.exp(self.root * (t - at[which])[:, None])
        return moved

    def _add_under_way(self, which: Mask, t: Array, swing: Complex, rows: NDArray[np.int64], out: Array) -> None:
        """Add the responses to inputs that last at some of the times; ``rows`` names the row of each, ascending."""
        since = t - self._begin[which, None]
        over = since >= self._length[which, None]
        lasts = (since >= 0) & ~over
        first, last = (
            self._since(h, at, which, t[0]).T[..., None]
            for h, at in ((self._first, self._begin), (self._last, self._end))
        )
        added = np.empty((*out.shape[:2], *since.shape))  # (3, modes, inputs, times)
        _real(np.where(over, last, first * lasts), swing, added)
        added[0] += self._settled[which].T[..., None] * over
        one, when = np.nonzero(lasts)
        turned = np.exp(self._turn[which][one].T * since[one, when])  # (k, pairs)
        driven = self._driven[which][one].transpose(2, 3, 1, 0)  # (3, modes, k, pairs)
        added[:, :, one, when] += (turned.real * driven.real - turned.imag * driven.imag).sum(axis=2)
        # the first inputs of all rows, then the second ones: in the order of each row, whatever the others have
        turn = np.arange(len(rows)) - np.searchsorted(rows, rows)
        for i in range(int(turn.max()) + 1):
            out[:, :, rows[turn == i]] += added[:, :, turn == i]


def _powers(p: Complex, x: Complex) -> Complex:
    """Return x, p x, p^2 x on a new first axis: x exp(p t) and its derivatives at t = 0."""
    return np.stack([x, p * x, p * p * x])


def _real(x: Complex, y: Complex, out: Array) -> None:
    """Write Re(x y) into ``out``, with half the work of the complex product."""
    np.multiply(np.ascontiguousarray(x.real), np.ascontiguousarray(y.real), out=out)
    out -= np.ascontiguousarray(x.imag) * np.ascontiguousarray(y.imag)
