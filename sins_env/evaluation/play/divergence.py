"""Status of each run, and for one that has diverged the error that did."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.evaluation.play.criteria import AZIMUTH, COMPONENT_UNITS, Criteria

STATUSES = ("ok", "diverged", "frozen", "raised", "lost")
FAILED_EPOCH = "non-finite or zero action"  #: first words of the reason of a run with failed epochs
_NAMES = (
    "east",
    "north",
    "azimuth",
    *(f"{axis} {kind}" for kind in ("velocity", "position") for axis in ("east", "north", "vertical")),
)


def divergence(
    criteria: Criteria, failed_at: NDArray[np.int64], diverged_at: NDArray[np.int64], final: Array
) -> tuple[NDArray[np.str_], tuple[str, ...]]:
    """Return status and reason of each run.

    Args:
        criteria: criteria of the task.
        failed_at: (R,) first failed epoch; -1 for none.
        diverged_at: (R, n) first epoch beyond the limit of each component; -1 for none.
        final: (R, components) errors at the end.
    """
    reasons = []
    for failed, diverged, last in zip(failed_at, diverged_at, final, strict=True):
        axes = [j for j in range(len(criteria.limit)) if diverged[j] > 0 and criteria.scored]
        if failed > 0:
            reasons.append(f"{FAILED_EPOCH} at {failed * criteria.epoch_s:.1f} s")
        elif axes:
            j = min(axes, key=lambda axis: int(diverged[axis]))
            at = diverged[j] * criteria.epoch_s
            reasons.append(f"{_NAMES[j]} error beyond {_limit(criteria, j)} at {at:.1f} s")
        elif criteria.scored and abs(last[AZIMUTH]) > criteria.final_limit:
            reasons.append(f"azimuth error beyond {math.degrees(criteria.final_limit):.3g} deg at the end")
        else:
            reasons.append("")
    return np.array(["diverged" if reason else "ok" for reason in reasons]), tuple(reasons)


def _limit(criteria: Criteria, j: int) -> str:
    limit, unit = float(criteria.limit[j]), COMPONENT_UNITS[j]
    return f"{math.degrees(limit):.3g} deg" if unit == "rad" else f"{limit:.3g} {unit}"
