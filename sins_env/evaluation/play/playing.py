"""Playing of runs for their scores, and the treatment of failures.

The estimator gets observations and the public Task only. A run in which it raises an exception has failed, and the records
have its traceback. If a batched estimator raises, its batch is halved until the runs at fault are alone, so that the others
keep their scores. The same holds for a call that takes longer than ``epoch_timeout_s`` or ends the estimator's process.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.envs.reward import failed_epochs
from sins_env.evaluation.estimators.guard import EstimatorError, Unavailable
from sins_env.evaluation.estimators.isolation import Host
from sins_env.evaluation.play.criteria import PHI, SCORED, Criteria
from sins_env.evaluation.play.errors import euler_errors, nees
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.loop import Loop
from sins_env.evaluation.play.records import Records, Scorer
from sins_env.evaluation.tasks.task import is_scored
from sins_env.states import answered

Tick = Callable[[int], None]  #: function called with the run-epochs done so far
#: Function called after each epoch with its number, the errors (R, 3) rad or (R, 9) rad, m/s, m, and their sigmas or None.
Observer = Callable[[int, Array, Array | None], None]

#: Names in ``info["errors"]`` of an environment for the errors of an answer.
REPORTED = {"phi": "phi", "dv": "vel", "dp": "pos"}
BLOCK_EPOCHS = 100  #: number of epochs whose errors are scored together


def run_job(job: Job, tick: Tick | None = None) -> Records:
    """Play the runs of a job and score them.

    Raises:
        ValueError, FileNotFoundError: settings of the task or the solver that do not fit. Exceptions of a running
            estimator are in the records instead, and so is why a stranger's cannot be made.
    """
    done = _Counter(tick)
    try:
        with job.host() as host:
            parts = [job.runs] if host.batched else [(run,) for run in job.runs]
            return Records.concat([_play_or_split(replace(job, runs=runs), host, done) for runs in parts])
    except Unavailable as error:
        return _unavailable(job, error)


class _Counter:
    """Counter of the run-epochs done, for the progress display."""

    def __init__(self, tick: Tick | None) -> None:
        self.tick, self.total = tick, 0

    def __call__(self, count: int) -> None:
        self.total += count
        if self.tick:
            self.tick(self.total)


def _play_or_split(job: Job, host: Host, done: _Counter) -> Records:
    """Play a batch; if its estimator raises, halve the batch, with a new estimator, for the old one's state is unknown."""
    before = done.total
    try:
        return play(job, host, done)
    except Unavailable as error:
        return _unavailable(job, error)
    except EstimatorError:
        done.total = before
        middle = len(job.runs) // 2
        parts = []
        for half in (replace(job, runs=job.runs[:middle]), replace(job, runs=job.runs[middle:])):
            try:
                host.renew()
                parts.append(_play_or_split(half, host, done))
            except Unavailable as error:
                parts.append(_unavailable(half, error))
        return Records.concat(parts)


def play(job: Job, host: Host, done: Tick | None = None, observer: Observer | None = None) -> Records:
    """Play one batch from the first observation to the last step, and score it.

    Raises:
        EstimatorError: the estimator failed in a batch of several runs; a failure of a single run is in the records.
    """
    runs, loop = len(job.runs), Loop.of(job, host)
    criteria = Criteria.of(job.task, loop.task, is_scored(loop.env))
    guard, scorer, block = loop.guard, Scorer(criteria, runs), _Block(criteria, runs)
    ask = {epoch: i for i, epoch in enumerate(criteria.nees_epochs)}
    action = np.full((runs, 4), np.nan)
    outcome: dict[str, Any] = {}
    try:
        for k, action, info, _, _ in loop:
            P = guard.covariance() if k in ask or (observer and criteria.known_start) else None
            errors = block.keep(action, info)
            if k in ask and P is not None:
                scorer.nees[:, ask[k]] = nees(errors[:, PHI], P[:, PHI, PHI])
                if criteria.navigates:
                    scorer.nees_all[:, ask[k]] = nees(errors, P)
            if observer:
                observer(k, errors, None if P is None else np.sqrt(np.abs(np.diagonal(P, axis1=-2, axis2=-1))))
            if block.length == BLOCK_EPOCHS or k == criteria.num_epochs:
                count = block.hand_over(scorer)
                if done:
                    done(runs * count)
        outcome["repairs"], outcome["fallbacks"], frozen = guard.health()
    except EstimatorError as error:
        if runs > 1:
            raise
        frozen = np.full(1, -1)
        action = np.full((1, 4), np.nan)  # its heading is none
        block.hand_over(scorer)
        at = (scorer.k + 1) * criteria.epoch_s
        outcome |= {
            "status": np.array(["raised"]),
            "reason": (f"{error}, at {min(at, criteria.duration_s):.1f} s",),
        }
        outcome["traceback"] = (error.text,)
        scorer.fill()
    finally:
        loop.close()
    outcome |= {
        "heading": _heading(action),
        "step_s": np.full(runs, guard.seconds / (runs * max(guard.steps, 1))),
    }
    return _with_frozen(scorer.records(job.runs, **outcome), frozen)


