"""The points of the estimator contract, each with the advice for an estimator that breaks it.

See docs/tasks_and_scores.md#estimator-contract.
"""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sins_env import types
from sins_env.arrays import Array, Obs
from sins_env.evaluation.contract.told import ALIGNMENT, COARSE_S, RUNS, UNKNOWN_START, Playback, Told
from sins_env.evaluation.estimators import finding, guard
from sins_env.evaluation.estimators.guard import EstimatorError, Guard
from sins_env.evaluation.play.loop import Loop
from sins_env.states import answered

TOLERANCE = 1e-9  #: tolerance of a unit quaternion, of m/s and of rad; it is relative for a height above a metre


class Check(NamedTuple):
    """Result of one point of the contract."""

    name: str
    passed: bool | None  #: None if it does not apply, or could not be checked
    detail: str  #: a remark, or what is wrong and what to do


class Bad(Exception):
    """Breach of the contract, in one line."""


class Point(NamedTuple):
    """Point of the contract; its texts may name the Checker's width, errors and action."""

    name: str
    advice: str  #: what to do if it fails
    check: Callable[[Checker], str | None]  #: returns a remark, or None if it does not apply; raises Bad


POINTS: list[Point] = []  #: all points, in the order in which they are checked


def _point(name: str, advice: str) -> Callable[[Callable[[Checker], str | None]], Callable[[Checker], str | None]]:
    def add(check: Callable[[Checker], str | None]) -> Callable[[Checker], str | None]:
        POINTS.append(Point(name, advice, check))
        return check

    return add


