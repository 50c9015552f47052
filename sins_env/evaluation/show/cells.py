"""Cells of tables: what one column says of one solver, as text for people; the forms of a table only lay it out."""

from __future__ import annotations

import math
from typing import NamedTuple

from sins_env.evaluation.score.consistency import Nees
from sins_env.evaluation.score.metrics import Summary
from sins_env.evaluation.score.resampling import Estimate
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.numbers import angle, angle_interval, interval, number, seconds, seconds_interval


class Cell(NamedTuple):
    """A value, and what goes with it."""

    value: str  #: parts after ", " stand on lines of their own where there is room below
    below: str = ""  #: an interval, or of how many runs
    note: str = ""  #: a warning in one word
    mark: str = ""  #: good, fair, bad, none where there is nothing to tell, or empty


def runs(one: Results) -> Cell:
    """How many runs there are."""
    return Cell(str(one.summary.runs))


def success(one: Results) -> Cell:
    """The share of aligned runs."""
    return Cell(success_text(one.summary))


def aligned(one: Results) -> Cell:
    """The share of aligned runs, and of how many it is."""
    s = one.summary
    mark = "" if not s.scored else "good" if s.success >= 0.95 else "fair" if s.success >= 0.5 else "bad"
    return Cell(success_text(s), f"of {s.runs}", mark=mark)


def success_text(s: Summary) -> str:
    """Whole per cent; '-' where nothing is scored."""
    return f"{100 * s.success:.0f} %" if s.scored else "-"


def median_time(one: Results) -> Cell:
    """Median time to alignment, s."""
    return Cell(seconds(one.summary.t_conv_median_s), seconds_interval(one.summary.t_conv_ci_s))


def estimate(value: Estimate, unit: str) -> Cell:
    """A number with its interval, in ``unit``; large numbers of arcsec are shown as degrees."""
    as_angle = unit == "arcsec"
    return Cell((angle if as_angle else number)(value[0]), (angle_interval if as_angle else interval)(value[1]))


def bound_ratio(one: Results) -> Cell:
    """The main score over its bound, in brackets where the bound is a reference only."""
    text = number(one.headline_ratio)
    shown = f"({text})" if one.bound and not one.bound.holds else text
    return Cell(shown, note="below", mark="bad") if one.below_bound else Cell(shown)


def nees(found: tuple[Nees, ...], dof: int) -> Cell:
    """Mean NEES at the end over its expectation; '-' where it is not scored."""
    if not found:
        return Cell("-")
    last = found[-1]
    text = "inf" if math.isinf(last.mean) else number(last.mean / dof)
    return Cell(text, mark="good") if last.inside else Cell(text, note="outside", mark="fair")


def failures(one: Results) -> Cell:
    """How many runs failed, and how."""
    return Cell(failure_text(one.summary), mark="bad" if one.summary.failures else "none")


def failure_text(summary: Summary) -> str:
    """'2 diverged, 1 raised', or '0'."""
    parts = [f"{count} {name}" for name, count in summary.counts.items() if count and name != "any"]
    return ", ".join(parts) or "0"


def cost(one: Results) -> Cell:
    """Time of a step over that of ``ckf``."""
    return Cell(number(one.cost.ratio, 2) if one.cost and one.cost.ratio is not None else "-")


def spread(one: Results) -> Cell:
    """Standard deviation of the heading in degrees, with its interval, or of how many runs where some have none."""
    found = one.spread
    below = f"of {found.runs}" if found.runs < one.summary.runs else ""
    if one.task.records:
        low, high = found.interval
        below = "" if math.isnan(low) else f"{number(low)}–{number(high)}"
    return Cell(number(found.deg), below)
