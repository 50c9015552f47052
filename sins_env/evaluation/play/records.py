"""Scores of single runs, which are computed while the run is played.

The errors of every epoch come in: phi (E, N, U) in rad, and in navigation all of COMPONENTS. A few numbers per run and a
history at 1 Hz remain, so that memory does not grow with the duration. docs/tasks_and_scores.md#alignment-criterion has the
definitions. A failed epoch, with an action that is not finite, has the worst possible error and so counts in every score.
Without a reference all scores of errors are NaN.

A new score of a run is a field of :class:`Records` with its description, and its computation in :class:`Scorer`. Its
``since`` is the next schema of the results file. The file, exports and comparisons of runs derive their columns from it.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from sins_env.evaluation.play.criteria import AXES, AZIMUTH, COMPONENTS, NEES_AT, PHI, SCORED, Criteria
from sins_env.evaluation.play.divergence import FAILED_EPOCH, divergence
from sins_env.evaluation.play.fields import NEES_PARTS, Field, error_of, kept

#: Components that have limits in the steady state only, because a wrong attitude moves them until the filter has found it.
LATE = SCORED.span("dv", "dp")
_NEES = {"parts": NEES_PARTS, "units": ("",) * len(NEES_PARTS)}


@dataclass(frozen=True, repr=False)
class Records:
    """Runs of one solver on one task, one row per run. Units are rad, and s from the start of fine alignment."""

    criteria: Criteria
    run: NDArray[np.int64] = field(metadata=kept(kind="count"))  #: (R,) numbers of the runs
    #: (R,) one of STATUSES
    status: NDArray[np.str_] = field(metadata=kept(kind="word", usual="ok"))
    #: (R,) reason of a failure, in one line; empty for a good run
    reason: tuple[str, ...] = field(metadata=kept(kind="text", usual="", compared=False))
    #: (R,) traceback of the estimator's exception; empty if it raised none
    traceback: tuple[str, ...] = field(metadata=kept(kind="text", usual="", compared=False))
    repairs: NDArray[np.int64] = field(metadata=kept(kind="count", usual=0))  #: (R,) number of covariance repairs
    #: (R,) number of times that a safeguard replaced the estimator's own rule
    fallbacks: NDArray[np.int64] = field(metadata=kept(kind="count", usual=0, since=2))
    #: (R, 3) time of convergence E, N, U; inf if censored, and NaN, like the errors, if errors are not scored
    t_conv: Array = field(metadata=kept(parts=("e", "n", "u"), units=("s",) * 3))
    #: (R, 3) largest absolute error in the last hold_s; inf in a run that is no longer than that
    hold_max: Array = field(metadata=error_of(in_tables=False, endless=True))
    steady_mean: Array = field(metadata=error_of(in_tables=False))  #: (R, 3) mean error in the steady state
    steady_std: Array = field(metadata=error_of(in_tables=False))  #: (R, 3) standard deviation in the steady state
    steady_rms: Array = field(metadata=error_of())  #: (R, 3) RMS error in the steady state
    final: Array = field(metadata=error_of())  #: (R, 3) error at T
    #: (R,) estimated heading at T; NaN if there is none, for example in a run that raised
    heading: Array = field(metadata=kept(units=("rad",), components=("heading",)))
    #: (R,) time of the estimator per run and epoch in its batch
    step_s: Array = field(metadata=kept(units=("s",), in_tables=False, compared=False))
    #: (R, len(NEES_AT)) NEES of the attitude; NaN if the estimator reports no covariance, inf if that is not valid
    nees: Array = field(metadata=kept(**_NEES))
    #: (R, S, components) errors at criteria.history_t; NaN after the run has raised
    history: NDArray[np.float32] = field(metadata=kept(kind="curve", compared=False))
    #: (R, 12) RMS over the scored span; this and the fields below have shape (R, 0) in alignment
    span_rms: Array = field(metadata=error_of(COMPONENTS, column="rms", navigates=True, since=4))
    #: (R, 12) error at T
    span_final: Array = field(metadata=error_of(COMPONENTS, column="final", navigates=True, since=4))
    #: (R, len(NEES_AT)) NEES of attitude, velocity and position together
    nees_all: Array = field(metadata=kept(**_NEES, navigates=True, since=4))

    def __repr__(self) -> str:
        counts = Counter(self.status.tolist())
        return f"<Records of {len(self)} runs: {', '.join(f'{n} {status}' for status, n in counts.most_common())}>"

    def __len__(self) -> int:
        return len(self.run)

    @property
    def aligned_s(self) -> Array:
        """Time (R,) when all three errors have converged, s from the start of fine alignment; inf if censored."""
        return self.t_conv.max(axis=1)

    @property
    def failed(self) -> Mask:
        """Mask (R,) of runs that failed: they diverged, froze, raised or were lost."""
        return np.asarray(self.status != "ok", dtype=bool)

    @property
    def unfinished(self) -> Mask:
        """Mask (R,) of runs that raised or were lost."""
        return np.isin(self.status, ("raised", "lost"))

    @property
    def broken(self) -> Mask:
        """Mask (R,) of runs that raised, were lost, or had a failed epoch: defects of the estimator, not low accuracy."""
        return self.unfinished | np.array([text.startswith(FAILED_EPOCH) for text in self.reason], dtype=bool)

    def row(self, i: int) -> dict[str, Any]:
        """Return every field of one run, without ``criteria``, by name."""
        return {name: getattr(self, name)[i] for name in FIELDS}

    @classmethod
    def of_rows(cls, criteria: Criteria, rows: Sequence[dict[str, Any]]) -> Records:
        """Return records from rows, sorted by run; the inverse of :meth:`row`."""
        rows = sorted(rows, key=lambda row: int(row["run"]))
        return cls(criteria, **{name: one.of_runs([row[name] for row in rows]) for name, one in FIELDS.items()})

    @classmethod
    def concat(cls, parts: Sequence[Records]) -> Records:
        """Join records of other runs by the same criteria, sorted by run."""
        return cls.of_rows(parts[0].criteria, [part.row(i) for part in parts for i in range(len(part))])


#: Description of each field, without ``criteria``, by name.
FIELDS: dict[str, Field] = {
    one.name: replace(one.metadata["is"], name=one.name) for one in fields(Records) if "is" in one.metadata
}


class Scorer:
    """Scores of a batch: :meth:`add` takes errors in their order, :meth:`fill` the rest, and :meth:`records` returns all."""

    def __init__(self, criteria: Criteria, num_runs: int) -> None:
        self.criteria, self.k = criteria, 0
        shape = (num_runs, len(AXES))
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
        """Add the errors (R, n, components) of the next n epochs, and the mask (R, n) of failed ones."""
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
        beyond[..., slice(None) if c.limited_late else LATE] &= steady
        if c.lost_heading:
            beyond[..., AZIMUTH] &= steady[:, 0]
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
        """Add the worst errors for all epochs that are left, without a history."""
        history = self.history.copy()
        while self.k < self.criteria.num_epochs:
            n = min(self.criteria.num_epochs - self.k, 1000)
            runs = len(self.final)
            worst = np.broadcast_to(self.criteria.worst, (runs, n, self.criteria.components))
            self.add(worst, np.ones((runs, n), dtype=bool))
        self.history = history

    def records(self, run: Sequence[int], **given: Any) -> Records:
        """Return the records of the runs after all epochs have been added.

        Args:
            run: numbers of the runs.
            given: any of the fields status, reason, traceback, repairs, fallbacks, heading, step_s.

        Raises:
            ValueError: epochs are missing.
        """
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
    """Set ``at`` in place to the epoch of the first hit (R, n, ...), unless it is set already."""
    new = hit.any(axis=1) & (at < 0)
    if new.any():
        at[new] = k[hit.argmax(axis=1)][new]


def score(errors: Array, failed: Mask | None, criteria: Criteria) -> Records:
    """Return the records of complete errors (R, K, components), with the mask (R, K) of failed epochs or None."""
    scorer = Scorer(criteria, len(errors))
    scorer.add(errors, np.zeros(errors.shape[:2], dtype=bool) if failed is None else failed)
    return scorer.records(range(len(errors)))
