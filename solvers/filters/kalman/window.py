"""Gauss-Newton over a sliding window: the tangents of all its epochs are taken again, together.

A filter takes each tangent once, at what it knew then, which may be far off. Here it is taken again while its epoch is in the
window. The unknowns are the states x_0 ... x_K at the epochs of the window. Their factors are

    N(x_0; m, P)              all that lies before the window
    N(x_k+1; f_k(x_k), Q)     a transition, with each move of the state before it (feedback into the INS) as part of f
    N(z_k; h_k(x_k), R)       a fix

Gauss-Newton steps lead to the maximum of their product: all f_k and h_k are linearised along the newest trajectory, and the
linear problem is solved exactly. Its matrix is block tridiagonal. It is eliminated in order of time and substituted back, in
covariance form, because the noise-free directions of Q (biases) have no information matrix. Elimination is then the Kalman
filter along the trajectory, substitution the smoother of Rauch, Tung and Striebel. The variable that leaves the window has been
eliminated before its successors. The Schur complement that it leaves on the next one is the filter's Gaussian there, with the
tangents that it had.

Source: Dellaert & Kaess (2017), doi:10.1561/2300000043, chapters 2 and 5 (elimination); Bell (1994), doi:10.1137/0804035 (the
iterated smoother is Gauss-Newton); docs/mathematics/bound.md#sliding-window.
Departures: no damping; a step that raises the sum of squares is not taken.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import keep, number, whole
from solvers.blocks.conditioning import inverse, nis
from solvers.blocks.moments import standard_deviations, tangent
from solvers.filters.base import choose
from solvers.filters.gaussian import Belief
from solvers.filters.kalman.kf import KF
from solvers.filters.mixtures.angles import least_known_angle, slices
from solvers.types import Function, Gaussian, Health, Innovation, Linear, Measurement, Transition

WORSE = 9.0  #: growth of the sum of squares at which a Gauss-Newton step is not taken: three standard deviations of one
FROM_AFAR = 30  #: largest number of steps from another start
MOST = 36  #: largest number of other starts
FILTER = KF()  #: the filter by which a linear problem is eliminated

Moves = tuple[tuple[Function, Callable[[Array], Array]], ...]  #: moves of the state, each with its Jacobian


@dataclass(frozen=True)
class Step:
    """The factors of an epoch: moves of the state, a transition, and a fix at its end."""

    moves: Moves
    tr: Transition
    me: Measurement | None

    def tangent(self, at: Array, scale: Array) -> Linear:
        """Return the tangent of moves and transition at the state ``at`` (..., n); ``scale`` (..., n) is for differences."""
        y, F = at, None
        for g, jacobian in self.moves:
            J = jacobian(y)
            y, F = g(y), J if F is None else J @ F
        y, J = tangent(self.tr.f, y, scale)
        return touching(y, J if F is None else J @ F, at)


class Node(NamedTuple):
    """An epoch of the window as it was eliminated last."""

    step: Step
    before: Belief  #: the state before the epoch, given what was eliminated
    first: Array  #: (..., n), the state before the epoch at which the tangent of f is
    last: Array  #: (..., n), the state after it at which the tangent of h is
    f: Linear  #: the tangent of f
    surprise: Array  #: (...), normalised innovation squared of the fix; 0 without one
    seen: Array  #: (...), number of components of the fix


class WindowBelief(NamedTuple):
    """The last state given all fixes, and the window before it."""

    inner: Belief  #: the last state, before the moves since
    now: Belief  #: the same after them
    moves: Moves  #: the moves since
    past: tuple[Node, ...]
    age: Array  #: (...) s, time since the tangents of a run were taken again

    @property
    def health(self) -> Health:
        """Health of the elimination, which counts each epoch once."""
        return self.now.health


@dataclass(frozen=True)
class WindowFilter:
    """The Gauss-Newton estimate over the last seconds, as a filter.

    An epoch whose length the transition does not tell counts as a second.

    Raises:
        ValueError: a setting outside its range.
    """

    window_s: float = 60.0  #: s, length of the window; at least one epoch
    relinearise_s: float = 5.0  #: s, time from one set of tangents to the next; 0: at each fix
    iterations: int = 3  #: largest number of Gauss-Newton steps then
    tolerance: float = 0.05  #: move of a state, in standard deviations, below which its run keeps its tangents
    spacing_deg: float = 360.0  #: largest width of a slice of an unknown angle, from which a lost run seeks a maximum
    batched = True
    feedback = "closed"  #: feedback into the INS, unless a setting says otherwise
    coordinates = "invariant"  #: coordinates of the errors, unless a setting says otherwise

    def __post_init__(self) -> None:
        keep(self, "window_s", number, "a positive number of seconds", above=0.0, infinite=True)
        keep(self, "relinearise_s", number, "a number of seconds", least=0.0, infinite=True)
        keep(self, "iterations", whole, least=0, most=1000)
        keep(self, "tolerance", number, least=0.0)
        keep(self, "spacing_deg", number, above=0.0, most=360.0)

    def init(self, prior: Gaussian, rng: Any = None) -> WindowBelief:
        return self.begin(FILTER.init(prior, rng))

    def begin(self, b: Belief) -> WindowBelief:
        """Return a window that begins with a belief."""
        return WindowBelief(b, b, (), (), np.zeros(b.mean.shape[:-1]))

    def step(self, b: WindowBelief, tr: Transition, me: Measurement | None) -> tuple[WindowBelief, Innovation | None]:
        """Take an epoch. All epochs of the window are linearised and solved again in the runs that have a fix and are due."""
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # runs that are lost are marked
            tr, me = FILTER.checked(b.inner, tr, me)
            node, inner, innovation = eliminate(Step(b.moves, tr, me), b.inner, b.inner.mean)
            past, age = (*b.past, node)[-self._epochs(tr) :], b.age + length(tr)
            if innovation is not None:
                has = ~np.isnan(innovation.residual).all(axis=-1)
                due = has & (age >= self.relinearise_s * (1 - 1e-9)) & (inner.health.failed_at < 0)
                if due.any():
                    past, inner = self._solve(past, inner, due)
                    age = np.where(due, 0.0, age)
            if inner.health.frozen:  # such runs stay where the last moves have left them
                inner = choose(inner.health.failed_at < 0, inner, b.now)
        return WindowBelief(inner, inner, (), past, age), innovation

    def estimate(self, b: WindowBelief) -> Gaussian:
        return Gaussian(b.now.mean, b.now.cov)

    def diagnostics(self, b: WindowBelief) -> dict[str, Array]:
        return {}

    def relocate(self, b: WindowBelief, g: Function, jac: Callable[[Array], Array]) -> WindowBelief:
        """Move the last state; the move becomes a part of the next epoch's f."""
        return b._replace(now=FILTER.relocate(b.now, g, jac), moves=(*b.moves, (g, jac)))

    def _epochs(self, tr: Transition) -> int:
        """Return the number of epochs in the window."""
        return max(1, round(min(self.window_s / length(tr), 1e9)))

    def _solve(self, past: tuple[Node, ...], inner: Belief, due: Mask) -> tuple[tuple[Node, ...], Belief]:
        """Return the window with tangents at a maximum, in the runs (...) that are due.

        It is the one near the present tangents. A run whose fixes it does not explain seeks a better one from other starts.
        """
        best, last, _ = self._climb(past, inner, due, self.iterations)
        lost = due & improbable(best)
        if self.spacing_deg < 360.0 and lost.any():
            for start, own in starts(past[0], math.radians(self.spacing_deg)):
                if (own & lost).any():
                    nodes, state, settled = self._climb(*along(past, shoot(past, start)), own & lost, FROM_AFAR)
                    better = settled & (misfit(nodes) < misfit(best))
                    if better.any():
                        best, last = choose(better, (nodes, state), (best, last))
        return best, last

    def _climb(
        self, past: tuple[Node, ...], inner: Belief, where: Mask, steps: int
    ) -> tuple[tuple[Node, ...], Belief, Mask]:
        """Take Gauss-Newton steps until no state of the runs ``where`` (...) moves; the last result is whether they have settled.

        A run that has stopped keeps its tangents, and so does one whose fixes a step explains worse.
        """
        well = going = where & (inner.health.failed_at < 0)
        for _ in range(steps):
            path = substitute(past, inner)
            going = going & self._moves(past, path)
            if not going.any():
                break
            after, state = along(past, path, going)
            better = (misfit(after) <= misfit(past) + WORSE) & (state.health.failed_at < 0)
            if (going & ~better).any():
                after, state = choose(better | ~going, (after, state), (past, inner))
            past, inner, well, going = after, state, well & (better | ~going), going & better
        return past, inner, well & ~going

    def _moves(self, past: tuple[Node, ...], path: list[Array]) -> Mask:
        """Return the runs (...) in which a state has left its tangent by more than the tolerance."""
        moved: Mask = np.zeros(path[0].shape[:-1], dtype=bool)
        for node, first, last in zip(past, path[:-1], path[1:], strict=True):
            limit = self.tolerance * standard_deviations(node.before.cov)
            moved = moved | ((np.abs(first - node.first) > limit) | (np.abs(last - node.last) > limit)).any(axis=-1)
        return moved


