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
adaptive and H-infinity filters. They run open loop: nothing is relocated between the steps.

The smoothed estimate of the last epoch is the filter's own, so a smoother cannot improve an alignment. At earlier epochs it
has seen more fixes than the filter it may be compared with. ``fixed_lag`` tells what is known ``lag`` steps late.

For an H-infinity filter P_j is the inflated covariance, as in 000. The result is well defined, but neither optimal nor bounded
in the worst case. Section 4.3.3 claims the same form for it, but that needs the P_j that the fix left. With gamma = inf the
filter is the plain UKF and this smoother is the right one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.checks import whole
from solvers.blocks.conditioning import inverse
from solvers.blocks.moments import moments
from solvers.blocks.square_root import symmetrize
from solvers.filters.base import count
from solvers.filters.gaussian import GaussianFilter
from solvers.types import Gaussian, Health, Measurement, Transition

Steps = Iterable[tuple[Transition, Measurement | None]]


class Smoothed(NamedTuple):
    """Smoothed states j = 0 (the start) to T, and the T steps between them."""

    mean: Array  #: (T + 1, ..., n)
    cov: Array  #: (T + 1, ..., n, n)
    filtered: Gaussian  #: (T + 1, ..., n), (T + 1, ..., n, n): the filter's own estimates
    gain: Array  #: (T, ..., n, n), G of each step; 0 in the steps of a frozen run
    noise: Gaussian  #: (T, ..., n), (T, ..., n, n): the process noise w of each step, given all fixes
    health: Health  #: the filter's health at the end, with the repairs of P- counted


class _Step(NamedTuple):
    """What the backward pass needs of the step from j to j + 1."""

    x: Gaussian  #: the filter's estimate at j
    predicted: Gaussian  #: its prediction of j + 1, before the fix
    G: Array  #: (..., n, n), gain back to the state at j
    w: Gaussian  #: the process noise of the step as the filter took it, N(0, Q) or N(q, Q)
    G_w: Array  #: (..., n, n), gain back to this noise
    well: Mask  #: (...), whether the filter took the step; a frozen run did not


def smooth(filter: Any, prior: Gaussian, steps: Steps, rng: Any = None) -> Smoothed:
    """Estimate every state from all fixes: fixed-interval smoothing.

    Memory grows with the number of steps: about 8 n^2 numbers per step and run. A run that freezes at step k is smoothed from
    its last good state k - 1 back. From k on it keeps what the filter held.

    Raises:
        ValueError: the filter is of another kind, or there are no steps.
    """
    b, passed = _start(filter, prior, rng), []
    for tr, me in steps:
        b, step = _forward(filter, b, tr, me)
        passed.append(step)
    if not passed:
        raise ValueError("steps: none given; allowed: at least one (Transition, Measurement or None)")
    last = filter.estimate(b)
    x, noise = [last], []
    for step in reversed(passed):
        noise.append(_back(step.w, step.G_w, step, x[-1]))
        x.append(_back(step.x, step.G, step, x[-1]))
    x.reverse()
    noise.reverse()
    filtered = _stack([*(step.x for step in passed), last])
    gains = np.stack([step.G for step in passed])
    return Smoothed(*_stack(x), filtered, gains, _stack(noise), b.health)


def fixed_lag(filter: Any, prior: Gaussian, steps: Steps, lag: int, rng: Any = None) -> Iterator[Gaussian]:
    """Yield, after step k = 1, 2, ..., the estimate of state max(k - lag, 0) from the fixes up to k.

    Only the last ``lag`` steps are kept. Each step goes back over all of them, which costs ``lag`` matrix products.
    A frozen run is treated as in :func:`smooth`.

    Raises:
        ValueError: the filter is of another kind, or the lag is negative.
    """
    return _fixed_lag(filter, _start(filter, prior, rng), steps, whole("lag", lag, least=0))


def _fixed_lag(filter: Any, b: Any, steps: Steps, lag: int) -> Iterator[Gaussian]:
    window: deque[_Step] = deque(maxlen=lag)
    for tr, me in steps:
        b, step = _forward(filter, b, tr, me)
        window.append(step)
        x = filter.estimate(b)
        for step in reversed(window):
            x = _back(step.x, step.G, step, x)
        yield x


def _start(filter: Any, prior: Gaussian, rng: Any) -> Any:
    if not (isinstance(filter, GaussianFilter) and filter.predicts_by_rule):
        allowed = "filters with one Gaussian that predict by a moment rule, such as ekf, ukf, ckf, hinf_ukf"
        raise ValueError(f"{type(filter).__name__} cannot be smoothed; allowed: {allowed}")
    return filter.init(prior, rng)


def _forward(filter: GaussianFilter[Any], b: Any, tr: Transition, me: Measurement | None) -> tuple[Any, _Step]:
    """Take the filter's own step, and keep beside it the prediction and the gains back."""
    x = filter.estimate(b)
    after, _ = filter.step(b, tr, me)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # runs that freeze are masked below
        predicted = filter.estimate(filter.predict(b, tr))
        Y, repaired = inverse(predicted.cov)
        G = moments(tr.f, x, filter.rule)[0].cross @ Y
        w = filter.process_noise(b, tr)
        G_w = w.cov @ Y
    well = after.health.failed_at < 0
    G, G_w = (np.where(well[..., None, None], gain, 0.0) for gain in (G, G_w))
    return count(after, None if repaired is None else repaired & well), _Step(x, predicted, G, w, G_w, well)


def _back(x: Gaussian, G: Array, step: _Step, later: Gaussian) -> Gaussian:
    """Correct ``x``, the filter's estimate at j, by what is known of the state at j + 1: 000 (4.3.51-53)."""
    _, predicted, *_, well = step
    with np.errstate(invalid="ignore", over="ignore"):
        mean = x.mean + (G @ (later.mean - predicted.mean)[..., None])[..., 0]
        cov = x.cov + symmetrize(G @ (later.cov - predicted.cov) @ G.mT)
    return Gaussian(np.where(well[..., None], mean, x.mean), np.where(well[..., None, None], cov, x.cov))


def _stack(x: list[Gaussian]) -> Gaussian:
    return Gaussian(np.stack([g.mean for g in x]), np.stack([g.cov for g in x]))
