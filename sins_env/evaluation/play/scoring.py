"""Scores of single runs, taken as they are played, so that memory does not grow with the duration.

Errors of every epoch enter: phi (E, N, U) rad, of navigation tasks all of COMPONENTS. What stays per run is a handful of
numbers and a history at 1 Hz. The definitions are those of docs/tasks_and_scores.md#alignment-criterion. A failed
epoch (non-finite action)
carries the worst error that can be expressed and so counts in every score. Without a reference every score of an error is NaN.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude
from sins_env.arrays import Array, Mask
from sins_env.evaluation.play.criteria import NEES_AT, Criteria
from sins_env.evaluation.play.records import FAILED_EPOCH, Records

#: Components whose limits hold in the steady state only: a wrong attitude moves them until the filter has found it.
LATE = slice(3, 9)
_NAMES = (
    "east",
    "north",
    "azimuth",
    *(f"{axis} {kind}" for kind in ("velocity", "position") for axis in ("east", "north", "vertical")),
)
_UNITS = ("deg",) * 3 + ("m/s",) * 3 + ("m",) * 3


def euler_errors(q_nb: Array, phi: Array) -> Array:
    """Errors of heading, pitch and roll (..., 3) rad of attitudes (..., 4) with the misalignment phi (..., 3)."""
    C = attitude.to_dcm(attitude.normalize(q_nb))
    true = np.matmul(np.swapaxes(attitude.misalignment_dcm(phi), -1, -2), C)
    pairs = zip(attitude.to_euler(C), attitude.to_euler(true), strict=True)
    return attitude.wrap(np.stack([angle - other for angle, other in pairs], axis=-1))


def nees(errors: Array, covariance: Array) -> Array:
    """e' P^-1 e of each run: (R, n), (R, n, n) -> (R,); inf where P is not a covariance.

    The scale of each component is taken out first: radians beside metres would cost half of the digits.
    """
    scale = np.sqrt(np.abs(np.diagonal(covariance, axis1=-2, axis2=-1)))
    finite: Mask = np.asarray(np.isfinite(covariance).all(axis=(-2, -1)) & (scale > 0).all(axis=-1))
    scale = np.where(finite[:, None], scale, 1.0)
    P = np.where(finite[:, None, None], covariance, np.eye(scale.shape[1])) / (scale[:, :, None] * scale[:, None, :])
    values, vectors = np.linalg.eigh(0.5 * (P + np.swapaxes(P, -1, -2)))
    valid = finite & (values[:, 0] > 0)
    across = np.matmul((errors / scale)[:, None, :], vectors)[:, 0, :]
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
        self.final = np.zeros((num_runs, criteria.components))
        self.span_squares = np.zeros_like(self.final)
        self.diverged_at = np.full((num_runs, len(criteria.limit)), -1)
        self.failed_at = np.full(num_runs, -1)
        self.nees = np.full((num_runs, len(NEES_AT)), np.nan)
        self.nees_all = np.full_like(self.nees, np.nan)
        self.history = np.full((num_runs, len(criteria.history_t), criteria.components), np.nan, dtype=np.float32)

    def add(self, errors: Array, failed: Mask) -> None:
        """The next n epochs: (R, n, components) and (R, n)."""
        c, phi = self.criteria, errors[..., :3]
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
        status, reason = self._verdict()
        blank = ("",) * runs
        t_conv = np.where(held, start, np.inf)
        hold_max = np.full_like(self.hold_max, np.inf) if too_short else self.hold_max
        span_rms = np.sqrt(self.span_squares / max(c.num_epochs - c.span_from + 1, 1))
        scores: tuple[Array, ...] = (t_conv, hold_max, mean, np.sqrt(variance), np.sqrt(variance + mean**2), self.final)
        if not c.scored:
            scores = (*(np.full((runs, 3), np.nan),) * (len(scores) - 1), np.full_like(self.final, np.nan))
            span_rms = np.full_like(span_rms, np.nan)
        t_conv, hold_max, mean, std, rms, final = scores
        none = 0 if not c.navigates else None
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
            final=final[:, :3],
            heading=np.asarray(given.get("heading", np.full(runs, np.nan)), dtype=float),
            nees=self.nees,
            step_s=np.asarray(given.get("step_s", np.zeros(runs)), dtype=float),
            history=self.history if c.scored else np.full_like(self.history, np.nan),
            span_rms=span_rms[:, :none],
            span_final=final[:, :none],
            nees_all=self.nees_all,
        )

    def _verdict(self) -> tuple[NDArray[np.str_], tuple[str, ...]]:
        c, reasons = self.criteria, []
        for failed, diverged, final in zip(self.failed_at, self.diverged_at, self.final, strict=True):
            axes = [j for j in range(len(c.limit)) if diverged[j] > 0 and c.scored]
            if failed > 0:
                reasons.append(f"{FAILED_EPOCH} at {failed * c.epoch_s:.1f} s")
            elif axes:
                j = min(axes, key=lambda axis: int(diverged[axis]))
                reasons.append(f"{_NAMES[j]} error beyond {_limit(c, j)} at {diverged[j] * c.epoch_s:.1f} s")
            elif c.scored and abs(final[2]) > c.final_limit:
                reasons.append(f"azimuth error beyond {math.degrees(c.final_limit):.3g} deg at the end")
            else:
                reasons.append("")
        return np.array(["diverged" if reason else "ok" for reason in reasons]), tuple(reasons)


def _limit(criteria: Criteria, j: int) -> str:
    limit = float(criteria.limit[j])
    return f"{math.degrees(limit) if j < 3 else limit:.3g} {_UNITS[j]}"


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
