"""Scores of runs: the columns that everything else is worked out from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from sins_env.evaluation.play.criteria import Criteria

FAILED_EPOCH = "non-finite or zero action"  #: how the reason of a run with failed epochs begins
STATUSES = ("ok", "diverged", "frozen", "raised", "lost")


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
    history: NDArray[np.float32]  #: (R, S, components) at criteria.history_t; NaN once the run has raised
    span_rms: Array  #: (R, 12) over the scored span, of COMPONENTS; (R, 0) where the task does not navigate
    span_final: Array  #: (R, 12) at T; likewise
    nees_all: (
        Array  #: (R, len(NEES_AT)) as nees, of attitude, velocity and position; NaN where the task does not navigate
    )

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
