"""Fixed-interval smoothing of a whole alignment or navigation: what every epoch was, seen from the end.

Idea: the pipeline runs as always, around a filter that keeps its steps and its resets (:class:`solvers.smoothing.Recorder`).
Beside it the INS and the biases fed back so far are kept at each epoch. Going back, Rauch, Tung and Striebel's recursion gives the
errors of this INS from all fixes. Each reset is undone on the way, for it changed what the errors are of.

Lever arms, gaps, outages and fixes with parts missing need no care of their own, because the filter took them as they came.
In an outage nothing is fed back. The smoothed track through it is held at both ends.

Source: Rauch, Tung & Striebel (1965), doi:10.2514/3.3166; docs/mathematics/filters.md#smoothing-a-navigation.
Filters: those of :mod:`solvers.smoothing`, with Euler or invariant errors, open or closed loop.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.states import Layout
from sins_env.types import NavState, Observation, Rng, Task
from solvers.pipeline.integration import Integration
from solvers.smoothing import Recorder
from solvers.types import Gaussian, Health


@dataclass(frozen=True)
class Track:
    """States of the INS at the ends of T epochs, each with the covariance of its errors; ``...`` is the batch.

    Rows of runs that had not begun yet, for want of a first fix, are NaN.
    """

    t: Array  #: (T,) s, ends of the epochs
    nav: NavState  #: attitude (T, ..., 4), velocity (T, ..., 3) m/s, position (T, ..., 3) rad, rad, m
    gyro_bias: Array  #: (T, ..., 3) rad/s
    accel_bias: Array  #: (T, ..., 3) m/s^2; (T, ..., 2) in an alignment with ten states
    cov: Array  #: (T, ..., n, n) of the errors left, in SI units, in the order of ``states``
    states: Layout  #: blocks of the errors by name, such as ``states["phi"]`` and ``states["gyro_bias"]``

    def __repr__(self) -> str:
        return f"<Track of {len(self.t)} epochs, {self.cov.shape[-1]} states>"


@dataclass(frozen=True)
class Smoothed:
    """A smoothed track, and beside it what the filter had said at the time."""

    smoothed: Track
    filtered: Track


class Smoother:
    """The pipeline around a filter, and afterwards the smoothed track of the episode.

    It is an estimator, which answers at each epoch what its pipeline does. ``smoothed()`` may be called at any time, for the
    epochs so far. It begins with the fine phase, because a coarse phase has no filter. Memory grows with the number of epochs,
    by about 3 n^2 numbers per epoch and run: 6 kB with 15 states.

    Raises:
        ValueError: the estimator is no pipeline around a filter, or its filter cannot be smoothed.
    """

    def __init__(self, estimator: Any) -> None:
        if not isinstance(getattr(estimator, "running", None), Integration):
            allowed = "a pipeline around a filter, such as solvers.make('ekf') or solvers.make('inekf')"
            raise ValueError(f"{estimator!r} cannot be smoothed; allowed: {allowed}")
        self._recorder = Recorder(estimator.filter)
        self._pipeline = type(estimator)(self._recorder, **vars(estimator.settings))
        self.batched = self._pipeline.batched

    def __repr__(self) -> str:
        return f"Smoother({self._pipeline!r})"

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        """Begin an episode; see the pipeline's ``reset``."""
        self._pipeline.reset(task, rng, num_runs)
        self._recorder.passed.clear()
        self._kept: list[_Kept] = []

    def step(self, obs: Observation) -> Array:
        """Return the answer of the pipeline at the end of the epoch, which no later fix has improved."""
        answer = self._pipeline.step(obs)
        running = self._running
        if running.ins is not None:
            nav = running.ins.nav
            zero, begun = np.zeros(nav.vel.shape), np.broadcast_to(running.begun, nav.vel.shape[:-1])
            gyro, accel = (zero, zero) if running.bias is None else running.bias
            self._kept.append(_Kept(float(np.ravel(obs["t"])[0]), nav, gyro, accel, begun))
        return answer

    def covariance(self) -> Array:
        """Return the covariance of the answer."""
        return self._pipeline.covariance()

    def health(self) -> Health | None:
        """Return repairs and failures of each run so far; None in the coarse phase."""
        return self._pipeline.health()

    def diagnostics(self) -> dict[str, Array]:
        """Return what the filter knew beside its answer, by name."""
        return self._pipeline.diagnostics()

    def smoothed(self) -> Smoothed:
        """Return the track of the fine phase so far, smoothed, and the filter's own.

        Raises:
            RuntimeError: no fine phase has begun.
        """
        if not getattr(self, "_kept", None):
            raise RuntimeError(
                f"{self!r} has nothing to smooth yet; call reset(task, rng), and step(obs) into the fine phase"
            )
        last = self._recorder.estimate(self._running.belief)
        later = [last, *(x for x, _ in self._recorder.backward(last))][: len(self._kept)]
        then = [*(step.x for step in self._recorder.passed), last][-len(self._kept) :]
        return Smoothed(self._track(later[::-1]), self._track(then))

    @property
    def _running(self) -> Integration:
        running: Integration = self._pipeline.running
        return running

    def _track(self, estimates: list[Gaussian]) -> Track:
        """Return the states of the INS without the errors that were estimated of them, one for each epoch kept."""
        kept, states = self._kept, self._running.states
        nav = NavState(*(np.stack(parts) for parts in zip(*(one.nav for one in kept), strict=True)))
        x = Gaussian(np.stack([x.mean for x in estimates]), np.stack([x.cov for x in estimates]))
        nav, errors, P = self._running.solution(x, nav)
        begun = np.stack([one.begun for one in kept])[..., None]
        per_sample = self._running.task.epoch_s / self._running.task.n_sub
        biases = []
        for name, fed in (("gyro_bias", [one.gyro for one in kept]), ("accel_bias", [one.accel for one in kept])):
            bias = errors[..., states[name]] * states.si[states[name]]
            biases.append(bias + np.stack(fed)[..., : bias.shape[-1]] / per_sample)
        nav = NavState(*(np.where(begun, part, np.nan) for part in nav))
        gyro, accel = (np.where(begun, bias, np.nan) for bias in biases)
        P = np.where(begun[..., None], P * np.outer(states.si, states.si), np.nan)
        return Track(np.array([one.t for one in kept]), nav, gyro, accel, P, states)


