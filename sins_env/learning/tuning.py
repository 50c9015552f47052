"""Tuning of a filter's noise while it runs, for a batch of runs. docs/learning.md#tuning has every formula."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from inspect import getattr_static
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sins_env import checks
from sins_env.arrays import Array, Rngs
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.learning.seeds import apart
from sins_env.types import Estimator, Task

__all__ = ["Tunable", "TuneNoiseSettings"]

Seen = NDArray[np.float32]

WORST = 10.0  #: largest error over its threshold that counts
MOST_SEEN = 10.0  #: largest size of a number that is observed
MEMORY = 10.0  #: number of intervals over which the slow statistics forget
STATISTICS = 4  #: numbers that are observed of each component of a reading


class Tunable(Estimator, Protocol):
    """What an estimator needs to be tuned beside the contract; the pipelines of ``solvers`` have it."""

    @property
    def readings(self) -> Mapping[str, int]:
        """Number of components of the readings by sensor; known after ``reset``."""
        ...

    def scale_noise(self, q: ArrayLike = 1.0, r: ArrayLike | Mapping[str, ArrayLike] = 1.0) -> None:
        """Multiply the told Q and R by factors, one or one for each run, from the next epoch on."""
        ...

    def diagnostics(self) -> dict[str, Array]:
        """Return ``<sensor>_residual`` (..., m) and ``<sensor>_covariance`` (..., m, m) of the last epoch, NaN without one."""
        ...


@dataclass(frozen=True)
class TuneNoiseSettings:
    """Settings of ``SINS/TuneNoise-v0``.

    ``task`` is a simulated task: a name, or the file or dict of a scenario. ``solver`` is the name of a filter, or a class or
    function that makes an estimator with ``readings``, ``scale_noise`` and ``diagnostics``; ``solver_settings`` is a dict for it.

    An action holds for ``interval_s`` seconds. An action a multiplies by 10^(decades a): the first component Q, the second R. With
    ``per_sensor`` there is one for the R of each sensor instead, in the order of ``readings``.

    Raises:
        ValueError: a value that is not allowed.
    """

    task: Any = "sway-told-wrong-v0"
    solver: Any = "ckf"
    solver_settings: Any = None
    interval_s: float = 1.0
    decades: float = 3.0
    per_sensor: bool = False

    def __post_init__(self) -> None:
        checks.keep(self, "interval_s", checks.number, above=0.0)
        checks.keep(self, "decades", checks.number, above=0.0, most=6.0)
        checks.keep(self, "per_sensor", checks.flag)
        if not isinstance(self.solver_settings, Mapping | None):
            raise checks.refused("solver_settings", self.solver_settings, "None, or a dict of settings of the solver")


class Tuning:
    """A batch of episodes in which actions scale the noise that a filter assumes.

    Raises:
        ValueError: a task that plays a recording, a solver that cannot be tuned, or settings that do not fit.
        FileNotFoundError: a file of the task is not there.
    """

    def __init__(self, settings: TuneNoiseSettings, rows: int) -> None:
        self.settings, self.rows = settings, rows
        self.task = get_task(settings.task)
        if self.task.windows:
            raise ValueError(f"task = {self.task.name!r}, which plays a recording; allowed: a simulated task")
        self.solver = tunable(settings.solver, settings.solver_settings)
        self.env = cast(Any, self.task.make(rows))
        public: Task = self.env.unwrapped.task
        self.every = round(settings.interval_s / public.epoch_s)
        if not 1 <= self.every <= public.num_epochs or abs(self.every * public.epoch_s - settings.interval_s) > 1e-9:
            allowed = f"a multiple of the epoch of {public.epoch_s:g} s, up to {public.duration_s:g} s"
            raise checks.refused("interval_s", settings.interval_s, allowed)
        self.solver.reset(public, [np.random.default_rng(0)] * rows, rows)
        self.sensors = dict(self.solver.readings)
        self.actions = 1 + (len(self.sensors) if settings.per_sensor else 1)
        self.size = STATISTICS * sum(self.sensors.values()) + self.actions + 1
        self.started = False

    def reset(self, rngs: Rngs) -> Seen:
        """Begin a run per generator, with a seed that no suite can have; return the first observation, (rows, size)."""
        seeds = [apart(rng.integers(0, 1 << 64, 2, dtype=np.uint64)) for rng in rngs]
        runs = [int(rng.integers(self.task.records or 1)) for rng in rngs]
        self._obs, _ = self.env.reset(seed=seeds, options=self.task.options(runs))
        self.public: Task = self.env.unwrapped.task
        self.solver.reset(self.public, [rng.spawn(1)[0] for rng in rngs], self.rows)
        self.statistics = Statistics(self.rows, sum(self.sensors.values()))
        self._k, self.started = 0, True
        return self._observation(np.zeros((self.rows, self.actions)))

    def step(self, action: Array) -> tuple[Seen, Array, bool, dict[str, Array]]:
        """Run an interval with these actions (rows, actions).

        Returns the observation, rewards (rows,), whether the episode is over, and the info.

        Raises:
            ValueError: actions of another shape, or that are not finite.
            RuntimeError: a step before the reset or after the end.
        """
        if not self.started:
            raise RuntimeError("step() before reset() or after the end of the episode: reset the environment first")
        action = np.asarray(action, dtype=float)
        if action.shape != (self.rows, self.actions) or not np.isfinite(action).all():
            raise ValueError(f"action of shape {action.shape}; allowed: finite numbers, {(self.rows, self.actions)}")
        action = np.clip(action, -1.0, 1.0)
        factors = 10.0 ** (self.settings.decades * action)
        noise = dict(zip(self.sensors, factors[:, 1:].T, strict=True)) if self.settings.per_sensor else factors[:, 1]
        self.solver.scale_noise(factors[:, 0], noise)
        ratios, epochs = np.zeros(self.rows), min(self.every, self.public.num_epochs - self._k)
        self.statistics.begin()
        for _ in range(epochs):
            self._obs, _, _, _, info = self.env.step(self.solver.step(self._obs))
            ratios += error_ratio(info["errors"]["phi"], self.task.delta)
            self.statistics.add(normalised(self.solver.diagnostics(), self.sensors, self.rows))
        self._k += epochs
        over = self._k == self.public.num_epochs
        self.started = not over
        self.statistics.end()
        return self._observation(action), -ratios / epochs, over, {"errors": info["errors"]["phi"], "factors": factors}

    def _observation(self, action: Array) -> Seen:
        t = np.full((self.rows, 1), self._k / self.public.num_epochs)
        seen = np.concatenate([self.statistics.values(), action, t], axis=1)
        return np.clip(seen, -MOST_SEEN, MOST_SEEN).astype(np.float32)


def tunable(solver: finding.Solver, settings: Mapping[str, Any] | None) -> Tunable:
    """Make an estimator that can be tuned, for batches of runs.

    Raises:
        ValueError: no such solver, settings that it refuses, or one that cannot be tuned.
    """
    made: Any = finding.make(solver, settings)
    needed = ("readings", "scale_noise", "diagnostics")
    missing = [name for name in needed if getattr_static(made, name, None) is None]  # readings are known after reset
    if missing or not made.batched:
        what = f"has no {', '.join(missing)}" if missing else "takes no batches"
        raise ValueError(
            f"solver = {finding.solver_name(solver)!r} {what}; allowed: a filter in the pipeline, such as 'ckf' or 'ekf', "
            "or an estimator with the methods of docs/learning.md#tuning"
        )
    found: Tunable = made
    return found


def error_ratio(phi: Array, delta: Array) -> Array:
    """Return the largest of the errors (rows, 3) over its threshold (3,), at most 10; below one the run is aligned."""
    found: Array = np.minimum((np.abs(phi) / delta).max(axis=1), WORST)
    return found


def normalised(told: Mapping[str, Array], sensors: Mapping[str, int], rows: int) -> Array:
    """Return innovations over their standard deviations, (rows, components); NaN where there is no reading."""
    parts = []
    for name, size in sensors.items():
        nothing = np.full((rows, size), np.nan)
        residual = told.get(f"{name}_residual", nothing)
        S = told.get(f"{name}_covariance")
        spread = nothing if S is None else np.sqrt(np.abs(np.diagonal(S, axis1=-2, axis2=-1)))
        parts.append(residual / np.where(spread > 0.0, spread, np.nan))
    return np.concatenate(parts, axis=1)


class Statistics:
    """Statistics of normalised innovations: of the last interval, and with a memory of some intervals."""

    def __init__(self, rows: int, components: int) -> None:
        nothing = np.zeros((rows, components))
        self._last = nothing.copy()  # last innovation, zero before the first
        self._mean, self._square, self._slow, self._lagged = nothing, nothing + 1.0, nothing + 1.0, nothing
        self.begin()

    def begin(self) -> None:
        """Begin an interval."""
        nothing = np.zeros_like(self._last)
        self._count, self._sum, self._sum2, self._sum11 = nothing, nothing, nothing, nothing

    def add(self, nu: Array) -> None:
        """Add normalised innovations (rows, components) of an epoch; NaN without a reading."""
        there = np.isfinite(nu)
        nu = np.where(there, np.clip(nu, -1e3, 1e3), 0.0)
        self._count, self._sum = self._count + there, self._sum + nu
        self._sum2, self._sum11 = self._sum2 + nu * nu, self._sum11 + nu * self._last
        self._last = np.where(there, nu, self._last)

    def end(self) -> None:
        """End the interval; components without a reading in it keep their statistics."""
        there, n = self._count > 0, np.maximum(self._count, 1)
        self._mean = np.where(there, self._sum / n, self._mean)
        self._square = np.where(there, self._sum2 / n, self._square)
        self._slow = np.where(there, self._slow + (self._sum2 / n - self._slow) / MEMORY, self._slow)
        self._lagged = np.where(there, self._lagged + (self._sum11 / n - self._lagged) / MEMORY, self._lagged)

    def values(self) -> Array:
        """Return mean, log10 of the mean square, the same with memory, and the correlation of neighbours, (rows, 4 components)."""
        floor = 1e-6
        logs = [np.log10(np.maximum(part, floor)) for part in (self._square, self._slow)]
        return np.concatenate([self._mean, *logs, self._lagged / np.maximum(self._slow, floor)], axis=1)
