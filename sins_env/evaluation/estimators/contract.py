"""The estimator contract as named checks, which a plug-in must pass. docs/tasks_and_scores.md#estimator-contract."""

from __future__ import annotations

import pickle
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from sins_env import types
from sins_env.arrays import Array, Obs
from sins_env.evaluation.estimators import finding
from sins_env.states import answered

RUNS, COARSE_S = 3, 6.0
ALIGNMENT = {"id": "SINS/AlignSway-v0", "duration": 12.0, "start": "told"}
NAVIGATION = {"id": "SINS/NavFlight-v0", "duration": 5.0, "profile": "lu-gauss"}
TOLERANCE = 1e-9  #: tolerance of a unit quaternion, of m/s and of rad; it is relative for a height above a metre


class Check(NamedTuple):
    """Result of one point of the contract."""

    name: str
    passed: bool | None  #: None if it does not apply, or could not be checked
    detail: str


class _Bad(Exception):
    """Breach of the contract, in one line."""


def _raised(error: Exception, obs: Mapping[str, Any]) -> str:
    """Describe an estimator's own exception in one line, with its place, and for a wrong key the fields there are."""
    text = f"raised {type(error).__name__}: {' '.join(str(error).split())}"
    frames = traceback.extract_tb(error.__traceback__)
    last = max((i for i, frame in enumerate(frames) if frame.filename == __file__), default=-1)
    inside = frames[last + 1 :]
    own = [frame for frame in inside if frame.filename == inside[0].filename]  # not those of libraries that it calls
    if own:
        text += f" ({Path(own[-1].filename).name}, line {own[-1].lineno})"
    if isinstance(error, KeyError) and error.args and isinstance(error.args[0], str) and error.args[0] not in obs:
        text += f"; an observation has {', '.join(obs)}"
    if isinstance(error, TypeError) and not inside:  # the call itself did not fit
        text += f"; allowed: {finding.MEMBERS['reset']} and {finding.MEMBERS['step']}"
    return text


class _World:
    """Observations of a few short runs, which are the same for every check."""

    def __init__(self, **settings: Any) -> None:
        env: Any = gymnasium.make_vec(num_envs=RUNS, **settings)
        obs, info = env.reset(seed=20110607)
        self.task: types.Task = env.unwrapped.task
        start = info["start"]
        action = start["q_nb"]
        if self.task.navigate:
            action = np.concatenate([action, start["vel"], start["pos"]], axis=1)
        self.observations: list[Obs] = []
        for _ in range(self.task.num_epochs):
            self.observations.append(obs)
            obs = env.step(action)[0]
        env.close()

    def one(self, run: int) -> tuple[types.Task, list[Obs]]:
        """Return the task and observations of a run, without a run axis."""
        start = self.task.start and types.NavState(*(part[run].copy() for part in self.task.start))
        return replace(self.task, start=start), [{n: v[run].copy() for n, v in o.items()} for o in self.observations]

    def all(self) -> tuple[types.Task, list[Obs]]:
        """Return the task and observations of all runs, with a run axis."""
        start = self.task.start and types.NavState(*(part.copy() for part in self.task.start))
        return replace(self.task, start=start), [{n: v.copy() for n, v in o.items()} for o in self.observations]


def _rng(run: int) -> np.random.Generator:
    return np.random.default_rng([7, run])