class Checker:
    """The points applied to a solver in one kind of task.

    Args:
        tolerance: largest difference of results that must be the same; float32 needs about 1e-6.
        world: settings of the environment whose runs the solver is told.
    """

    def __init__(
        self,
        solver: finding.Solver,
        settings: Mapping[str, Any] | None = None,
        tolerance: float = TOLERANCE,
        world: Mapping[str, Any] = ALIGNMENT,
    ) -> None:
        self.solver, self.settings, self.tolerance = solver, settings, tolerance
        self.told = Told(**world)
        navigate = self.told.task.navigate
        self.width, self.errors = 10 if navigate else 4, answered(navigate).size
        self.action = "q_nb, v_n, latitude, longitude and height" if navigate else "q_nb, scalar first"

    def make(self) -> Any:
        """Make a new estimator."""
        return finding.make(self.solver, self.settings)

    def results(self) -> Iterator[Check]:
        """Yield the result of each point; after a run has failed, the others are not checked."""
        one_run = True
        for name, advice, check in POINTS:
            title, to_do = (
                text.format(width=self.width, errors=self.errors, action=self.action) for text in (name, advice)
            )
            if not one_run:
                yield Check(title, None, "not looked at: a run fails")
                continue
            try:
                detail = check(self)
                yield Check(title, None if detail is None else True, "does not apply" if detail is None else detail)
                continue
            except Bad as error:
                yield Check(title, False, f"{error}; {to_do}")
            except Exception as error:
                yield Check(title, False, f"{type(error).__name__}: {' '.join(str(error).split())}; {to_do}")
            one_run = check is not Checker.single

    def refusal(self) -> str:
        """Return why the estimator is not for tasks of this kind; empty if its first action has the right width."""
        loop = _loop(self.make(), self.told.run(0))
        try:
            next(loop)
        except EstimatorError as error:
            return _said(error, loop)
        return ""

    def drive(self, estimator: Any, playback: Playback, batched: bool = False) -> Array:
        """Play an estimator and return its actions, (K, R, width); one that is not ``batched`` gets no run axis.

        Raises:
            Bad: an action that the contract does not allow.
        """
        return _play(_loop(estimator, playback, batched))

    @cached_property
    def batched(self) -> bool:
        """Whether the estimator takes a run axis."""
        return bool(self.make().batched)

    @cached_property
    def alone(self) -> Array:
        """Actions (K, 1, width) of run 0 on its own."""
        return self.drive(self.make(), self.told.run(0))

    def same(self, a: Array, b: Array, what: str) -> str:
        """Return the tolerance within which two results agree.

        Raises:
            Bad: they do not agree.
        """
        sign = np.where((a[..., :4] * b[..., :4]).sum(axis=-1) < 0, -1.0, 1.0)  # q and -q are one attitude
        sign = np.where(np.arange(self.width) < 4, sign[..., None], 1.0)
        away = (np.abs(a - sign * b) / np.maximum(np.abs(a), 1.0)).max(axis=(1, 2))
        if away.max() > self.tolerance:
            k = int(np.argmax(away > self.tolerance)) + 1
            raise Bad(f"{what} differ by {away.max():.2g}, first at epoch {k}; allowed: {self.tolerance:g}")
        return f"to {self.tolerance:g}"

    @_point("batched is a bool; reset and step are there", "write them as methods of the class")
    def members(self) -> str:
        """Check the members of the estimator."""
        estimator = self.make()
        for name in ("reset", "step"):
            if not callable(getattr(estimator, name)):
                raise Bad(f"{name} cannot be called")
        return f"batched = {bool(estimator.batched)}"

    @_point("one run: actions of shape ({width},), finite", "let step return {action}")
    def single(self) -> str:
        """Play one run."""
        return f"{len(self.alone)} epochs"

    @_point(
        "a batch: actions of shape (runs, {width})",
        "let step return a row for each run, or set batched = False to get one run at a time",
    )
    def batch(self) -> str | None:
        """Play several runs at once."""
        if not self.batched:
            return None
        self.drive(self.make(), self.told.play(), batched=True)
        return f"{RUNS} runs"

    @_point(
        "a run does not depend on its neighbours in the batch",
        "work each row out from its own row and its own rng alone (for float32: --tolerance 1e-6)",
    )
    def neighbours(self) -> str | None:
        """Compare a run alone with the same run in a batch."""
        if not self.batched:
            return None
        together = self.drive(self.make(), self.told.play(), batched=True)[:, :1]
        return self.same(self.alone, together, "run 0 alone and in a batch")

    @_point("the same rng gives the same result", "draw from the rng of reset, and use no clock and no global state")
    def deterministic(self) -> str:
        """Play a run twice."""
        return self.same(self.alone, self.drive(self.make(), self.told.run(0)), "two estimators with the same rng")

    @_point("reset begins anew", "set all that step changes in reset")
    def reusable(self) -> str:
        """Play a run after another one, with one estimator."""
        estimator = self.make()
        self.drive(estimator, self.told.run(1))
        again = self.drive(estimator, self.told.run(0))
        return self.same(self.alone, again, "a fresh estimator and one reset after another run")

    @_point("leaves observations and task as they were", "copy what you change: np.array(obs['dtheta'])")
    def untouched(self) -> str:
        """Compare observations and task before and after a run."""
        witness = _Witness(self.make())
        self.drive(witness, self.told.run(0))
        for k, (obs, old) in enumerate(witness.given, start=1):
            for name in obs.keys() | old.keys():
                if name not in obs or name not in old or not np.array_equal(obs[name], old[name]):
                    raise Bad(f"{name} of observation {k} was changed")
        if any((a != b).any() for a, b in witness.starts):
            raise Bad("the start in the task was changed")
        return ""

    @_point("draws from its rng only", "draw from the rng that is given to reset")
    def global_random(self) -> str:
        """Compare the state of NumPy's global generator before and after a run."""
        before: Any = np.random.get_state()  # noqa: NPY002
        self.drive(self.make(), self.told.run(0))
        after: Any = np.random.get_state()  # noqa: NPY002
        if not (np.array_equal(before[1], after[1]) and before[2] == after[2]):
            raise Bad("NumPy's global random state was used")
        return ""

    @_point("goes on without fixes", "use a fix only where obs['gps_valid'] is 1")
    def without_fixes(self) -> str:
        """Play a run with every other fix missing."""
        playback = self.told.run(0)
        for obs in playback.observations[::2]:
            obs["gps_valid"][...] = 0
            obs["gps_vel"][...] = obs["gps_pos"][...] = 0.0
        self.drive(self.make(), playback)
        return "every other one missing"

    @_point("begins without a told attitude", "task.start is None there: begin anywhere, and align in the coarse phase")
    def unknown_start(self) -> str | None:
        """Play a run without a told attitude."""
        if self.told.task.navigate:
            return None
        self.drive(self.make(), Told(**UNKNOWN_START).run(0))
        return f"{COARSE_S:g} s coarse"

    @_point("can be pickled", "keep lambdas, open files, locks and the like out of its attributes")
    def picklable(self) -> str:
        """Play a run with a pickled copy."""
        try:
            copy = pickle.loads(pickle.dumps(self.make()))
        except Exception as error:
            raise Bad(f"{type(error).__name__}: {error}") from error
        return self.same(self.alone, self.drive(copy, self.told.run(0)), "an estimator and its pickled copy")

    @_point(
        "covariance, if any: ({errors}, {errors}), symmetric, positive",
        "return that of the errors of what step returned last, or leave covariance out",
    )
    def covariance(self) -> str | None:
        """Check shape and sign of the covariance at the end of a run, and of a batch."""
        if not hasattr(self.make(), "covariance"):
            return None
        for playback, batched in ((self.told.run(0), False), *([(self.told.play(), True)] if self.batched else [])):
            loop = _loop(self.make(), playback, batched)
            _play(loop)
            try:
                P = loop.guard.covariance()
            except EstimatorError as error:
                raise Bad(str(error)) from error
            assert P is not None
            if not np.isfinite(P).all() or np.abs(P - np.swapaxes(P, -1, -2)).max() > self.tolerance * np.abs(P).max():
                raise Bad("not finite, or not symmetric")
            least = np.linalg.eigvalsh(P).min()
            if least <= 0:
                raise Bad(f"not positive: its smallest eigenvalue is {least:.3g}{'' if self.errors > 3 else ' rad^2'}")
        return ""


