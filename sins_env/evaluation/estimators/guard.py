"""The border between the evaluation and an estimator: anything that it raises or returns has a defined outcome."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from sins_env import types
from sins_env.arrays import Array, Obs
from sins_env.states import answered

Clock = Callable[[], float]
Health = tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]
MAX_TRACEBACK = 4000  #: most characters of a traceback, counted from its end
MAX_MESSAGE = 1000  #: most characters of a message


class EstimatorError(Exception):
    """Error of an estimator that raised an exception, returned no action, took too long, or ended its process.

    ``__cause__`` is its own exception; ``trace`` is its traceback if that happened in another process. ``ended`` tells how
    its process ended, and is empty if it did not.
    """

    trace = ""
    ended = ""
    late = False  #: whether the call took too long
    raised = False  #: whether ``__cause__`` is an exception of the estimator's own

    @property
    def text(self) -> str:
        """Traceback of the estimator's exception; the message if there is none."""
        cause = self.__cause__
        return self.trace or (_traceback(cause) if cause else str(self))


class Unavailable(EstimatorError):
    """Error of an estimator that cannot be made, so that no run of it can be played."""


class Refusal(Unavailable, ValueError):
    """Error of wrong use: a solver that is not there, or settings that do not fit."""


def line(error: BaseException) -> str:
    """Return type and message of any exception in one short line, even if it refuses to tell its message."""
    try:
        said = " ".join(str(error)[: 2 * MAX_MESSAGE].split())[:MAX_MESSAGE]
    except BaseException as second:
        said = f"(its message raises {type(second).__name__})"
    return f"{type(error).__name__[:MAX_MESSAGE]}: {said}".removesuffix(": ")


def _traceback(error: BaseException) -> str:
    try:
        return "".join(traceback.format_exception(error))[-MAX_TRACEBACK:]
    except BaseException as second:  # nested too deeply, for one
        return f"{line(error)} (its traceback raises {type(second).__name__})"


def error_of(name: str, error: BaseException) -> EstimatorError:
    """Return the error of an estimator whose method ``name`` raised an exception."""
    found = EstimatorError(f"{name} raised {line(error)}")
    found.raised, found.__cause__ = True, error
    return found


class Guarded(Protocol):
    """Interface of an estimator to the loop, in whichever process it is. A run axis leads, even for a single run."""

    num_runs: int
    clock: Clock
    seconds: float  #: time of all steps since the guard was made, by the clock
    steps: int

    @property
    def told_s(self) -> float:
        """Time of all steps without the way to another process and back, as that process tells."""
        ...

    def reset(self, task: types.Task, rngs: Sequence[np.random.Generator]) -> None:
        """Begin the runs, each with its own generator.

        Raises:
            EstimatorError: the estimator failed.
        """
        ...

    def step(self, obs: Obs) -> Array:
        """Return the action, (R, 4), or (R, 10) in navigation; only the estimator's own time is counted.

        Raises:
            EstimatorError: the estimator failed.
        """
        ...

    def covariance(self) -> Array | None:
        """Return the covariance, (R, 3, 3) rad^2, or (R, 9, 9) in navigation; None if the estimator has none.

        Raises:
            EstimatorError: the estimator failed.
        """
        ...

    def diagnostics(self) -> dict[str, Array]:
        """Return what the estimator knows beside its answers, by name, with the run axis in front; only arrays of numbers.

        Raises:
            EstimatorError: the estimator failed.
        """
        ...

    def health(self) -> Health:
        """Return per run the covariance repairs, the fallbacks, and the epoch at which it froze, or -1.

        Raises:
            EstimatorError: the estimator failed.
        """
        ...