class _Checker:
    """The checks and what they share. The docstring of a check is its name, which users see."""

    def __init__(
        self, solver: finding.Solver, settings: Mapping[str, Any] | None, world: Mapping[str, Any] = ALIGNMENT
    ) -> None:
        self.solver, self.settings = solver, settings
        self.told = _World(**world)
        navigate = self.told.task.navigate
        self.width, self.errors = 10 if navigate else 4, answered(navigate).size

    def make(self) -> Any:
        """Make a new estimator."""
        return finding.make(self.solver, self.settings)

    @cached_property
    def batched(self) -> bool:
        """Whether the estimator takes a run axis."""
        return bool(self.make().batched)

    def drive(self, estimator: Any, task: types.Task, observations: Sequence[Obs], runs: int | None = None) -> Array:
        """Play an estimator and return its actions, (K, width), or (K, runs, width) for several runs.

        Raises:
            _Bad: an action that the contract does not allow.
        """
        rng: Any = _rng(0) if runs is None else [_rng(run) for run in range(runs)]
        estimator.reset(task, rng, runs or 1)
        shape = (self.width,) if runs is None else (runs, self.width)
        actions = []
        for k, obs in enumerate(observations, start=1):
            given = estimator.step(obs)
            if given is None:
                raise _Bad(f"step returned None at epoch {k}; allowed: an array of shape {shape}")
            action = np.array(given, dtype=np.float64)
            if action.shape != shape:
                raise _Bad(f"step returned shape {action.shape} at epoch {k}; allowed: {shape}")
            if not np.isfinite(action).all() or not np.any(action[..., :4], axis=-1).all():
                shown = " ".join(np.array2string(action, precision=3, threshold=16).split())
                raise _Bad(f"step returned {shown} at epoch {k}: no attitude; allowed: finite, and not all zero")
            actions.append(action)
        return np.array(actions)

    def refusal(self) -> str:
        """Return why the estimator is not for tasks of this kind; empty if its first action has the right width."""
        (task, observations), estimator = self.told.one(0), self.make()
        try:
            estimator.reset(task, _rng(0), 1)
            shape = np.shape(estimator.step(observations[0]))
        except Exception as error:
            return _raised(error, observations[0])
        return "" if shape[-1:] == (self.width,) else f"step returned shape {shape}, not ({self.width},)"

    @cached_property
    def alone(self) -> Array:
        """Actions of run 0 on its own, (K, width)."""
        return self.drive(self.make(), *self.told.one(0))

    def members(self) -> str:
        """batched is a bool; reset and step are there"""
        estimator = self.make()
        if not isinstance(estimator.batched, (bool, np.bool_)):
            raise _Bad(f"batched is {estimator.batched!r}; allowed: True or False")
        for name in ("reset", "step"):
            if not callable(getattr(estimator, name)):
                raise _Bad(f"{name} cannot be called")
        return f"batched = {bool(estimator.batched)}"

    def single(self) -> str:
        """one run: actions of shape ({width},), finite"""
        return f"{len(self.alone)} epochs"

    def batch(self) -> str | None:
        """a batch: actions of shape (runs, {width})"""
        if not self.batched:
            return None
        self.drive(self.make(), *self.told.all(), runs=RUNS)
        return f"{RUNS} runs"

    def neighbours(self) -> str | None:
        """a run does not depend on its neighbours in the batch"""
        if not self.batched:
            return None
        together = self.drive(self.make(), *self.told.all(), runs=RUNS)[:, 0]
        return self._same(self.alone, together, "run 0 alone and in a batch")

    def deterministic(self) -> str:
        """the same rng gives the same result"""
        again = self.drive(self.make(), *self.told.one(0))
        return self._same(self.alone, again, "two estimators with the same rng")

    def reusable(self) -> str:
        """reset begins anew"""
        estimator = self.make()
        self.drive(estimator, *self.told.one(1))
        again = self.drive(estimator, *self.told.one(0))
        return self._same(self.alone, again, "a fresh estimator and one reset after another run")

    def untouched(self) -> str:
        """leaves observations and task as they were"""
        (task, observations), (_, before) = self.told.one(0), self.told.one(0)
        self.drive(self.make(), task, observations)
        for k, (obs, old) in enumerate(zip(observations, before, strict=True), start=1):
            for name in obs.keys() | old.keys():
                if name not in obs or name not in old or not np.array_equal(obs[name], old[name]):
                    raise _Bad(f"{name} of observation {k} was changed")
        now, told = task.start, self.told.task.start
        if now is None or told is None or any((a != b[0]).any() for a, b in zip(now, told, strict=True)):
            raise _Bad("the start in the task was changed")
        return ""

    def global_random(self) -> str:
        """draws from its rng only"""
        before: Any = np.random.get_state()  # noqa: NPY002
        self.drive(self.make(), *self.told.one(0))
        after: Any = np.random.get_state()  # noqa: NPY002
        if not (np.array_equal(before[1], after[1]) and before[2] == after[2]):
            raise _Bad("NumPy's global random state was used; allowed: the rng given to reset")
        return ""

    def without_fixes(self) -> str:
        """goes on without fixes"""
        task, observations = self.told.one(0)
        for obs in observations[::2]:
            obs["gps_valid"][...] = 0
            obs["gps_vel"][...] = obs["gps_pos"][...] = 0.0
        self.drive(self.make(), task, observations)
        return "every other one missing"

    def unknown_start(self) -> str | None:
        """begins without a told attitude"""
        if self.told.task.navigate:
            return None
        world = _World(**{**ALIGNMENT, "start": "unknown", "coarse": COARSE_S})
        self.drive(self.make(), *world.one(0))
        return f"{COARSE_S:g} s coarse"

    def picklable(self) -> str:
        """can be pickled"""
        try:
            copy = pickle.loads(pickle.dumps(self.make()))
        except Exception as error:
            raise _Bad(f"{type(error).__name__}: {error}") from error
        return self._same(self.alone, self.drive(copy, *self.told.one(0)), "an estimator and its pickled copy")

    def covariance(self) -> str | None:
        """covariance, if any: ({errors}, {errors}), symmetric, positive"""
        if not hasattr(self.make(), "covariance"):
            return None
        cases: list[tuple[Any, int | None]] = [(self.told.one(0), None)]
        cases += [(self.told.all(), RUNS)] if self.batched else []
        for (task, observations), runs in cases:
            estimator = self.make()
            self.drive(estimator, task, observations, runs)
            P = np.asarray(estimator.covariance(), dtype=np.float64)
            shape = (self.errors,) * 2 if runs is None else (runs, self.errors, self.errors)
            if P.shape != shape:
                raise _Bad(f"shape {P.shape}; allowed: {shape}")
            if not np.isfinite(P).all() or np.abs(P - np.swapaxes(P, -1, -2)).max() > 1e-9 * np.abs(P).max():
                raise _Bad("not finite, or not symmetric")
            least = np.linalg.eigvalsh(P).min()
            if least <= 0:
                raise _Bad(f"not positive: its smallest eigenvalue is {least:.3g}{'' if self.errors > 3 else ' rad^2'}")
        return ""

    def _same(self, a: Array, b: Array, what: str) -> str:
        sign = np.where((a[..., :4] * b[..., :4]).sum(axis=-1) < 0, -1.0, 1.0)  # q and -q are one attitude
        sign = np.where(np.arange(self.width) < 4, sign[..., None], 1.0)
        away = (np.abs(a - sign * b) / np.maximum(np.abs(a), 1.0)).max(axis=-1)
        if away.max() > TOLERANCE:
            k = int(np.argmax(away > TOLERANCE)) + 1
            raise _Bad(f"{what} differ by {away.max():.2g}, first at epoch {k}")
        return f"to {TOLERANCE:g}"

    def results(self) -> Iterable[Check]:
        """Yield the result of each check; after a run has failed, the others are not checked."""
        checks: tuple[Callable[[], str | None], ...] = (
            self.members, self.single, self.batch, self.neighbours, self.deterministic, self.reusable,
            self.untouched, self.global_random, self.without_fixes, self.unknown_start, self.picklable,
            self.covariance,
        )  # fmt: skip
        one_run = True
        for check in checks:
            name = (check.__doc__ or "").strip().format(width=self.width, errors=self.errors)
            if not one_run:  # the others would only repeat why
                yield Check(name, None, "not looked at: a run fails")
                continue
            try:
                detail = check()
                yield Check(name, None if detail is None else True, "does not apply" if detail is None else detail)
                continue
            except _Bad as error:
                yield Check(name, False, str(error))
            except Exception as error:
                yield Check(name, False, _raised(error, self.told.observations[0]))
            one_run = check != self.single