def _loop(estimator: Any, playback: Playback, batched: bool = False) -> Loop:
    rngs = [np.random.default_rng([7, run]) for run in range(playback.num_runs)]
    return Loop(playback, Guard(estimator, playback.num_runs, batched), playback.observations[0], rngs)


def _play(loop: Loop) -> Array:
    """Play to the end and return the actions, (K, R, width)."""
    actions = []
    try:
        for k, action, *_ in loop:
            if not np.isfinite(action).all() or not np.any(action[..., :4], axis=-1).all():
                shown = " ".join(np.array2string(action, precision=3, threshold=16).split())
                raise Bad(f"step returned {shown} at epoch {k}: no attitude; allowed: finite, and not all zero")
            actions.append(action)
    except EstimatorError as error:
        raise Bad(_said(error, loop)) from error
    return np.array(actions)


class _Witness:
    """An estimator, with all that it is given and with copies from before the estimator sees it."""

    def __init__(self, estimator: Any) -> None:
        self.estimator = estimator
        self.starts: list[tuple[Array, Array]] = []
        self.given: list[tuple[Obs, Obs]] = []

    def reset(self, task: types.Task, *more: Any) -> None:
        self.starts = [(part, part.copy()) for part in task.start or ()]
        self.estimator.reset(task, *more)

    def step(self, obs: Obs) -> Any:
        self.given.append((obs, {name: value.copy() for name, value in obs.items()}))
        return self.estimator.step(obs)


def _said(error: EstimatorError, loop: Loop) -> str:
    """Describe an error in one line, with the place of an exception, and for a wrong key the fields there are."""
    cause = error.__cause__
    if not error.raised or cause is None:
        return f"{error}, at epoch {loop.k + 1}"
    text = str(error)
    frames = traceback.extract_tb(cause.__traceback__)
    last = max((i for i, frame in enumerate(frames) if frame.filename in (guard.__file__, __file__)), default=-1)
    inside = frames[last + 1 :]
    own = [frame for frame in inside if frame.filename == inside[0].filename]  # not those of libraries that it calls
    if own:
        text += f" ({Path(own[-1].filename).name}, line {own[-1].lineno})"
    if isinstance(cause, KeyError) and cause.args and isinstance(cause.args[0], str) and cause.args[0] not in loop.obs:
        text += f"; an observation has {', '.join(loop.obs)}"
    if isinstance(cause, TypeError) and not inside:  # the call itself did not fit
        text += f"; allowed: {finding.MEMBERS['reset']} and {finding.MEMBERS['step']}"
    return text
