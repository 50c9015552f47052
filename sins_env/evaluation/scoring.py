"""Scores of single runs, taken as they are played, so that memory does not grow with the duration.

Errors enter as phi (E, N, U) rad of every epoch; what stays per run is a handful of numbers and a history at
1 Hz. The definitions are those of evaluation.md section 1. A failed epoch (non-finite action) carries the
worst error that phi can express and so counts in every score. Without a reference every score of an error is NaN.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import types
from sins_env.envs.episode import WORST_PHI
from sins_env.evaluation.tasks import EvaluationTask

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

AXES = ("E", "N", "U")
NEES_AT = (0.25, 0.5, 0.75, 1.0)  #: parts of the fine phase at which the consistency is taken
STEADY_LEAST_S, STEADY_PART = 60.0, 0.2
DIVERGED_SIGMAS = 10.0
DIVERGED_UNKNOWN = np.radians([10.0, 10.0, 90.0])  #: limits E, N, U after an unknown start
LOST_HEADING = np.radians(90.0)  #: told spread from which on the start may be anywhere
MAX_HISTORY = 21_600  #: 6 h at 1 Hz; longer episodes are kept at a longer interval
FAILED_EPOCH = "non-finite or zero action"  #: how the reason of a run with failed epochs begins
STATUSES = ("ok", "diverged", "frozen", "raised", "lost")


@dataclass(frozen=True)
class Criteria:
    """What a run is held against. Times in s from switch-on."""

    epoch_s: float
    num_epochs: int
    coarse_epochs: int
    delta: Array  #: (3,) rad thresholds of convergence
    limit: Array  #: (3,) rad beyond which a run has diverged
    hold_s: float
    known_start: bool = True
    scored: bool = True  #: False for a recording without a reference: there are no errors then
    lost_heading: bool = False  #: a start within +-180 deg: the limit in azimuth holds in the steady state only

    @classmethod
    def of(cls, task: EvaluationTask, public: types.Task, scored: bool = True) -> Criteria:
        known = public.start is not None
        sigma = np.radians(np.asarray(public.prior.attitude_std_deg, dtype=float))
        limit = DIVERGED_SIGMAS * sigma if known else DIVERGED_UNKNOWN
        lost_heading = bool(limit[2] >= DIVERGED_SIGMAS * LOST_HEADING)
        if lost_heading:
            limit[2] = DIVERGED_UNKNOWN[2]
        return cls(
            public.epoch_s,
            public.num_epochs,
            round(public.coarse_s / public.epoch_s),
            task.delta,
            limit,
            task.hold_s,
            known,
            scored,
            lost_heading,
        )

    @property
    def duration_s(self) -> float:
        return self.num_epochs * self.epoch_s

    @property
    def coarse_s(self) -> float:
        return self.coarse_epochs * self.epoch_s

    @property
    def horizon_s(self) -> float:
        """The latest time of convergence that can be seen, from the start of fine alignment."""
        return max(self.duration_s - self.coarse_s - self.hold_s, 0.0)

    @property
    def steady_from(self) -> int:
        """The first epoch of the steady state: the last max(60 s, 20 %), at most the fine phase."""
        length = max(STEADY_LEAST_S, STEADY_PART * self.duration_s)
        return max(self.num_epochs - round(length / self.epoch_s), self.coarse_epochs) + 1

    @property
    def history_stride(self) -> int:
        """Epochs from one sample of the history to the next."""
        second = max(round(1.0 / self.epoch_s), 1)
        return second * max(math.ceil(self.num_epochs / second / MAX_HISTORY), 1)

    @property
    def history_t(self) -> NDArray[np.floating[Any]]:
        """Times of the history, s."""
        return np.arange(self.history_stride, self.num_epochs + 1, self.history_stride) * self.epoch_s

    @property
    def nees_epochs(self) -> tuple[int, ...]:
        """Where the covariance is asked for; none after an unknown start, whose spread no prior states."""
        fine = self.num_epochs - self.coarse_epochs
        return tuple(self.coarse_epochs + max(round(part * fine), 1) for part in NEES_AT) if self.known_start else ()


@dataclass(frozen=True)
class Records:
    """Runs of one solver on one task, one row per run. rad, and s from the start of fine alignment."""

    criteria: Criteria
    run: NDArray[np.int64]  #: (R,)
    status: NDArray[np.str_]  #: (R,) one of STATUSES
    reason: tuple[str, ...]  #: (R,) one line; empty where nothing went wrong
    traceback: tuple[str, ...]  #: (R,)
    repairs: NDArray[np.int64]  #: (R,) covariance repairs
    fallbacks: NDArray[np.int64]  #: (R,) times that a safeguard replaced the estimator's own rule
    t_conv: Array  #: (R, 3) s; inf where censored; this and the other errors are NaN where they are not scored
    hold_max: Array  #: (R, 3) largest |error| of the last hold_s
    steady_mean: Array  #: (R, 3)
    steady_std: Array  #: (R, 3)
    steady_rms: Array  #: (R, 3)
    final: Array  #: (R, 3) error at T
    heading: Array  #: (R,) estimated at T; NaN where there is none, as in a run that raised
    nees: Array  #: (R, len(NEES_AT)); NaN where the estimator has no covariance, inf where it is none
    step_s: Array  #: (R,) estimator time per run and epoch in its batch, s
    history: NDArray[np.float32]  #: (R, S, 3) at criteria.history_t; NaN once the run has raised

    def __len__(self) -> int:
        return len(self.run)

    @property
    def aligned_s(self) -> Array:
        """(R,) when all three errors have converged, s from the start of the fine phase; inf: censored, NaN: not scored."""
        return self.t_conv.max(axis=1)

    @property
    def unfinished(self) -> Bools:
        """(R,) runs that raised or were lost."""
        return np.isin(self.status, ("raised", "lost"))

    @property
    def broken(self) -> Bools:
        """(R,) runs that raised, were lost, or had a failed epoch: their estimator is at fault, not its accuracy."""
        return self.unfinished | np.array([text.startswith(FAILED_EPOCH) for text in self.reason], dtype=bool)

    def row(self, i: int) -> dict[str, Any]:
        """Every field but ``criteria`` of one run."""
        return {f.name: getattr(self, f.name)[i] for f in fields(self) if f.name != "criteria"}

    @classmethod
    def of_rows(cls, criteria: Criteria, rows: Sequence[dict[str, Any]]) -> Records:
        """The inverse of :meth:`row`, in the order of the runs."""
        rows = sorted(rows, key=lambda row: int(row["run"]))
        tuples = ("reason", "traceback")
        names = [f.name for f in fields(cls) if f.name != "criteria"]
        columns: dict[str, Any] = {name: [row[name] for row in rows] for name in names}
        arrays: dict[str, Any] = {n: tuple(c) if n in tuples else np.array(c) for n, c in columns.items()}
        return cls(criteria, **arrays)

    @classmethod
    def concat(cls, parts: Sequence[Records]) -> Records:
        return cls.of_rows(parts[0].criteria, [part.row(i) for part in parts for i in range(len(part))])


def nees(phi: Array, covariance: Array) -> Array:
    """e' P^-1 e of each run: (R, 3), (R, 3, 3) -> (R,); inf where P is not a covariance."""
    finite: Bools = np.asarray(np.isfinite(covariance).all(axis=(-2, -1)))
    P = np.where(finite[:, None, None], covariance, np.eye(3))
    values, vectors = np.linalg.eigh(0.5 * (P + np.swapaxes(P, -1, -2)))
    valid = finite & (values[:, 0] > 0)
    across = np.matmul(phi[:, None, :], vectors)[:, 0, :]
    ratio = np.square(across) / np.where(valid[:, None], values, 1.0)
    return np.where(valid, ratio.sum(axis=1), np.inf)