def eliminate(
    step: Step, before: Belief, first: Array, last: Array | None = None
) -> tuple[Node, Belief, Innovation | None]:
    """Eliminate the state before an epoch: return its node, the belief after it, and the innovation.

    The tangents are taken at the states ``first`` and ``last`` (..., n) before and after; None: at the prediction.
    """
    scale = standard_deviations(before.cov)
    f = step.tangent(first, scale)
    last = f(before.mean) if last is None else last
    me = step.me
    if me is not None and not isinstance(me.h, Linear):
        me = me._replace(h=touching(*tangent(me.h, last, scale), last))
    after, innovation = FILTER.advance(before, step.tr._replace(f=f), me)
    surprise = seen = np.zeros(first.shape[:-1])
    if innovation is not None:
        surprise, seen = nis(present(innovation)), (~np.isnan(innovation.residual)).sum(axis=-1)
    return Node(step, before, first, last, f, surprise, seen), after, innovation


def along(past: tuple[Node, ...], path: list[Array], where: Mask | None = None) -> tuple[tuple[Node, ...], Belief]:
    """Eliminate a window again, with tangents along the states of ``path`` in the runs of the mask (...), None: all.

    Return its nodes, and the belief at its end.
    """
    nodes, state = [], past[0].before
    for node, first, last in zip(past, path[:-1], path[1:], strict=True):
        if where is not None:
            first, last = (
                np.where(where[..., None], new, old) for new, old in ((first, node.first), (last, node.last))
            )
        again, state, _ = eliminate(node.step, state, first, last)
        nodes.append(again)
    return tuple(nodes), state


