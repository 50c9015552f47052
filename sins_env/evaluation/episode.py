"""Playing runs: one estimator against the vector environment, in lockstep, and what becomes of failures.

The estimator gets observations and the public Task only. An exception is a failed run with its traceback on
record; if a batched estimator raises, its batch is halved until the runs at fault stand alone, so that the
others keep their scores.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, types
from sins_env.envs.episode import failed_epochs
from sins_env.evaluation import registry
from sins_env.evaluation.scoring import Criteria, Records, Scorer, nees
from sins_env.evaluation.tasks import EvaluationTask, get_task, is_scored, run_numbers, solver_rng

Array = NDArray[np.float64]
Tick = Callable[[int], None]  #: run-epochs done so far
#: k, phi (R, 3) rad, sigma (R, 3) rad or None; called after each epoch
Observer = Callable[[int, Array, Array | None], None]

BLOCK_EPOCHS = 100  #: errors are scored in blocks of so many epochs
MAX_TRACEBACK = 6000  #: characters kept


@dataclass(frozen=True)
class Job:
    """Some runs of one solver on one task: all that a worker needs, picklable."""

    task: EvaluationTask
    solver: registry.Solver
    runs: tuple[int, ...]
    settings: dict[str, Any] = field(default_factory=dict)
    suite_seed: int | None = None

    def rngs(self) -> list[np.random.Generator]:
        name = registry.solver_name(self.solver)
        return [solver_rng(self.task, name, run, self.suite_seed) for run in self.runs]


class EstimatorError(Exception):
    """An estimator raised, or returned what is no action; ``__cause__`` is its own exception."""


class Guard:
    """An estimator whose exceptions and malformed returns become :class:`EstimatorError`, with a clock."""

    def __init__(self, estimator: Any, num_runs: int) -> None:
        self.estimator, self.num_runs = estimator, num_runs
        self.batched = bool(estimator.batched)
        self.seconds, self.steps = 0.0, 0

    def _call(self, name: str, *args: Any) -> Any:
        try:
            return getattr(self.estimator, name)(*args)
        except (Exception, SystemExit) as error:
            raise EstimatorError(f"{name} raised {type(error).__name__}: {' '.join(str(error).split())}") from error

    def reset(self, task: types.Task, rngs: Sequence[np.random.Generator]) -> None:
        if self.batched:
            self._call("reset", task, rngs, self.num_runs)
        else:
            start = task.start and types.NavState(*(part[0] for part in task.start))
            self._call("reset", replace(task, start=start), rngs[0], 1)

    def step(self, obs: Any) -> Array:
        """(R, 4); only the estimator's own time is counted."""
        if not self.batched:
            obs = {name: value[0] for name, value in obs.items()}
        begin = time.perf_counter()
        action = self._call("step", obs)
        self.seconds += time.perf_counter() - begin
        self.steps += 1
        return self._array("step", action, 4)

    def covariance(self) -> Array | None:
        """(R, 3, 3) rad^2, or None where the estimator has none."""
        if not hasattr(self.estimator, "covariance"):
            return None
        return self._array("covariance", self._call("covariance"), 3, 3)

    def _array(self, name: str, value: Any, *shape: int) -> Array:
        expected = (self.num_runs, *shape) if self.batched else shape
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError) as error:
            raise EstimatorError(f"{name} returned a {type(value).__name__}; allowed: shape {expected}") from error
        if array.shape != expected:
            raise EstimatorError(f"{name} returned shape {array.shape}; allowed: {expected}")
        return array.reshape(self.num_runs, *shape)

    def health(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Covariance repairs, fallbacks, and the epoch at which each run froze (-1: none), where they are reported."""
        if not hasattr(self.estimator, "health"):
            none = np.zeros(self.num_runs, dtype=np.int64)
            return none, none, none - 1
        health = self._call("health")
        try:
            repairs, fallbacks, frozen = (
                np.broadcast_to(np.asarray(value, dtype=np.int64), (self.num_runs,))
                for value in (health.repairs, getattr(health, "fallbacks", 0), health.failed_at)
            )
        except (AttributeError, TypeError, ValueError) as error:
            raise EstimatorError(f"health returned {type(health).__name__} without repairs and failed_at") from error
        return repairs, fallbacks, frozen


def run_job(job: Job, tick: Tick | None = None) -> Records:
    """Play the runs of a job and score them.

    Raises:
        ValueError, FileNotFoundError: settings of the task or the solver that do not fit. Never what an
            estimator raises while it runs: that is on record.
    """
    done = _Counter(tick)
    estimator = registry.make(job.solver, job.settings)
    parts = [job.runs] if estimator.batched else [(run,) for run in job.runs]
    return Records.concat([_play_or_split(replace(job, runs=runs), estimator, done) for runs in parts])


class _Counter:
    """Run-epochs done, for the progress display."""

    def __init__(self, tick: Tick | None) -> None:
        self.tick, self.total = tick, 0

    def __call__(self, count: int) -> None:
        self.total += count
        if self.tick:
            self.tick(self.total)


def _play_or_split(job: Job, estimator: Any, done: _Counter) -> Records:
    """Play a batch; where its estimator raises, halve it (and make it afresh, its state is unknown)."""
    before = done.total
    try:
        return play(job, estimator, done)
    except EstimatorError:
        done.total = before
        middle = len(job.runs) // 2
        halves = [replace(job, runs=runs) for runs in (job.runs[:middle], job.runs[middle:])]
        return Records.concat([_play_or_split(h, registry.make(job.solver, job.settings), done) for h in halves])


def play(job: Job, estimator: Any, done: Tick | None = None, observer: Observer | None = None) -> Records:
    """One batch from the first observation to the last step.

    Raises:
        EstimatorError: the estimator failed in a batch of several runs; with one run it is on record instead.
    """
    runs = len(job.runs)
    env = job.task.make(runs)
    obs, _ = job.task.reset(env, job.runs, job.suite_seed)
    public: types.Task = env.unwrapped.task  # type: ignore[attr-defined]
    criteria = Criteria.of(job.task, public, is_scored(env))
    guard, scorer = Guard(estimator, runs), Scorer(criteria, runs)
    ask = {epoch: i for i, epoch in enumerate(criteria.nees_epochs)}
    block, failed = np.empty((runs, BLOCK_EPOCHS, 3)), np.zeros((runs, BLOCK_EPOCHS), dtype=bool)
    action, in_block = np.full((runs, 4), np.nan), 0
    unknown = np.full((runs, 3), np.nan)
    outcome: dict[str, Any] = {}
    try:
        guard.reset(public, job.rngs())
        for k in range(1, criteria.num_epochs + 1):
            action = guard.step(obs)
            P = guard.covariance() if k in ask or (observer and criteria.known_start) else None
            obs, _, _, _, info = env.step(action)
            phi = info["errors"]["phi"] if criteria.scored else unknown
            block[:, in_block], failed[:, in_block] = phi, info["failed"]
            in_block += 1
            if k in ask and P is not None:
                scorer.nees[:, ask[k]] = nees(phi, P)
            if observer:
                observer(k, phi, None if P is None else np.sqrt(np.abs(np.diagonal(P, axis1=-2, axis2=-1))))
            if in_block == BLOCK_EPOCHS or k == criteria.num_epochs:
                scorer.add(block[:, :in_block], failed[:, :in_block])
                if done:
                    done(runs * in_block)
                in_block = 0
        outcome["repairs"], outcome["fallbacks"], frozen = guard.health()
    except EstimatorError as error:
        if runs > 1:
            raise
        frozen = np.full(1, -1)
        action = np.full((1, 4), np.nan)  # its heading is none
        at = (scorer.k + in_block + 1) * criteria.epoch_s
        outcome |= {
            "status": np.array(["raised"]),
            "reason": (f"{error}, at {min(at, criteria.duration_s):.1f} s",),
        }
        outcome["traceback"] = (_text(error),)
        if in_block:
            scorer.add(block[:, :in_block], failed[:, :in_block])
        scorer.fill()
    finally:
        env.close()
    outcome |= {
        "heading": _heading(action),
        "step_s": np.full(runs, guard.seconds / (runs * max(guard.steps, 1))),
    }
    return _with_frozen(scorer.records(job.runs, **outcome), frozen)


def _text(error: EstimatorError) -> str:
    cause = error.__cause__
    return "".join(traceback.format_exception(cause))[-MAX_TRACEBACK:] if cause else str(error)


def _heading(action: Array) -> Array:
    """(R,) rad of the last actions; NaN where they are no attitude."""
    q = np.where(failed_epochs(action)[:, None], np.nan, action)
    return attitude.to_euler(attitude.to_dcm(attitude.normalize(q)))[0]


def _with_frozen(records: Records, frozen: NDArray[np.int64]) -> Records:
    """Name the runs that the estimator itself gave up (and that did not diverge or raise besides)."""
    if not (frozen >= 0).any():
        return records
    hit = (frozen >= 0) & (records.status == "ok")
    status = np.where(hit, "frozen", records.status)
    epoch = records.criteria.epoch_s
    reason = [
        f"the estimator gave up at {frozen[i] * epoch:.1f} s" if hit[i] else text
        for i, text in enumerate(records.reason)
    ]
    return replace(records, status=status, reason=tuple(reason))


def lost_records(job: Job, why: str) -> Records:
    """Records of runs whose worker died: every epoch failed."""
    env = job.task.make(len(job.runs))
    job.task.reset(env, job.runs, job.suite_seed)
    criteria = Criteria.of(job.task, env.unwrapped.task, is_scored(env))  # type: ignore[attr-defined]
    env.close()
    scorer = Scorer(criteria, len(job.runs))
    scorer.fill()
    count = len(job.runs)
    return scorer.records(job.runs, status=np.array(["lost"] * count), reason=(why,) * count)


@dataclass(frozen=True)
class Course:
    """One run at full rate, for figures."""

    records: Records
    t: NDArray[np.floating[Any]]  #: (K,) s
    phi: Array  #: (K, 3) rad; NaN where the recording has no reference
    sigma: Array  #: (K, 3) rad, the estimator's own; NaN where it states none


def run_episode(
    task: str | EvaluationTask,
    solver: registry.Solver,
    run: int = 0,
    seed: int | None = None,
    *,
    settings: dict[str, Any] | None = None,
    observer: Observer | None = None,
) -> Course:
    """Play one run of the task's suite (or of the suite of ``seed``) and keep its errors at every epoch.

    Raises:
        ValueError, FileNotFoundError: a task, a run, settings or a solver that do not fit.
    """
    task = get_task(task)
    (run,) = run_numbers([run])
    task.check_runs(run + 1)
    phis: list[Array] = []
    sigmas: list[Array] = []

    def keep(k: int, phi: Array, sigma: Array | None) -> None:
        phis.append(phi[0].copy())
        sigmas.append(np.full(3, np.nan) if sigma is None else sigma[0])
        if observer:
            observer(k, phi, sigma)

    job = Job(task, solver, (run,), dict(settings or {}), seed)
    records = play(job, registry.make(solver, settings), observer=keep)
    t = (1 + np.arange(len(phis))) * records.criteria.epoch_s
    return Course(records, t, np.array(phis).reshape(-1, 3), np.array(sigmas).reshape(-1, 3))
