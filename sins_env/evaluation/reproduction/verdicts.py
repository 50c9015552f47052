"""A printed figure beside ours: does it lie where so few records may have put it, and if not, is at least the order right?

Both are root mean squares of errors, about zero or about their mean. A print rests on a handful of records, so it is itself
a draw. It is reproduced if it differs from ours by no more than the two draws explain (:func:`band`). Errors with heavier tails
than normal ones spread more than that.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import special

from sins_env.evaluation.resampling import TAILS, bca, resampled, units_of

Array = NDArray[np.float64]

REPRODUCED, IN_ORDER, NOT = "reproduced", "in order only", "not reproduced"


class Estimate(NamedTuple):
    """Ours: a value with its 95 % interval, over so many runs; lost runs are counted, not hidden."""

    value: float
    low: float
    high: float
    runs: int
    lost: int = 0


class Printed(NamedTuple):
    """An RMS as printed; of one record it is the size of its error."""

    value: float
    records: int
    about_mean: bool = False

    @property
    def dof(self) -> int:
        return max(self.records - self.about_mean, 1)


def root_mean_square(errors: Array, about_mean: bool = False) -> Estimate:
    """RMS of errors (R,), about zero, or about their mean with R - 1; NaN marks the runs that are lost.

    BCa over runs; NaN for fewer than two.
    """
    known = errors[np.isfinite(errors)]
    runs, lost = len(known), int(len(errors) - len(known))
    if runs < 2:
        return Estimate(math.nan, math.nan, math.nan, runs, lost)
    units = units_of(np.stack([np.ones(runs), known, known**2], axis=1))

    def statistic(sums: Array) -> Array:
        count, first, second = np.moveaxis(sums, -1, 0)
        if about_mean:
            return np.sqrt(np.maximum(second - first**2 / count, 0.0) / np.maximum(count - 1, 1))
        return np.sqrt(second / count)

    total = units.sum(axis=0)
    low, high = bca(statistic(resampled(units))[:, None], statistic(total)[None], statistic(total - units)[:, None])[0]
    return Estimate(float(statistic(total)), float(low), float(high), runs, lost)


def band(printed: Printed, ours: Estimate) -> tuple[float, float]:
    """Between which figures a print of so many records differs from ours by chance alone, 95 %.

    Both errors are independent, so their distances on a scale of logarithms add as squares (Zou and Donner 2008, "MOVER",
    doi 10.1002/sim.3095); an RMS of normal errors is s sqrt(chi^2 / dof).
    """
    low, high = 0.5 * np.log(special.chdtri(printed.dof, 1.0 - TAILS) / printed.dof)
    with np.errstate(divide="ignore", invalid="ignore"):
        below = math.hypot(np.log(np.float64(ours.value) / ours.low), low)
        above = math.hypot(np.log(np.float64(ours.high) / ours.value), high)
    return ours.value * math.exp(-below), ours.value * math.exp(above)


def fits(printed: Printed, ours: Estimate) -> bool:
    """Whether the print lies in the band around ours."""
    low, high = band(printed, ours)
    return low <= abs(printed.value) <= high


def larger(a: Printed, b: Printed) -> bool:
    """Whether the print a is significantly larger than b, by the F test; two-sided at 95 %."""
    return abs(a.value) > abs(b.value) * math.sqrt(special.fdtri(a.dof, b.dof, TAILS[1]))


def verdicts(printed: Sequence[Printed | None], ours: Sequence[Estimate]) -> list[str]:
    """A verdict on each line of a group; empty where nothing is printed.

    "in order only": what the print tells apart significantly and our intervals, too, stands in the same order, and there
    is such a pair.
    """
    return [_verdict(i, printed, ours) for i in range(len(ours))]


def _verdict(i: int, printed: Sequence[Printed | None], ours: Sequence[Estimate]) -> str:
    line = printed[i]
    if line is None:
        return ""
    if math.isnan(ours[i].low):
        return f"{ours[i].runs} runs are too few"
    if fits(line, ours[i]):
        return REPRODUCED
    same = opposite = 0
    for other, estimate in zip(printed, ours, strict=True):
        if other is None:
            continue
        above, below = ours[i].low > estimate.high, ours[i].high < estimate.low
        same += (above and larger(line, other)) or (below and larger(other, line))
        opposite += (below and larger(line, other)) or (above and larger(other, line))
    return IN_ORDER if same and not opposite else NOT