def check_estimator(
    solver: finding.Solver,
    settings: Mapping[str, Any] | None = None,
    on_check: Callable[[Check], None] | None = None,
) -> list[Check]:
    """Check an estimator by the contract; it keeps it if ``all(check.passed is not False for check in ...)``.

    The contract is that of alignment, of navigation, or both, whichever tasks the estimator answers.

    Args:
        solver: a factory, a name, or ``module:Factory``.
        settings: settings of the solver.
        on_check: function called with the result of each check when it ends.

    Raises:
        ValueError: no such solver, settings that it refuses, or an estimator without ``batched``, ``reset`` or ``step``.
    """
    finding.make(solver, settings)
    out = []
    for check in _both(solver, settings):
        out.append(check)
        if on_check:
            on_check(check)
    return out


def _both(solver: finding.Solver, settings: Mapping[str, Any] | None) -> Iterator[Check]:
    alignment, navigation = (_Checker(solver, settings, world) for world in (ALIGNMENT, NAVIGATION))
    not_navigating = navigation.refusal()
    if not not_navigating and (reason := alignment.refusal()):
        yield Check("alignment", None, f"does not apply: it navigates only ({reason})")
    else:
        yield from alignment.results()
    if not_navigating:
        yield Check("navigation", None, f"does not apply ({not_navigating})")
        return
    for check in navigation.results():
        yield check._replace(name=f"navigation: {check.name}")
