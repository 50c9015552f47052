"""Checker of one solver: it plays the solver on what is told, and compares what comes back."""

from __future__ import annotations

import traceback
from collections.abc import Mapping
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from sins_env import types
from sins_env.arrays import Array, Obs
from sins_env.evaluation.contract.told import ALIGNMENT, Playback, Told
from sins_env.evaluation.estimators import finding, guard
from sins_env.evaluation.estimators.guard import EstimatorError, Guard
from sins_env.evaluation.estimators.serving import beat
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


class Checker:
    """A solver, and what it is told in one kind of task.

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

    def refusal(self) -> str:
        """Return why the estimator is not for tasks of this kind; empty if its first action has the right width."""
        loop = loop_of(self.make(), self.told.run(0))
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
        return play(loop_of(estimator, playback, batched))

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


def loop_of(estimator: Any, playback: Playback, batched: bool = False) -> Loop:
    """Return the play loop over recorded runs; an estimator that is not ``batched`` gets no run axis."""
    rngs = [np.random.default_rng([7, run]) for run in range(playback.num_runs)]
    return Loop(playback, Guard(estimator, playback.num_runs, batched), playback.observations[0], rngs)


def play(loop: Loop) -> Array:
    """Play to the end and return the actions, (K, R, width)."""
    actions = []
    try:
        for k, action, *_ in loop:
            beat()
            if not np.isfinite(action).all() or not np.any(action[..., :4], axis=-1).all():
                shown = " ".join(np.array2string(action, precision=3, threshold=16).split())
                raise Bad(f"step returned {shown} at epoch {k}: no attitude; allowed: finite, and not all zero")
            actions.append(action)
    except EstimatorError as error:
        raise Bad(_said(error, loop)) from error
    return np.array(actions)


class Witness:
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
