"""Rauch-Tung-Striebel smoothing for any Gaussian filter of the zoo: what was the state, seen from later.

Idea: a filter's step from j to j+1 gives x_j, P_j, the prediction x-, P- and the cross covariance C of the two states.
Going back, G = C (P-)^-1 passes on what the later fixes had to say about x_{j+1}:
x^s_j = x_j + G (x^s_{j+1} - x-), P^s_j = P_j + G (P^s_{j+1} - P-) G'. With sigma points C is their sum, with a tangent P F'.

Source: Rauch, Tung & Striebel (1965), doi:10.2514/3.3166; unscented: Sarkka (2008), doi:10.1109/TAC.2008.919531;
docs/mathematics/filters.md#smoothing. The scheme of 000 (4.3.38-56) recodes the later fixes as a pseudo measurement;
corrected, it is the
same smoother (a test plays both).
Shapes: x (..., n), P (..., n, n); ``Smoothed`` has time in front. For filters with one Gaussian that predict by their ``rule``:
kf, ekf, the unscented, cubature, robust, adaptive and H-infinity ones. Open loop: nothing is relocated between the steps.

At the end x^s = x: an interval smoother cannot better an alignment's last epoch, and to compare it with a filter at
earlier ones is unfair; ``fixed_lag`` says what is known ``lag`` steps late.

**Of an H-infinity filter** this takes the inflated P_j as the filter's covariance, as 000 does. That is well defined, but
neither optimal nor with a bound on the worst case: the identities behind "the same form for the H-infinity UKF" of
section 4.3.3 hold only where P_j is what the fix left. gamma = inf, the plain UKF, smooths as it should.
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
from solvers.filters.adaptive.augmented_aukf import AugmentedAUKF
from solvers.filters.base import count
from solvers.filters.gaussian import GaussianFilter
from solvers.filters.particles.gaussian_particles import GaussianParticles
from solvers.types import Gaussian, Health, Measurement, Transition

Steps = Iterable[tuple[Transition, Measurement | None]]

#: Gaussian filters that predict from points of their own: C of their rule does not belong to their P-
_OTHERWISE = (AugmentedAUKF, GaussianParticles)


class Smoothed(NamedTuple):
    """States j = 0 (the start) to T, and between them T steps; frozen runs: see :func:`smooth`."""

    mean: Array  #: (T + 1, ..., n)
    cov: Array  #: (T + 1, ..., n, n)
    filtered: Gaussian  #: (T + 1, ..., n), (T + 1, ..., n, n): what the filter said at the time
    gain: Array  #: (T, ..., n, n) G; 0 in the steps of a frozen run
    noise: Gaussian  #: (T, ..., n), (T, ..., n, n): w of each step, given everything
    health: Health  #: the filter's at the end, with the repairs of P- on the way back


class _Step(NamedTuple):
    """What the backward pass needs of the step from j to j + 1."""

    x: Gaussian  #: the filter's at j
    predicted: Gaussian  #: at j + 1, before its fix
    G: Array  #: (..., n, n) back to the state at j
    w: Gaussian  #: the noise of the step as the filter took it, N(0, Q) or N(q, Q)
    G_w: Array  #: (..., n, n) back to the noise
    well: Mask  #: (...) whether the filter took the step; a frozen run did not


def smooth(filter: Any, prior: Gaussian, steps: Steps, rng: Any = None) -> Smoothed:
    """Every state given all fixes: fixed-interval smoothing. Memory grows with the steps, 8 n^2 numbers for each and run.

    A run that freezes at step k is smoothed from its last good state k - 1 back; from k on it keeps what the filter held.

    Raises:
        ValueError: a filter of another kind; no steps.
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
    """After step k = 1, 2, ...: the state max(k - lag, 0), given the fixes up to k. Keeps ``lag`` steps, no more.

    Each step goes back over the window anew, for the time of ``lag`` products. A frozen run: as in :func:`smooth`.

    Raises:
        ValueError: a filter of another kind, a lag below zero.
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
    if not isinstance(filter, GaussianFilter) or isinstance(filter, _OTHERWISE):
        allowed = "filters with one Gaussian that predict by a moment rule, such as ekf, ukf, ckf, hinf_ukf"
        raise ValueError(f"{type(filter).__name__} cannot be smoothed; allowed: {allowed}")
    return filter.init(prior, rng)


def _forward(filter: GaussianFilter[Any], b: Any, tr: Transition, me: Measurement | None) -> tuple[Any, _Step]:
    """The filter's own step, and beside it its prediction and the gains back."""
    x = filter.estimate(b)
    after, _ = filter.step(b, tr, me)
    with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # of runs that freeze
        predicted = filter.estimate(filter.predict(b, tr))
        Y, repaired = inverse(predicted.cov)
        G = moments(tr.f, x, filter.rule)[0].cross @ Y
        w = filter.process_noise(b, tr)
        G_w = w.cov @ Y
    well = after.health.failed_at < 0
    G, G_w = (np.where(well[..., None, None], gain, 0.0) for gain in (G, G_w))
    return count(after, None if repaired is None else repaired & well), _Step(x, predicted, G, w, G_w, well)


def _back(x: Gaussian, G: Array, step: _Step, later: Gaussian) -> Gaussian:
    """``x``, which the filter knew at j, given what is known of the state at j + 1. # 000 (4.3.51-53)"""
    _, predicted, *_, well = step
    with np.errstate(invalid="ignore", over="ignore"):
        mean = x.mean + (G @ (later.mean - predicted.mean)[..., None])[..., 0]
        cov = x.cov + symmetrize(G @ (later.cov - predicted.cov) @ G.mT)
    return Gaussian(np.where(well[..., None], mean, x.mean), np.where(well[..., None, None], cov, x.cov))


def _stack(x: list[Gaussian]) -> Gaussian:
    return Gaussian(np.stack([g.mean for g in x]), np.stack([g.cov for g in x]))