class Scorer:
    """Takes the errors of a batch in order; :meth:`records` when all are in (the rest by :meth:`fill`)."""

    def __init__(self, criteria: Criteria, num_runs: int) -> None:
        self.criteria, self.k = criteria, 0
        shape = (num_runs, 3)
        self.last_bad = np.full(shape, criteria.coarse_epochs)
        self.hold_max = np.zeros(shape)
        self.shift, self.sum, self.squares = np.full(shape, np.nan), np.zeros(shape), np.zeros(shape)
        self.final = np.zeros(shape)
        self.diverged_at = np.full(shape, -1)
        self.failed_at = np.full(num_runs, -1)
        self.nees = np.full((num_runs, len(NEES_AT)), np.nan)
        self.history = np.full((num_runs, len(criteria.history_t), 3), np.nan, dtype=np.float32)

    def add(self, phi: Array, failed: Bools) -> None:
        """The next n epochs: (R, n, 3) rad and (R, n)."""
        c = self.criteria
        k = self.k + 1 + np.arange(phi.shape[1])
        self.k += phi.shape[1]
        size = np.abs(phi)
        fine = (k > c.coarse_epochs)[:, None]
        self.last_bad = np.maximum(self.last_bad, np.where(size > c.delta, k[:, None], 0).max(axis=1))
        first_held = c.num_epochs - round(c.hold_s / c.epoch_s)
        if k[-1] >= first_held:
            self.hold_max = np.maximum(self.hold_max, size[:, k >= first_held].max(axis=1))
        beyond = (size > c.limit) & fine
        if c.lost_heading:
            beyond[..., 2] &= k >= c.steady_from
        _first(self.diverged_at, beyond, k)
        _first(self.failed_at, failed, k)
        if k[-1] >= c.steady_from:
            late = phi[:, k >= c.steady_from]
            self.shift = np.where(np.isnan(self.shift), late[:, 0], self.shift)  # keeps the variance's digits
            self.sum += (late - self.shift[:, None]).sum(axis=1)
            self.squares += np.square(late - self.shift[:, None]).sum(axis=1)
        kept = k % c.history_stride == 0
        self.history[:, k[kept] // c.history_stride - 1] = phi[:, kept]
        self.final = phi[:, -1].copy()

    def fill(self) -> None:
        """The epochs that a run no longer lived to see: the worst errors, and no history."""
        history = self.history.copy()
        while self.k < self.criteria.num_epochs:
            n = min(self.criteria.num_epochs - self.k, 1000)
            runs = len(self.final)
            self.add(np.broadcast_to(WORST_PHI, (runs, n, 3)), np.ones((runs, n), dtype=bool))
        self.history = history

    def records(self, run: Sequence[int], **given: Any) -> Records:
        """The scores. ``given``: any of the fields status, reason, traceback, repairs, fallbacks, heading, step_s."""
        c, runs = self.criteria, len(run)
        if self.k != c.num_epochs:
            raise ValueError(f"{self.k} epochs were scored; allowed: all {c.num_epochs}")
        start = (self.last_bad + 1 - c.coarse_epochs) * c.epoch_s
        held = (c.num_epochs - self.last_bad - 1) * c.epoch_s >= c.hold_s - 1e-9
        count = c.num_epochs - c.steady_from + 1
        offset = self.sum / count
        mean = self.shift + offset
        too_short = c.num_epochs - c.coarse_epochs <= round(c.hold_s / c.epoch_s)
        variance = np.maximum(self.squares / count - offset**2, 0.0)
        status, reason = self._verdict()
        blank = ("",) * runs
        t_conv = np.where(held, start, np.inf)
        hold_max = np.full_like(self.hold_max, np.inf) if too_short else self.hold_max
        scores: tuple[Array, ...] = (t_conv, hold_max, mean, np.sqrt(variance), np.sqrt(variance + mean**2), self.final)
        if not c.scored:
            scores = (np.full((runs, 3), np.nan),) * len(scores)
        t_conv, hold_max, mean, std, rms, final = scores
        return Records(
            criteria=c,
            run=np.asarray(run, dtype=np.int64),
            status=given.get("status", status),
            reason=given.get("reason", reason),
            traceback=given.get("traceback", blank),
            repairs=np.asarray(given.get("repairs", np.zeros(runs)), dtype=np.int64),
            fallbacks=np.asarray(given.get("fallbacks", np.zeros(runs)), dtype=np.int64),
            t_conv=t_conv,
            hold_max=hold_max,
            steady_mean=mean,
            steady_std=std,
            steady_rms=rms,
            final=final,
            heading=np.asarray(given.get("heading", np.full(runs, np.nan)), dtype=float),
            nees=self.nees,
            step_s=np.asarray(given.get("step_s", np.zeros(runs)), dtype=float),
            history=self.history if c.scored else np.full_like(self.history, np.nan),
        )

    def _verdict(self) -> tuple[NDArray[np.str_], tuple[str, ...]]:
        c, reasons = self.criteria, []
        for failed, diverged in zip(self.failed_at, self.diverged_at, strict=True):
            axes = [j for j in range(3) if diverged[j] > 0 and c.scored]
            if failed > 0:
                reasons.append(f"{FAILED_EPOCH} at {failed * c.epoch_s:.1f} s")
            elif axes:
                j = min(axes, key=lambda axis: int(diverged[axis]))
                name, limit = ("east", "north", "azimuth")[j], math.degrees(c.limit[j])
                reasons.append(f"{name} error beyond {limit:.3g} deg at {diverged[j] * c.epoch_s:.1f} s")
            else:
                reasons.append("")
        return np.array(["diverged" if reason else "ok" for reason in reasons]), tuple(reasons)


def _first(at: NDArray[np.int64], hit: Bools, k: NDArray[np.int64]) -> None:
    """Note, in place, the epoch of the first hit (R, n, ...) where none is noted yet."""
    new = hit.any(axis=1) & (at < 0)
    if new.any():
        at[new] = k[hit.argmax(axis=1)][new]


def score(phi: Array, failed: Bools | None, criteria: Criteria) -> Records:
    """Scores of complete error histories: (R, K, 3) rad, (R, K) or None."""
    scorer = Scorer(criteria, len(phi))
    scorer.add(phi, np.zeros(phi.shape[:2], dtype=bool) if failed is None else failed)
    return scorer.records(range(len(phi)))
