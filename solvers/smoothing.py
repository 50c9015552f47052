"""Rauch-Tung-Striebel smoothing for the Gaussian filters of the zoo: what the state was, seen from later.

Idea: a filter's step from j to j+1 gives x_j, P_j, the prediction x-, P- and the cross covariance C of the two states.
Going back, the gain G = C (P-)^-1 passes on what the later fixes say about x_{j+1}:

    x^s_j = x_j + G (x^s_{j+1} - x-),   P^s_j = P_j + G (P^s_{j+1} - P-) G'.

C is a weighted sum for sigma points, and P F' for a tangent F.

Source: Rauch, Tung & Striebel (1965), doi:10.2514/3.3166; unscented: Sarkka (2008), doi:10.1109/TAC.2008.919531;
docs/mathematics/filters.md#smoothing. The scheme of 000 (4.3.38-56) codes the later fixes as a pseudo measurement. With its
misprints corrected (docs/mathematics/errata.md#chapter-4) it is the same smoother, as a test shows.
Shapes: x (..., n), P (..., n, n); ``Smoothed`` has time in front.
Filters: those with one Gaussian that predict by their ``rule``, which are kf, ekf, and the unscented, cubature, robust,
adaptive and H-infinity filters. A closed loop moves the state after a step, x -> g(x). Its smoothed state is taken back through
the move first, exactly, by Newton's method. :mod:`solvers.pipeline.smoother` smooths a whole navigation so.

The smoothed estimate of the last epoch is the filter's own, so a smoother cannot improve an alignment. At earlier epochs it
has seen more fixes than the filter it may be compared with. ``fixed_lag`` tells what is known ``lag`` steps late.

For an H-infinity filter P_j is the inflated covariance, as in 000. The result is well defined, but neither optimal nor bounded
in the worst case. Section 4.3.3 claims the same form for it, but that needs the P_j that the fix left. With gamma = inf the
filter is the plain UKF and this smoother is the right one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import whole
from solvers.blocks.conditioning import inverse
from solvers.blocks.moments import moments
from solvers.blocks.square_root import symmetrize
from solvers.filters.base import count
from solvers.filters.gaussian import GaussianFilter
from solvers.types import Function, Gaussian, Health, Innovation, Measurement, Transition

__all__ = ["Recorder", "Smoothed", "fixed_lag", "smooth"]

NEWTON = 3  #: steps of Newton's method that take a state back through a move; each squares an error of second order

Steps = Iterable[tuple[Transition, Measurement | None]]


class Smoothed(NamedTuple):
    """Smoothed states j = 0 (the start) to T, and the T steps between them."""

    mean: Array  #: (T + 1, ..., n)
    cov: Array  #: (T + 1, ..., n, n)
    filtered: Gaussian  #: (T + 1, ..., n), (T + 1, ..., n, n): the filter's own estimates
    gain: Array  #: (T, ..., n, n), G of each step; 0 in the steps of a frozen run
    noise: Gaussian  #: (T, ..., n), (T, ..., n, n): the process noise w of each step, given all fixes
    health: Health  #: the filter's health at the end, with the repairs of P- counted


class _Move(NamedTuple):
    """A move of the state x -> g(x) after a step, as feedback into the INS makes it."""

    x: Array  #: (..., n), the filter's mean before the move
    g: Function
    jacobian: Callable[[Array], Array]

    def undone(self, moved: Gaussian) -> Gaussian:
        """Return the Gaussian before the move, for the one after it."""
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # runs that are lost
            x = self.x
            for _ in range(NEWTON):
                x = x + np.linalg.solve(self.jacobian(x), (moved.mean - self.g(x))[..., None])[..., 0]
            J = self.jacobian(x)
            return Gaussian(x, symmetrize(np.linalg.solve(J, np.linalg.solve(J, moved.cov).mT)))


class _Step(NamedTuple):
    """What the backward pass needs of the step from j to j + 1."""

    x: Gaussian  #: the filter's estimate at j
    predicted: Gaussian  #: its prediction of j + 1, before the fix
    G: Array  #: (..., n, n), gain back to the state at j
    well: Mask  #: (...), whether the filter took the step; a frozen run did not
    w: (
        Gaussian | None
    )  #: the process noise of the step as the filter took it, N(0, Q) or N(q, Q); None if it is not asked for
    G_w: Array | None  #: (..., n, n), gain back to this noise
    move: _Move | None = None  #: what moved the state after the step


class Recorder:
    """A filter that does what ``inner`` does, and keeps of each step what smoothing needs.

    It serves wherever ``inner`` does, as in a closed loop, which relocates its belief. ``noise`` tells whether the process
    noise is smoothed, too. Memory grows with the number of steps: about 3 n^2 numbers per step and run, 5 n^2 with the noise.

    Raises:
        ValueError: the filter is of another kind.
    """

    def __init__(self, inner: Any, noise: bool = False) -> None:
        if not (isinstance(inner, GaussianFilter) and inner.predicts_by_rule):
            allowed = "filters with one Gaussian that predict by a moment rule, such as ekf, ukf, ckf, hinf_ukf"
            raise ValueError(f"{type(inner).__name__} cannot be smoothed; allowed: {allowed}")
        self.inner, self.noise = inner, noise
        self.passed: list[_Step] = []  #: the steps since the beginning

    def __repr__(self) -> str:
        return f"Recorder({self.inner!r})"

    def __getattr__(self, name: str) -> Any:
        if name == "inner":  # a copy that has no fields yet
            raise AttributeError(name)
        return getattr(self.inner, name)

    def step(self, b: Any, tr: Transition, me: Measurement | None) -> tuple[Any, Innovation | None]:
        """Take the filter's own step, and keep beside it the prediction and the gains back."""
        filter, x, w, G_w = self.inner, self.inner.estimate(b), None, None
        after, innovation = filter.step(b, tr, me)
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # runs that freeze are masked below
            tr, _ = filter.checked(b, tr, None)
            predicted = filter.estimate(filter.predict(b, tr))
            Y, repaired = inverse(predicted.cov)
            well = after.health.failed_at < 0
            G = np.where(well[..., None, None], moments(tr.f, x, filter.rule)[0].cross @ Y, 0.0)
            if self.noise:
                w = filter.process_noise(b, tr)
                G_w = np.where(well[..., None, None], w.cov @ Y, 0.0)
        self.passed.append(_Step(x, predicted, G, well, w, G_w))
        return count(after, None if repaired is None else repaired & well), innovation

    def relocate(self, b: Any, g: Function, jac: Callable[[Array], Array]) -> Any:
        """Move the belief as the filter does, and keep the move."""
        if self.passed:
            self.passed[-1] = self.passed[-1]._replace(move=_Move(self.inner.estimate(b).mean, g, jac))
        return self.inner.relocate(b, g, jac)

    def backward(self, last: Gaussian) -> Iterator[tuple[Gaussian, Gaussian | None]]:
        """Yield the smoothed state at j and the process noise of the step from j on, for j = T - 1 to 0.

        ``last`` is the filter's estimate at T. A state is the one after its move.
        """
        x = last
        for step in reversed(self.passed):
            later = x if step.move is None else step.move.undone(x)
            w = None if step.w is None or step.G_w is None else _back(step.w, step.G_w, step, later)
            x = _back(step.x, step.G, step, later)
            yield x, w