class Guard:
    """An estimator whose exceptions and malformed returns become :class:`EstimatorError`, with a clock.

    Args:
        estimator: estimator to call.
        num_runs: number of runs.
        batched: whether it is called with a run axis; None asks the estimator. A batched one takes single runs, too.
        clock: clock that times its steps; ``time.process_time`` counts CPU time.
    """

    def __init__(
        self, estimator: Any, num_runs: int, batched: bool | None = None, clock: Clock = time.perf_counter
    ) -> None:
        self.estimator, self.num_runs, self.clock = estimator, num_runs, clock
        self.batched = bool(estimator.batched) if batched is None else batched
        self.seconds, self.steps = 0.0, 0
        self.navigate = False  #: what the task of the last reset asks for

    @property
    def told_s(self) -> float:
        return self.seconds

    def _call(self, name: str, *args: Any) -> Any:
        try:
            with np.errstate():  # what it sets with numpy.seterr is its own
                return getattr(self.estimator, name)(*args)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            raise error_of(name, error) from error

    def offers(self, name: str) -> bool:
        try:
            return hasattr(self.estimator, name)
        except (Exception, SystemExit) as error:
            raise error_of(name, error) from error

    def reset(self, task: types.Task, rngs: Sequence[np.random.Generator]) -> None:
        self.navigate = task.navigate
        if self.batched:
            self._call("reset", task, rngs, self.num_runs)
        else:
            start = task.start and types.NavState(*(part[0] for part in task.start))
            self._call("reset", replace(task, start=start), rngs[0], 1)

    def step(self, obs: Obs) -> Array:
        if not self.batched:
            obs = {name: value[0] for name, value in obs.items()}
        begin = self.clock()
        action = self._call("step", obs)
        self.seconds += self.clock() - begin
        self.steps += 1
        return self._array("step", action, 10 if self.navigate else 4)

    def covariance(self) -> Array | None:
        n = answered(self.navigate).size
        return self._array("covariance", self._call("covariance"), n, n) if self.offers("covariance") else None

    def diagnostics(self) -> dict[str, Array]:
        found = self._call("diagnostics") if self.offers("diagnostics") else {}
        try:
            arrays = {str(name): np.asarray(value) for name, value in found.items()}
        except Exception as error:
            raise EstimatorError(f"diagnostics returned {line(error)}; allowed: a dict of arrays by name") from error
        rows = {name: value if self.batched else value[None] for name, value in arrays.items()}
        return {
            name: np.array(value, dtype=np.float64)
            for name, value in rows.items()
            if value.dtype.kind in "biuf" and value.ndim and len(value) == self.num_runs
        }

    def _array(self, name: str, value: Any, *shape: int) -> Array:
        """Return a copy as float64, for an estimator may use its buffer again."""
        expected = (self.num_runs, *shape) if self.batched else shape
        given = None
        try:
            given = np.asarray(value)
            if given.dtype.kind not in ("biufO" if given.ndim else "biuf"):
                raise TypeError("text, complex numbers, times, records or None are no real numbers")
            fits = given.shape == expected  # before it is copied: a broadcast array may be larger than any memory
            array = np.array(given, dtype=np.float64) if fits else given
        except Exception as error:
            what = "None" if value is None else f"a {type(value).__name__}"
            of = f" of {given.dtype}" if given is not None and given.ndim else ""
            raise EstimatorError(f"{name} returned {what}{of}; allowed: shape {expected}") from error
        if not fits:
            raise EstimatorError(f"{name} returned shape {given.shape}; allowed: {expected}")
        return array.reshape(self.num_runs, *shape)

    def smoothed(self) -> Any:
        """Return the smoothed track of a smoother: states at the ends of epochs with the run axis second, and covariances."""
        return self._call("smoothed").smoothed

    def health(self) -> Health:
        if not self.offers("health"):
            none = np.zeros(self.num_runs, dtype=np.int64)
            return none, none, none - 1
        health = self._call("health")
        try:
            repairs, fallbacks, frozen = (
                np.broadcast_to(_counts(value), (self.num_runs,))
                for value in (health.repairs, getattr(health, "fallbacks", 0), health.failed_at)
            )
        except Exception as error:
            raise EstimatorError(f"health returned {type(health).__name__} without repairs and failed_at") from error
        return checked_health(repairs, fallbacks, frozen)


def checked_health(repairs: NDArray[np.int64], fallbacks: NDArray[np.int64], frozen: NDArray[np.int64]) -> Health:
    """Return the health of an estimator.

    Raises:
        EstimatorError: a count that cannot be.
    """
    if min(repairs.min(), fallbacks.min(), frozen.min() + 1) < 0:
        raise EstimatorError("health returned a negative count; allowed: counts from 0 on, and failed_at from -1 on")
    return repairs, fallbacks, frozen


def _counts(value: Any) -> NDArray[np.int64]:
    """Return whole numbers as int64.

    Raises:
        ValueError: anything else, also NaN, which NumPy would make a number.
    """
    given = np.asarray(value)
    if given.dtype.kind not in "biuf":
        raise ValueError("no real numbers")
    if given.dtype.kind == "f":
        with np.errstate(over="ignore"):
            given = given.astype(np.float64)
        if not (np.abs(given) < 2.0**62).all():
            raise ValueError("not finite, or too large")
    return given.astype(np.int64)
