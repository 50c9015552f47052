"""Verdicts on printed figures: does one lie where its few records may have put it, and if not, is at least the order right?

Values, intervals and p values are those of :mod:`sins_env.evaluation.score`: capped RMS, shares, medians, sign flips. What is
here is the print: a printed RMS rests on a handful of records, so that it is itself a draw. It is reproduced if it differs
from ours by no more than the two draws explain (:func:`band`). Errors with heavier tails than Gaussian ones spread more.
See docs/tasks_and_scores.md#reproduction.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import special

from sins_env.arrays import Array
from sins_env.evaluation.score import exact, losses, resampling
from sins_env.evaluation.score.resampling import NO_INTERVAL, TAILS
from sins_env.evaluation.score.verdicts import LEAST_INTERVAL, LEAST_VERDICT
from sins_env.evaluation.show.numbers import number_text

REPRODUCED, IN_ORDER, NOT, OPEN = "reproduced", "in order only", "not reproduced", "not told apart"
PRELIMINARY = "preliminary"
LUCK = 0.05  #: share of our runs that are closer to zero than a printed single run may be; a closer one was lucky


class Estimate(NamedTuple):
    """Our value with its 95 % interval."""

    value: float
    low: float
    high: float
    runs: int  #: number of runs behind it
    lost: int = 0  #: number of runs without a result, besides
    bound: float = math.nan  #: Cramer-Rao bound of the same figure; NaN if there is none
    p: float = math.nan  #: p value of no difference between two filters; NaN for what compares none


NOTHING = Estimate(math.nan, math.nan, math.nan, 0)


class Printed(NamedTuple):
    """A printed RMS; for a single record it is the size of its error."""

    value: float
    records: int  #: number of records behind it
    about_mean: bool = False  #: whether it is taken about the mean of the records
    kind: str = ""  #: only figures of one kind are put in order

    @property
    def dof(self) -> int:
        """Degrees of freedom of its square."""
        return max(self.records - self.about_mean, 1)

    @property
    def text(self) -> str:
        """The figure in words."""
        return number_text(self.value)


@dataclass(frozen=True)
class PrintedMean:
    """A printed mean over records, with their standard deviation."""

    value: float
    std: float
    records: int

    @property
    def text(self) -> str:
        """The figure in words."""
        return number_text(self.value)

    def verdict(self, ours: Estimate) -> str:
        """Return "reproduced" if the two means differ by no more than their errors at 95 %."""
        half = special.stdtrit(self.records - 1, TAILS[1]) * self.std / math.sqrt(self.records)
        least = math.hypot(ours.value - ours.low, half)
        most = math.hypot(ours.high - ours.value, half)
        return REPRODUCED if ours.value - least <= self.value <= ours.value + most else NOT


@dataclass(frozen=True)
class PrintedRatio:
    """A quotient of two printed figures, whose uncertainty is unknown."""

    value: float

    @property
    def text(self) -> str:
        """The figure in words."""
        return number_text(self.value)

    def verdict(self, ours: Estimate) -> str:
        """Return "reproduced" if it lies in our interval, or "not told apart" if this interval includes one.

        Outside our interval it is "in order only" if that and the print lie on the same side of one.
        """
        same = ours.low <= 1.0 <= ours.high
        if ours.low <= self.value <= ours.high:
            return OPEN if same else REPRODUCED
        return IN_ORDER if not same and (self.value < 1.0) == (ours.value < 1.0) else NOT


@dataclass(frozen=True)
class Said:
    """A statement of the text without a number, which says that our value lies between two limits, themselves excluded."""

    text: str
    low: float = -math.inf
    high: float = math.inf

    def verdict(self, ours: Estimate) -> str:
        """Return "reproduced" if our interval lies within the limits, and "not told apart" if it crosses one."""
        above = self.low == -math.inf or ours.low > self.low
        below = self.high == math.inf or ours.high < self.high
        if above and below:
            return REPRODUCED
        outside = (not above and ours.high <= self.low) or (not below and ours.low >= self.high)
        return NOT if outside else OPEN


SMALLER, LARGER = Said("smaller", high=1.0), Said("larger", low=1.0)
Print = Printed | PrintedMean | PrintedRatio | Said


def capped_rms(errors: Array, cap: float, about_mean: bool = False, bound: float = math.nan) -> Estimate:
    """Compute the capped RMS of errors (R,), about zero, or about their mean with R - 1.

    NaN marks lost runs, which count as the cap, and so does an error beyond it. Fewer than LEAST_INTERVAL runs have no interval.
    """
    known = np.isfinite(errors)
    runs, lost = int(known.sum()), int((~known).sum())
    if runs < 2:
        return Estimate(math.nan, math.nan, math.nan, runs, lost, bound)
    squares = losses.capped(errors - (errors[known].mean() if about_mean else 0.0), cap)
    if about_mean:
        squares = squares * len(errors) / (len(errors) - 1)
    return of_losses(squares, cap)._replace(runs=runs, lost=lost, bound=bound)


def of_losses(squares: Array, cap: float = math.inf) -> Estimate:
    """Compute the root of the mean loss (R,), which the cap limits. Fewer than LEAST_INTERVAL runs have no interval."""
    value, (low, high) = _known(losses.score(squares, cap), len(squares))
    return Estimate(value, low, high, len(squares))


def mean(values: Array) -> Estimate:
    """Compute the mean of values (R,); NaN marks lost runs, which are left out."""
    return _of_known(values, exact.mean)


def median(values: Array) -> Estimate:
    """Compute the median of values (R,), of which some may be inf; NaN marks lost runs, which are left out."""
    return _of_known(values, exact.median)


def _of_known(values: Array, statistic: Callable[[Array], resampling.Estimate]) -> Estimate:
    known = values[~np.isnan(values)]
    lost = len(values) - len(known)
    if len(known) < 2:
        return Estimate(math.nan, math.nan, math.nan, len(known), lost)
    value, (low, high) = statistic(known)
    return Estimate(value, low, high, len(known), lost)


def ratio(a: Array, b: Array, lost: int = 0) -> Estimate:
    """Compute the ratio of RMS of two filters from their losses (R,) in the same runs, with the p value of no difference.

    Fewer than LEAST_INTERVAL runs have no interval. ``lost`` is the number of runs that one of them lost.
    """
    value, (low, high) = _known(exact.ratio_by_flips(a, b), len(a))
    return Estimate(value, low, high, len(a) - lost, lost, p=exact.sign_flips(a, b))


def _known(found: resampling.Estimate, runs: int) -> resampling.Estimate:
    """Return an estimate with its interval, or without one for few runs."""
    return found if runs >= LEAST_INTERVAL else (found[0], NO_INTERVAL)


def band(printed: Printed, ours: Estimate) -> tuple[float, float]:
    """Return the limits within which a print with so few records differs from ours by chance alone.

    They hold 95 % of such prints, or 92.5 % of prints of one record. Both errors are independent, so that their distances
    on a logarithmic scale add in squares (Zou and Donner 2008, "MOVER", doi 10.1002/sim.3095). An RMS of Gaussian errors is
    s sqrt(chi^2 / dof).
    """
    below_mean, above_mean = (LUCK if printed.records == 1 else TAILS[0]), TAILS[1]
    low, high = 0.5 * np.log(special.chdtri(printed.dof, 1.0 - np.array([below_mean, above_mean])) / printed.dof)
    with np.errstate(divide="ignore", invalid="ignore"):
        below = math.hypot(np.log(np.float64(ours.value) / ours.low), low)
        above = math.hypot(np.log(np.float64(ours.high) / ours.value), high)
    return ours.value * math.exp(-below), ours.value * math.exp(above)


def fits(printed: Printed, ours: Estimate) -> bool:
    """Return whether the print lies in the band around ours."""
    low, high = band(printed, ours)
    return low <= abs(printed.value) <= high


def larger(a: Printed, b: Printed) -> bool:
    """Return whether the print ``a`` is significantly larger than ``b`` in the two-sided F test at 95 %."""
    return abs(a.value) > abs(b.value) * math.sqrt(special.fdtri(a.dof, b.dof, TAILS[1]))


def verdicts(printed: Sequence[Print | None], ours: Sequence[Estimate]) -> list[str]:
    """Return a verdict on each line of a group; empty for a line without a printed figure.

    A print that fits only because our interval is wide is not told apart. An RMS is "in order only" if some lines differ from it
    significantly, both in the print and by our intervals. All of them must do so in the same order. Two filters get no verdict
    from fewer than LEAST_VERDICT runs. That one of them is better must hold at 95 % for all such statements of the group
    together (Holm).
    """
    sides = [i for i, line in enumerate(printed) if _takes_side(line) and not math.isnan(ours[i].p)]
    adjusted = dict(zip(sides, exact.holm([ours[i].p for i in sides]), strict=True))
    return [_verdict(i, printed, ours, adjusted.get(i, 0.0)) for i in range(len(ours))]


def _takes_side(line: Print | None) -> bool:
    """Return whether a print says that one of two filters is better."""
    return isinstance(line, Said) and 1.0 in (line.low, line.high)


def _verdict(i: int, printed: Sequence[Print | None], ours: Sequence[Estimate], p: float) -> str:
    line = printed[i]
    if line is None:
        return ""
    if math.isnan(ours[i].low):
        return f"{ours[i].runs} runs are too few" if ours[i].runs else "not measured"
    if not math.isnan(ours[i].p) and ours[i].runs + ours[i].lost < LEAST_VERDICT:
        return PRELIMINARY
    if not isinstance(line, Printed):
        return OPEN if p > exact.LEVEL and ours[i].low != ours[i].high else line.verdict(ours[i])
    if fits(line, ours[i]):
        return REPRODUCED if fits(line, ours[i]._replace(low=ours[i].value, high=ours[i].value)) else OPEN
    same = opposite = 0
    for other, estimate in zip(printed, ours, strict=True):
        if not isinstance(other, Printed) or other.kind != line.kind:
            continue
        above, below = ours[i].low > estimate.high, ours[i].high < estimate.low
        same += (above and larger(line, other)) or (below and larger(other, line))
        opposite += (below and larger(line, other)) or (above and larger(other, line))
    return IN_ORDER if same and not opposite else NOT