def starts(node: Node, spacing: float) -> list[tuple[Array, Mask]]:
    """Return states (..., n) before an epoch in slices of the angle that is least known, of at most ``spacing`` rad.

    Each comes with a mask (...) of the runs that it is for; one whose angle is known better than half a slice has none. The other
    states follow their regression on the angle.
    """
    x, P = node.before.mean, node.before.cov
    axis = least_known_angle(node.step.tr.f, x, P)
    here = np.maximum(axis, 0)[..., None]
    column = np.take_along_axis(P, here[..., None], axis=-1)[..., 0]
    variance = np.where(axis >= 0, np.take_along_axis(column, here, axis=-1)[..., 0], 0.0)
    offsets, weights, _ = slices(np.where(np.isfinite(variance), variance, 0.0), spacing, MOST)
    own = (weights > 0.0) & ((weights > 0.0).sum(axis=-1, keepdims=True) > 1)
    if not own.any():
        return []
    step = column / np.where(variance > 0.0, variance, 1.0)[..., None]
    return [(x + offsets[..., i, None] * step, own[..., i]) for i in range(own.shape[-1])]


def shoot(past: tuple[Node, ...], start: Array) -> list[Array]:
    """Return the states (..., n) of the window that follow ``start`` (..., n) without noise."""
    path = [start]
    for node in past:
        x = path[-1]
        for g, _ in node.step.moves:
            x = g(x)
        path.append(node.step.tr.f(x))
    return path


def substitute(past: tuple[Node, ...], last: Belief) -> list[Array]:
    """Return the states (..., n) of the window given all its fixes, from the first to the ``last``, by back-substitution."""
    path = [last.mean]
    for node in reversed(past):
        x, P = node.before.mean, node.before.cov
        F = node.f.matrix
        Y, _ = inverse(F @ P @ F.mT + node.step.tr.Q)
        back = P @ F.mT @ Y @ (path[-1] - node.f(x))[..., None]
        finite = np.asarray(np.isfinite(back).all(axis=(-2, -1)))
        path.append(np.where(finite[..., None], x + back[..., 0], x))
    return path[::-1]


def misfit(past: tuple[Node, ...]) -> Array:
    """Return the least value (...) of the linearised problem: the sum of the normalised innovations squared."""
    return np.sum([node.surprise for node in past], axis=0)


def improbable(past: tuple[Node, ...]) -> Mask:
    """Return whether the misfit (...) is beyond its mean by five standard deviations or more, or is not finite."""
    count = np.sum([node.seen for node in past], axis=0)
    return np.asarray(~(misfit(past) < count + 5.0 * np.sqrt(2.0 * count)))


def present(innovation: Innovation) -> Innovation:
    """Return the innovation with zero of variance one in the place of missing components."""
    gone = np.isnan(innovation.residual)
    S = np.where(gone[..., None] | gone[..., None, :], np.eye(gone.shape[-1]), innovation.cov)
    return Innovation(np.where(gone, 0.0, innovation.residual), S)


def touching(y: Array, J: Array, at: Array) -> Linear:
    """Return the linear function with the value y (..., m) and the slope J (m, n) or (..., m, n) at ``at`` (..., n)."""
    return Linear(np.broadcast_to(J, (*at.shape[:-1], *J.shape[-2:])), y - (J @ at[..., None])[..., 0])


def length(tr: Transition) -> float:
    """Return the length of an epoch, s; one that is not told counts as a second."""
    return 1.0 if tr.dt is None else tr.dt
