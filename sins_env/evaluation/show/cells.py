"""Cells of tables: the entry of one solver in one column, as text for people. The forms of a table only lay them out."""

from __future__ import annotations

import math
from typing import NamedTuple

from sins_env.evaluation.score.consistency import Nees
from sins_env.evaluation.score.metrics import Summary
from sins_env.evaluation.score.resampling import Estimate
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.numbers import (
    angle_interval_text,
    angle_text,
    interval_text,
    number_text,
    seconds_interval_text,
    seconds_text,
)


class Cell(NamedTuple):
    """Value of a table cell with its interval, warning and mark."""

    value: str  #: text of the value; the terminal puts each part after ", " on a line of its own
    below: str = ""  #: interval, or the number of runs behind the value
    note: str = ""  #: warning in one word
    mark: str = ""  #: "good", "fair", "bad", "none" for a value without interest, or empty


def runs(one: Results) -> Cell:
    """Return the number of runs."""
    return Cell(str(one.summary.runs))


def success(one: Results) -> Cell:
    """Return the share of aligned runs."""
    return Cell(success_text(one.summary))


def aligned(one: Results) -> Cell:
    """Return the share of aligned runs, with the number of runs."""
    s = one.summary
    mark = "" if not s.scored else "good" if s.success >= 0.95 else "fair" if s.success >= 0.5 else "bad"
    return Cell(success_text(s), f"of {s.runs}", mark=mark)


def success_text(s: Summary) -> str:
    """Return the share of aligned runs in whole per cent; '-' if errors are not scored."""
    return f"{100 * s.success:.0f} %" if s.scored else "-"


def median_time(one: Results) -> Cell:
    """Return the median time to alignment, s, with its interval."""
    return Cell(seconds_text(one.summary.t_conv_median_s), seconds_interval_text(one.summary.t_conv_ci_s))


def with_interval(value: Estimate, unit: str) -> Cell:
    """Return a number with its interval, in ``unit``; large numbers of arcsec are shown as degrees."""
    as_angle = unit == "arcsec"
    return Cell(
        (angle_text if as_angle else number_text)(value[0]),
        (angle_interval_text if as_angle else interval_text)(value[1]),
    )


def bound_ratio(one: Results) -> Cell:
    """Return the main score over its bound, in brackets if the bound is only a reference."""
    text = number_text(one.headline_ratio)
    shown = f"({text})" if one.bound and not one.bound.holds else text
    return Cell(shown, note="below", mark="bad") if one.below_bound else Cell(shown)


def consistency(found: tuple[Nees, ...], dof: int) -> Cell:
    """Return the mean NEES at the end over its expectation ``dof``; '-' without a NEES."""
    if not found:
        return Cell("-")
    last = found[-1]
    text = "inf" if math.isinf(last.mean) else number_text(last.mean / dof)
    return Cell(text, mark="good") if last.inside else Cell(text, note="outside", mark="fair")


def failures(one: Results) -> Cell:
    """Return the number of failed runs by kind of failure."""
    return Cell(failure_text(one.summary), mark="bad" if one.summary.failures else "none")


def failure_text(summary: Summary) -> str:
    """Return a text such as '2 diverged, 1 raised', or '0'."""
    parts = [f"{count} {name}" for name, count in summary.counts.items() if count and name != "any"]
    return ", ".join(parts) or "0"


def cost(one: Results) -> Cell:
    """Return the time of a step over that of ``ckf``; '-' if it is not known."""
    return Cell(number_text(one.cost.ratio, 2) if one.cost and one.cost.ratio is not None else "-")


def spread(one: Results) -> Cell:
    """Return the standard deviation of the heading, deg.

    A task with records has the interval below. Other tasks have the number of runs below, if some have no final heading.
    """
    found = one.spread
    below = f"of {found.runs}" if found.runs < one.summary.runs else ""
    if one.task.records:
        low, high = found.interval
        below = "" if math.isnan(low) else f"{number_text(low)}–{number_text(high)}"
    return Cell(number_text(found.deg), below)