@dataclass(frozen=True)
class _Kept:
    """What an epoch leaves beside the filter's step."""

    t: float  #: s
    nav: NavState  #: state of the INS after the reset
    gyro: Array  #: (..., 3) rad, bias of the gyros fed back so far, per increment
    accel: Array  #: (..., 3) m/s, the same of the accelerometers
    begun: Mask  #: (...), whether the run has had its first fix, if it waits for it


def smooth_navigation(estimator: Any, env: Any, *, seed: Any = None, options: dict[str, Any] | None = None) -> Smoothed:
    """Play one episode of an environment to its end, and return its smoothed track.

    A recording is played by ``SINS/Replay-v0``, an own log epoch by epoch by :class:`Smoother`.

    Args:
        estimator: a pipeline around a filter, such as ``solvers.make("inekf")``.
        env: an environment of this package, single or vector, which is reset with ``seed`` and ``options``.
        seed: seed of the reset.
        options: options of the reset.

    Raises:
        ValueError: the estimator cannot be smoothed, or the reset is refused.
    """
    smoother = Smoother(estimator)
    obs, _ = env.reset(seed=seed, options=options)
    runs = getattr(env.unwrapped, "num_envs", 1)
    smoother.reset(
        env.unwrapped.task, [np.random.default_rng(run) for run in range(runs)], runs
    )  # no such filter draws
    over = False
    while not over:
        obs, _, terminated, truncated, _ = env.step(smoother.step(obs))
        over = bool(np.all(np.logical_or(terminated, truncated)))
    return smoother.smoothed()
