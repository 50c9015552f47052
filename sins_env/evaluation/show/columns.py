"""What tables say, in the words of all of them: numbers, intervals, columns of errors, and the lines below a table."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from sins_env.evaluation.score.consistency import Nees
from sins_env.evaluation.score.metrics import Summary
from sins_env.evaluation.score.quantities import QUANTITIES
from sins_env.evaluation.score.ranking import about, by_failures, headline
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.numbers import angle, angle_interval, interval, number
from sins_env.evaluation.tasks.task import EvaluationTask


class Column(NamedTuple):
    """Of errors: a value with its interval for each solver."""

    name: str
    unit: str
    cell: Callable[[Results], tuple[str, str]]
    main: bool = False  #: what the task is about
    ranks: bool = False  #: orders the solvers besides: shown wherever there is room for anything


def error_columns(one: Results) -> list[Column]:
    """What a task's solvers are scored by; ``one`` is any of them."""
    if one.summary.navigation is None:
        return [_axial(name, axis) for name, axis in (("azimuth RMS", "U"), ("east RMS", "E"), ("north RMS", "N"))]
    names = ("azimuth", "level", "position_h", "position_v", "velocity_h", "velocity_v")
    columns = [_averaged(name, name == about(one.task)) for name in names]
    if by_failures(one.task):
        columns.insert(0, Column("median heading at the end", "deg", _median, ranks=True))
    return columns


def _axial(name: str, axis: str) -> Column:
    def cell(one: Results) -> tuple[str, str]:
        return angle(one.summary.rms[axis]), angle_interval(one.summary.rms_ci[axis])

    return Column(name, '"', cell, axis == "U")


def _averaged(name: str, main: bool) -> Column:
    quantity = QUANTITIES[name]
    level = quantity.unit_name == "arcsec"

    def cell(one: Results) -> tuple[str, str]:
        assert one.summary.navigation is not None
        value, ci = one.summary.navigation.armse[name]
        ends = ci[0] / quantity.unit, ci[1] / quantity.unit
        return (angle if level else number)(value / quantity.unit), (angle_interval if level else interval)(ends)

    return Column(quantity.name, '"' if level else quantity.unit_name, cell, main)


def _median(one: Results) -> tuple[str, str]:
    assert one.summary.navigation is not None
    value, ci = one.summary.navigation.median_azimuth
    return number(math.degrees(value)), interval((math.degrees(ci[0]), math.degrees(ci[1])))


def failure_text(summary: Summary) -> str:
    """'2 diverged, 1 raised', or '0'."""
    parts = [f"{count} {name}" for name, count in summary.counts.items() if count and name != "any"]
    return ", ".join(parts) or "0"


def nees_text(summary: Summary) -> tuple[str, bool | None]:
    """Mean NEES at T over its expectation, and whether it is in its band; '-' and None: not scored."""
    found, dof = nees_of(summary)
    if not found:
        return "-", None
    last = found[-1]
    return ("inf" if math.isinf(last.mean) else number(last.mean / dof)), last.inside


def nees_of(summary: Summary) -> tuple[tuple[Nees, ...], int]:
    """NEES of all that is scored, and its expectation: 3 of attitude, 9 with velocity and position."""
    return (summary.nees, 3) if summary.navigation is None else (summary.navigation.nees, 9)


def bound_text(one: Results) -> tuple[str, bool | None]:
    """The main score over its bound, in brackets over what is only a reference; whether that is too good; '-': none."""
    text = number(bound_ratio(one))
    return (f"({text})" if one.bound and not one.bound.holds else text), one.below_bound


def bound_ratio(one: Results) -> float:
    """Of the azimuth RMS, or of the ARMSE that a navigation task is about; NaN without a bound."""
    navigation, name = one.summary.navigation, headline(one.task)
    if navigation is None:
        return one.bound_ratio["U"]
    return navigation.armse[name][0] / one.bound_means.get(name, math.nan)


def cost_text(one: Results) -> str:
    return number(one.cost.ratio, 2) if one.cost and one.cost.ratio is not None else "-"


def has_spread(task: EvaluationTask) -> bool:
    """Whether runs of the task have headings in common."""
    return task.windows > 1 or task.records > 1


def spread_of(one: Results) -> tuple[float, int]:
    """Standard deviation of the heading, deg, at the same heading where there are records, and of how many runs."""
    if one.task.records:
        return one.repeatability[-1].deg, one.repeatability[-1].runs
    return one.summary.spread_deg, one.summary.spread_runs


def spread_text(one: Results) -> tuple[str, str]:
    """Spread of the heading in degrees, and of how many runs where some have none; of records its interval."""
    deg, runs = spread_of(one)
    if one.task.records:
        low, high = one.repeatability[-1].interval
        return number(deg), "" if math.isnan(low) else f"{number(low)}–{number(high)}"
    return number(deg), f"of {runs}" if runs < one.summary.runs else ""


def success_text(s: Summary) -> str:
    return f"{100 * s.success:.0f} %" if s.scored else "-"


def bound_heading(one: Results) -> str:
    return "RMS / bound" if one.summary.navigation is None else "error / bound"


def bound_of(one: Results) -> str:
    """What the bound's column is about."""
    return "azimuth" if one.summary.navigation is None else QUANTITIES[headline(one.task)].name
