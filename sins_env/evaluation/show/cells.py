"""Cells of tables: the entry of one solver in one column, as text for people. The forms of a table only lay them out."""

from __future__ import annotations

import math
from typing import NamedTuple

from sins_env.evaluation.score.consistency import Nees
from sins_env.evaluation.score.headline import headline
from sins_env.evaluation.score.metrics import Summary
from sins_env.evaluation.score.quantities import QUANTITIES
from sins_env.evaluation.score.resampling import Estimate, Interval
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.score.verdicts import LEAST_INTERVAL
from sins_env.evaluation.show.numbers import (
    angle_interval_text,
    angle_text,
    interval_text,
    number_text,
    p_text,
    percent_interval_text,
    seconds_interval_text,
    seconds_text,
)
from sins_env.units import ARCSEC


class Cell(NamedTuple):
    """Value of a table cell with its interval, warning and mark."""

    value: str  #: text of the value; the terminal puts each part after ", " on a line of its own
    below: str = ""  #: interval, or the number of runs behind the value
    note: str = ""  #: warning in one word
    mark: str = ""  #: "good", "fair", "bad", "none" for a value without interest, or empty


def failed(one: Results) -> Cell:
    """Return the number of failed runs of all, with the interval of their share."""
    told = one.verdict
    mark = "bad" if told.failures else "none"
    return Cell(f"{told.failures} of {told.runs}", percent_interval_text(told.failed_ci), mark=mark)


def aligned(one: Results) -> Cell:
    """Return the share of aligned runs, with its interval."""
    told = one.verdict
    mark = (
        "" if math.isnan(told.aligned) else "good" if told.aligned >= 0.95 else "fair" if told.aligned >= 0.5 else "bad"
    )
    return Cell(aligned_text(one), percent_interval_text(told.aligned_ci), mark=mark)


def aligned_text(one: Results) -> str:
    """Return the share of aligned runs in whole per cent; '-' if errors are not scored."""
    return "-" if math.isnan(one.verdict.aligned) else f"{100 * one.verdict.aligned:.0f} %"


def median_time(one: Results) -> Cell:
    """Return the median time to alignment, s, with its interval."""
    return Cell(seconds_text(one.verdict.time_s), seconds_interval_text(one.verdict.time_s_ci))


def score(one: Results) -> Cell:
    """Return the score with its interval."""
    return _of_error(one, one.verdict.score, one.verdict.score_ci)


def median(one: Results) -> Cell:
    """Return the median error of a run with its interval."""
    return _of_error(one, one.verdict.median, one.verdict.median_ci)


def _of_error(one: Results, value: float, interval: Interval) -> Cell:
    """Return an error of the headline in rad, m/s or m as a cell with the unit of its quantity."""
    quantity = QUANTITIES[headline(one.task)]
    if not one.records.criteria.navigates:
        shown = with_interval((value / ARCSEC, (interval[0] / ARCSEC, interval[1] / ARCSEC)), "arcsec")
        known = math.isfinite(value) and not shown.value.endswith("°")
        return shown._replace(value=f'{shown.value}"') if known else shown
    scaled = value / quantity.unit, (interval[0] / quantity.unit, interval[1] / quantity.unit)
    shown = with_interval(scaled, quantity.unit_name)
    return shown._replace(value=f"{shown.value} {quantity.unit_name}") if math.isfinite(value) else shown


def against(one: Results) -> Cell:
    """Return the score over that of the yardstick in common runs, with its interval."""
    return Cell(number_text(one.verdict.ratio), interval_text(one.verdict.ratio_ci))


def verdict(one: Results) -> Cell:
    """Return who wins, the solver or the yardstick, and how sure that is."""
    told = one.verdict
    if told.word is not None and told.p_adjusted is not None:
        mark = {"wins": "good", "loses": "bad"}.get(told.word, "none")
        text = f"{'open' if told.word == 'undecided' else told.word}, {p_text(told.p_adjusted)}"
        return Cell(text + (", fragile" if told.fragile else ""), mark=mark)
    if told.preliminary and told.capped:
        return Cell("preliminary" if told.runs >= LEAST_INTERVAL else "few runs", mark="none")
    return Cell("-", mark="none")


def with_interval(value: Estimate, unit: str) -> Cell:
    """Return a number with its interval, in ``unit``; large numbers of arcsec are shown as degrees."""
    if unit == "arcsec":
        return Cell(angle_text(value[0]), angle_interval_text(value[1], value[0]))
    return Cell(number_text(value[0]), interval_text(value[1]))


def x_bound(one: Results) -> Cell:
    """Return the score over the bound with its interval, in brackets if the two are not comparable."""
    told = one.verdict
    text = number_text(told.x_bound)
    shown = Cell(text if one.measure.comparable else f"({text})", interval_text(told.x_bound_ci))
    return shown._replace(note="below", mark="bad") if one.below_bound else shown


def consistency(found: tuple[Nees, ...], dof: int) -> Cell:
    """Return the mean NEES at the end over its expectation ``dof``; '-' without a NEES."""
    if not found:
        return Cell("-")
    last = found[-1]
    text = "inf" if math.isinf(last.mean) else number_text(last.mean / dof)
    return Cell(text, mark="good") if last.inside else Cell(text, note="outside", mark="fair")


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
