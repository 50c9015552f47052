"""Scores of single runs: what is kept of a run, and how it is worked out while the run is played.

Errors of every epoch enter: phi (E, N, U) rad, of navigation tasks all of COMPONENTS. What stays per run is a handful of
numbers and a history at 1 Hz, so that memory does not grow with the duration. The definitions are those of
docs/tasks_and_scores.md#alignment-criterion. A failed epoch (an action that is not finite) carries the worst error that can
be expressed, and so counts in every score. Without a reference every score of an error is NaN.

A new score of a run is a field of :class:`Records`, which says what it is, and what :class:`Scorer` works out for it; with
``since`` the next schema of the results file. The file, exports and comparisons of runs derive the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from sins_env.evaluation.play.criteria import COMPONENTS, NEES_AT, PHI, SCORED, Criteria
from sins_env.evaluation.play.divergence import FAILED_EPOCH, divergence
from sins_env.evaluation.play.fields import NEES_PARTS, Field, error_of, kept

#: Components whose limits hold in the steady state only: a wrong attitude moves them until the filter has found it.
LATE = SCORED.span("dv", "dp")
_NEES = {"parts": NEES_PARTS, "units": ("",) * len(NEES_PARTS)}


@dataclass(frozen=True)
class Records:
    """Runs of one solver on one task, one row per run. rad, and s from the start of fine alignment."""

    criteria: Criteria
    run: NDArray[np.int64] = field(metadata=kept(kind="count"))  #: (R,) their numbers
    #: (R,) one of STATUSES
    status: NDArray[np.str_] = field(metadata=kept(kind="word", usual="ok"))
    #: (R,) one line; empty where nothing went wrong
    reason: tuple[str, ...] = field(metadata=kept(kind="text", usual="", compared=False))
    traceback: tuple[str, ...] = field(metadata=kept(kind="text", usual="", compared=False))  #: (R,)
    repairs: NDArray[np.int64] = field(metadata=kept(kind="count", usual=0))  #: (R,) covariance repairs
    #: (R,) times that a safeguard replaced the estimator's own rule
    fallbacks: NDArray[np.int64] = field(metadata=kept(kind="count", usual=0, since=2))
    #: (R, 3) s; inf where censored; this and the errors are NaN where they are not scored
    t_conv: Array = field(metadata=kept(parts=("e", "n", "u"), units=("s",) * 3))
    hold_max: Array = field(metadata=error_of(in_tables=False))  #: (R, 3) largest |error| of the last hold_s
    steady_mean: Array = field(metadata=error_of(in_tables=False))  #: (R, 3)
    steady_std: Array = field(metadata=error_of(in_tables=False))  #: (R, 3)
    steady_rms: Array = field(metadata=error_of())  #: (R, 3)
    final: Array = field(metadata=error_of())  #: (R, 3) error at T
    #: (R,) estimated at T; NaN where there is none, as in a run that raised
    heading: Array = field(metadata=kept(units=("rad",), components=("heading",)))
    #: (R,) estimator time per run and epoch in its batch
    step_s: Array = field(metadata=kept(units=("s",), in_tables=False, compared=False))
    #: (R, len(NEES_AT)); NaN where the estimator has no covariance, inf where it is none
    nees: Array = field(metadata=kept(**_NEES))
    #: (R, S, components) at criteria.history_t; NaN once the run has raised
    history: NDArray[np.float32] = field(metadata=kept(kind="curve", compared=False))
    #: (R, 12) over the scored span; (R, 0) where the task does not navigate, as the fields below
    span_rms: Array = field(metadata=error_of(COMPONENTS, column="rms", navigates=True, since=4))
    span_final: Array = field(metadata=error_of(COMPONENTS, column="final", navigates=True, since=4))  #: (R, 12) at T
    #: (R, len(NEES_AT)) as nees, of attitude, velocity and position together
    nees_all: Array = field(metadata=kept(**_NEES, navigates=True, since=4))

    def __len__(self) -> int:
        return len(self.run)

    @property
    def aligned_s(self) -> Array:
        """(R,) when all three errors have converged, s from the start of the fine phase; inf: censored, NaN: not scored."""
        return self.t_conv.max(axis=1)

    @property
    def failed(self) -> Mask:
        """(R,) runs that did not come to a good end: they diverged, froze, raised or were lost."""
        return np.asarray(self.status != "ok", dtype=bool)

    @property
    def unfinished(self) -> Mask:
        """(R,) runs that raised or were lost."""
        return np.isin(self.status, ("raised", "lost"))

    @property
    def broken(self) -> Mask:
        """(R,) runs that raised, were lost, or had a failed epoch: their estimator is at fault, not its accuracy."""
        return self.unfinished | np.array([text.startswith(FAILED_EPOCH) for text in self.reason], dtype=bool)

    def row(self, i: int) -> dict[str, Any]:
        """Every field but ``criteria`` of one run."""
        return {name: getattr(self, name)[i] for name in FIELDS}

    @classmethod
    def of_rows(cls, criteria: Criteria, rows: Sequence[dict[str, Any]]) -> Records:
        """The inverse of :meth:`row`, in the order of the runs."""
        rows = sorted(rows, key=lambda row: int(row["run"]))
        return cls(criteria, **{name: one.of_runs([row[name] for row in rows]) for name, one in FIELDS.items()})

    @classmethod
    def concat(cls, parts: Sequence[Records]) -> Records:
        return cls.of_rows(parts[0].criteria, [part.row(i) for part in parts for i in range(len(part))])


#: What each field but ``criteria`` says of itself, by name.
FIELDS: dict[str, Field] = {
    one.name: replace(one.metadata["is"], name=one.name) for one in fields(Records) if "is" in one.metadata
}


class Scorer:
    """Takes the errors of a batch in order; :meth:`records` when all are in (the rest by :meth:`fill`)."""

    def __init__(self, criteria: Criteria, num_runs: int) -> None:
        self.criteria, self.k = criteria, 0
        shape = (num_runs, 3)
        self.last_bad = np.full(shape, criteria.coarse_epochs)
        self.hold_max = np.zeros(shape)
        self.shift, self.sum, self.squares = np.full(shape, np.nan), np.zeros(shape), np.zeros(shape)
        self.final = np.zeros((num_runs, criteria.components))
        self.span_squares = np.zeros_like(self.final)
        self.diverged_at = np.full((num_runs, len(criteria.limit)), -1)
        self.failed_at = np.full(num_runs, -1)
        self.nees = np.full((num_runs, len(NEES_AT)), np.nan)
        self.nees_all = np.full_like(self.nees, np.nan)
        self.history = np.full((num_runs, len(criteria.history_t), criteria.components), np.nan, dtype=np.float32)

    def add(self, errors: Array, failed: Mask) -> None:
        """The next n epochs: (R, n, components) and (R, n)."""
        c, phi = self.criteria, errors[..., PHI]
        k = self.k + 1 + np.arange(phi.shape[1])
        self.k += phi.shape[1]
        size = np.abs(phi)
        fine = (k > c.coarse_epochs)[:, None]
        self.last_bad = np.maximum(self.last_bad, np.where(size > c.delta, k[:, None], 0).max(axis=1))
        first_held = c.num_epochs - round(c.hold_s / c.epoch_s)
        if k[-1] >= first_held:
            self.hold_max = np.maximum(self.hold_max, size[:, k >= first_held].max(axis=1))
        beyond = (np.abs(errors[..., : len(c.limit)]) > c.limit) & fine
        steady = (k >= c.steady_from)[:, None]
        beyond[..., LATE] &= steady
        if c.lost_heading:
            beyond[..., 2:3] &= steady
        _first(self.diverged_at, beyond, k)
        _first(self.failed_at, failed, k)
        if c.navigates:
            self.span_squares += np.square(errors[:, k >= c.span_from]).sum(axis=1)
        if k[-1] >= c.steady_from:
            late = phi[:, k >= c.steady_from]
            self.shift = np.where(np.isnan(self.shift), late[:, 0], self.shift)  # keeps the variance's digits
            self.sum += (late - self.shift[:, None]).sum(axis=1)
            self.squares += np.square(late - self.shift[:, None]).sum(axis=1)
        kept = k % c.history_stride == 0
        self.history[:, k[kept] // c.history_stride - 1] = errors[:, kept]
        self.final = errors[:, -1].copy()

    def fill(self) -> None:
        """The epochs that a run no longer lived to see: the worst errors, and no history."""
        history = self.history.copy()
        while self.k < self.criteria.num_epochs:
            n = min(self.criteria.num_epochs - self.k, 1000)
            runs = len(self.final)
            worst = np.broadcast_to(self.criteria.worst, (runs, n, self.criteria.components))
            self.add(worst, np.ones((runs, n), dtype=bool))
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
        of_errors = {
            "t_conv": np.where(held, start, np.inf),
            "hold_max": np.full_like(self.hold_max, np.inf) if too_short else self.hold_max,
            "steady_mean": mean,
            "steady_std": np.sqrt(variance),
            "steady_rms": np.sqrt(variance + mean**2),
            "final": self.final[:, PHI],
            "history": self.history,
            "span_rms": np.sqrt(self.span_squares / max(c.num_epochs - c.span_from + 1, 1)),
            "span_final": self.final,
        }
        if not c.scored:
            of_errors = {name: np.full_like(value, np.nan) for name, value in of_errors.items()}
        status, reason = divergence(c, self.failed_at, self.diverged_at, self.final)
        found: dict[str, Any] = {
            "run": run, "status": status, "reason": reason, "traceback": ("",) * runs, "repairs": np.zeros(runs),
            "fallbacks": np.zeros(runs), "heading": np.full(runs, np.nan), "step_s": np.zeros(runs),
            "nees": self.nees, "nees_all": self.nees_all, **of_errors, **given,
        }  # fmt: skip
        there = {name: one for name, one in FIELDS.items() if c.navigates or not one.navigates}
        absent: dict[str, Any] = {name: one.absent(runs) for name, one in FIELDS.items() if name not in there}
        return Records(c, **{name: one.of_runs(found[name]) for name, one in there.items()}, **absent)


def _first(at: NDArray[np.int64], hit: Mask, k: NDArray[np.int64]) -> None:
    """Note, in place, the epoch of the first hit (R, n, ...) where none is noted yet."""
    new = hit.any(axis=1) & (at < 0)
    if new.any():
        at[new] = k[hit.argmax(axis=1)][new]


def score(errors: Array, failed: Mask | None, criteria: Criteria) -> Records:
    """Scores of complete error histories: (R, K, components), (R, K) or None."""
    scorer = Scorer(criteria, len(errors))
    scorer.add(errors, np.zeros(errors.shape[:2], dtype=bool) if failed is None else failed)
    return scorer.records(range(len(errors)))