def smooth(filter: Any, prior: Gaussian, steps: Steps, rng: Any = None) -> Smoothed:
    """Estimate every state from all fixes: fixed-interval smoothing.

    Memory grows with the number of steps: about 8 n^2 numbers per step and run. A run that freezes at step k is smoothed from
    its last good state k - 1 back. From k on it keeps what the filter held.

    Raises:
        ValueError: the filter is of another kind, or there are no steps.
    """
    recorder = Recorder(filter, noise=True)
    b = recorder.init(prior, rng)
    for tr, me in steps:
        b, _ = recorder.step(b, tr, me)
    if not recorder.passed:
        raise ValueError("steps: none given; allowed: at least one (Transition, Measurement or None)")
    last = filter.estimate(b)
    states, noises = zip(*recorder.backward(last), strict=True)
    filtered = _stack([*(step.x for step in recorder.passed), last])
    gains = np.stack([step.G for step in recorder.passed])
    return Smoothed(*_stack([*reversed(states), last]), filtered, gains, _stack(noises[::-1]), b.health)


def fixed_lag(filter: Any, prior: Gaussian, steps: Steps, lag: int, rng: Any = None) -> Iterator[Gaussian]:
    """Yield, after step k = 1, 2, ..., the estimate of state max(k - lag, 0) from the fixes up to k.

    Only the last ``lag`` steps are kept. Each step goes back over all of them, which costs ``lag`` matrix products.
    A frozen run is treated as in :func:`smooth`.

    Raises:
        ValueError: the filter is of another kind, or the lag is negative.
    """
    recorder = Recorder(filter)
    return _fixed_lag(recorder, recorder.init(prior, rng), steps, whole("lag", lag, least=0))


def _fixed_lag(recorder: Recorder, b: Any, steps: Steps, lag: int) -> Iterator[Gaussian]:
    for tr, me in steps:
        b, _ = recorder.step(b, tr, me)
        del recorder.passed[: max(len(recorder.passed) - lag, 0)]
        last = recorder.estimate(b)
        yield deque(recorder.backward(last), maxlen=1)[0][0] if lag else last


def _back(x: Gaussian, G: Array, step: _Step, later: Gaussian) -> Gaussian:
    """Correct ``x``, the filter's estimate at j, by what is known of the state at j + 1: 000 (4.3.51-53)."""
    predicted, well = step.predicted, step.well
    with np.errstate(invalid="ignore", over="ignore"):
        mean = x.mean + (G @ (later.mean - predicted.mean)[..., None])[..., 0]
        cov = x.cov + symmetrize(G @ (later.cov - predicted.cov) @ G.mT)
    return Gaussian(np.where(well[..., None], mean, x.mean), np.where(well[..., None, None], cov, x.cov))


def _stack(x: Sequence[Gaussian]) -> Gaussian:
    return Gaussian(np.stack([g.mean for g in x]), np.stack([g.cov for g in x]))