class _Block:
    """Buffer of the errors of some epochs, which are scored together."""

    def __init__(self, criteria: Criteria, runs: int) -> None:
        self.criteria, self.length = criteria, 0
        self.errors = np.full((runs, BLOCK_EPOCHS, criteria.components), np.nan)
        self.q_nb = np.empty((runs, BLOCK_EPOCHS, 4))
        self.failed = np.zeros((runs, BLOCK_EPOCHS), dtype=bool)

    def keep(self, action: Array, info: dict[str, Any]) -> Array:
        """Keep an epoch, and return its errors without Euler angles, (R, 3) or (R, 9); NaN without a reference."""
        at, answer = self.length, answered(self.criteria.navigates)
        now = self.errors[:, at, : answer.size]
        for name in answer.names if self.criteria.scored else ():
            now[:, answer[name]] = info["errors"][REPORTED[name]]
        self.failed[:, at], self.q_nb[:, at] = info["failed"], action[:, :4]
        self.length += 1
        return now.copy()

    def hand_over(self, scorer: Scorer) -> int:
        """Pass the epochs to the scorer, empty the buffer, and return their number."""
        count, self.length = self.length, 0
        errors, failed = self.errors[:, :count], self.failed[:, :count]
        if count and self.criteria.navigates and self.criteria.scored:
            q = np.where(failed[..., None], [1.0, 0.0, 0.0, 0.0], _squarable(self.q_nb[:, :count]))
            errors[..., SCORED["euler"]] = euler_errors(q, errors[..., PHI])
            errors[failed] = self.criteria.worst
        if count:
            scorer.add(errors, failed)
        return count


def _squarable(q: Array) -> Array:
    """Return quaternions (..., 4), those of an estimator, scaled if squares of their elements would leave the range."""
    size = np.max(np.abs(q), axis=-1, keepdims=True)
    far = np.isfinite(size) & ((size > 1e100) | (size < 1e-100)) & (size > 0)
    return q / np.where(far, size, 1.0)


def _heading(action: Array) -> Array:
    """Return the headings (R,) of the last actions, rad; NaN for an action without an attitude."""
    q = np.where(failed_epochs(action)[:, None], np.nan, _squarable(action[:, :4]))
    return attitude.to_euler(attitude.to_dcm(attitude.normalize(q)))[0]


def _with_frozen(records: Records, frozen: NDArray[np.int64]) -> Records:
    """Mark the runs that the estimator itself gave up, unless they diverged or raised."""
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
    """Return the records of runs whose worker died: every epoch has failed, for the reason ``why``."""
    return _unplayed(job, "lost", why)


def _unavailable(job: Job, error: Unavailable) -> Records:
    """Return the records of runs whose estimator cannot be made."""
    return _unplayed(job, "raised", str(error), error.text)


def _unplayed(job: Job, status: str, why: str, trace: str = "") -> Records:
    env = job.task.make(len(job.runs))
    job.task.reset(env, job.runs, job.suite_seed)
    criteria = Criteria.of(job.task, env.unwrapped.task, is_scored(env))  # type: ignore[attr-defined]
    env.close()
    scorer = Scorer(criteria, len(job.runs))
    scorer.fill()
    count = len(job.runs)
    return scorer.records(
        job.runs, status=np.array([status] * count), reason=(why,) * count, traceback=(trace,) * count
    )
