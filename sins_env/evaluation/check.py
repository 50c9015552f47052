"""The estimator contract as named checks: what a plug-in must do to be evaluated. design.md section 4."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import Any, NamedTuple

import gymnasium
import numpy as np
from numpy.typing import NDArray

from sins_env import types
from sins_env.evaluation import registry

Array = NDArray[np.float64]
Obs = dict[str, NDArray[Any]]

RUNS, DURATION_S, COARSE_S = 3, 12.0, 6.0
TOLERANCE = 1e-9


class Check(NamedTuple):
    """One point of the contract. ``passed`` None: it does not apply, or could not be looked at."""

    name: str
    passed: bool | None
    detail: str


class _Bad(Exception):
    """What is wrong, in one line."""


class _World:
    """Observations of a few short runs, the same for every check."""

    def __init__(self, **settings: Any) -> None:
        kwargs = {"duration": DURATION_S, **settings}
        env: Any = gymnasium.make_vec("SINS/AlignSway-v0", num_envs=RUNS, **kwargs)
        obs, info = env.reset(seed=20110607)
        self.task: types.Task = env.unwrapped.task
        self.observations: list[Obs] = []
        for _ in range(self.task.num_epochs):
            self.observations.append(obs)
            obs = env.step(info["start"]["q_nb"])[0]
        env.close()

    def one(self, run: int) -> tuple[types.Task, list[Obs]]:
        """A run without a run axis."""
        start = self.task.start and types.NavState(*(part[run].copy() for part in self.task.start))
        return replace(self.task, start=start), [{n: v[run].copy() for n, v in o.items()} for o in self.observations]

    def all(self) -> tuple[types.Task, list[Obs]]:
        start = self.task.start and types.NavState(*(part.copy() for part in self.task.start))
        return replace(self.task, start=start), [{n: v.copy() for n, v in o.items()} for o in self.observations]


def _rng(run: int) -> np.random.Generator:
    return np.random.default_rng([7, run])


class _Checker:
    """Holds what the checks share; each public check's docstring is its name."""

    def __init__(self, solver: registry.Solver, settings: Mapping[str, Any] | None) -> None:
        self.solver, self.settings = solver, settings
        self.told = _World(start="told")

    def make(self) -> Any:
        return registry.make(self.solver, self.settings)

    @cached_property
    def batched(self) -> bool:
        return bool(self.make().batched)

    def drive(self, estimator: Any, task: types.Task, observations: Sequence[Obs], runs: int | None = None) -> Array:
        """Actions (K, 4), or (K, runs, 4)."""
        rng: Any = _rng(0) if runs is None else [_rng(run) for run in range(runs)]
        estimator.reset(task, rng, runs or 1)
        shape = (4,) if runs is None else (runs, 4)
        actions = []
        for k, obs in enumerate(observations, start=1):
            action = np.array(estimator.step(obs), dtype=np.float64)
            if action.shape != shape:
                raise _Bad(f"step returned shape {action.shape} at epoch {k}; allowed: {shape}")
            if not np.isfinite(action).all() or not np.any(action, axis=-1).all():
                raise _Bad(f"step returned {np.array2string(action, precision=3)} at epoch {k}: no attitude")
            actions.append(action)
        return np.array(actions)

    @cached_property
    def alone(self) -> Array:
        """Actions of run 0 on its own, (K, 4)."""
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
        """one run: actions of shape (4,), finite"""
        return f"{len(self.alone)} epochs"

    def batch(self) -> str | None:
        """a batch: actions of shape (runs, 4)"""
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

    def unknown_start(self) -> str:
        """begins without a told attitude"""
        world = _World(start="unknown", coarse=COARSE_S)
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
        """covariance, if any: (3, 3) rad^2, symmetric, positive"""
        if not hasattr(self.make(), "covariance"):
            return None
        cases: list[tuple[Any, int | None]] = [(self.told.one(0), None)]
        cases += [(self.told.all(), RUNS)] if self.batched else []
        for (task, observations), runs in cases:
            estimator = self.make()
            self.drive(estimator, task, observations, runs)
            P = np.asarray(estimator.covariance(), dtype=np.float64)
            shape = (3, 3) if runs is None else (runs, 3, 3)
            if P.shape != shape:
                raise _Bad(f"shape {P.shape}; allowed: {shape}")
            if not np.isfinite(P).all() or np.abs(P - np.swapaxes(P, -1, -2)).max() > 1e-9 * np.abs(P).max():
                raise _Bad("not finite, or not symmetric")
            if np.linalg.eigvalsh(P).min() <= 0:
                raise _Bad(f"not positive: its smallest eigenvalue is {np.linalg.eigvalsh(P).min():.3g} rad^2")
        return ""

    def _same(self, a: Array, b: Array, what: str) -> str:
        away = np.minimum(np.abs(a - b).max(axis=-1), np.abs(a + b).max(axis=-1))  # q and -q are one attitude
        if away.max() > TOLERANCE:
            k = int(np.argmax(away > TOLERANCE)) + 1
            raise _Bad(f"{what} differ by {away.max():.2g}, first at epoch {k}")
        return f"to {TOLERANCE:g}"

    def results(self) -> Iterable[Check]:
        checks: tuple[Callable[[], str | None], ...] = (
            self.members, self.single, self.batch, self.neighbours, self.deterministic, self.reusable,
            self.untouched, self.global_random, self.without_fixes, self.unknown_start, self.picklable,
            self.covariance,
        )  # fmt: skip
        for check in checks:
            name = (check.__doc__ or "").strip()
            try:
                detail = check()
                yield Check(name, None if detail is None else True, "does not apply" if detail is None else detail)
            except _Bad as error:
                yield Check(name, False, str(error))
            except Exception as error:
                yield Check(name, False, f"raised {type(error).__name__}: {' '.join(str(error).split())}")


def check_estimator(
    solver: registry.Solver,
    settings: Mapping[str, Any] | None = None,
    on_check: Callable[[Check], None] | None = None,
) -> list[Check]:
    """Hold an estimator against the contract; ``all(check.passed is not False for check in ...)`` is a pass.

    Args:
        solver: a factory, a name, or ``module:Factory``.
        on_check: called as each check ends.

    Raises:
        ValueError: there is no such solver, it refuses the settings, or it lacks ``batched``, ``reset`` or
        ``step``.
    """
    registry.make(solver, settings)
    out = []
    for check in _Checker(solver, settings).results():
        out.append(check)
        if on_check:
            on_check(check)
    return out
