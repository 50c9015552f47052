"""The one list of score columns. Terminal, Markdown, CSV, JSON and the HTML report iterate over COLUMNS.

A new score is one entry. For a number with its interval ``estimate(key, title, unit, value)`` is enough, and all five forms
show it. The function ``value`` computes it from ``one.records`` and ``one.summary``; ``one`` is the :class:`Results` of a
solver.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

from sins_env.evaluation.score.consistency import Nees
from sins_env.evaluation.score.headline import headline
from sins_env.evaluation.score.navigation import Navigation
from sins_env.evaluation.score.quantities import QUANTITIES
from sins_env.evaluation.score.ranking import failure_rate
from sins_env.evaluation.score.repeatability import shares_headings
from sins_env.evaluation.score.resampling import Estimate
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show import cells
from sins_env.evaluation.show.cells import Cell
from sins_env.evaluation.speed.cost import YARDSTICK
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.states import ATTITUDE, NAVIGATION


class Slot(IntEnum):
    """Slot of a column in a table, from left to right; columns of one slot keep their order in the list."""

    FAILURES = 0
    SCORE = 1
    BOUND = 2
    TYPICAL = 3
    PAIR = 4
    TIME = 5
    COST = 6
    ALIGNED = 7
    CONSISTENCY = 8
    ERRORS = 9
    SPREAD = 10


TABLE_FORMS = TERMINAL, MARKDOWN, PAGE = "terminal", "Markdown", "page"


@dataclass(frozen=True)
class Column:
    """One score of a solver, and how each form shows it."""

    key: str
    title: str = ""
    unit: str = ""
    slot: Slot = Slot.ERRORS
    #: Cell of a solver in a table; None if only CSV and JSON have the score.
    cell: Callable[[Results], Cell] | None = None
    tables: tuple[str, ...] = TABLE_FORMS
    markdown: str = ""  #: heading in Markdown, if it differs from title and unit
    #: Text that the page shows in small type below the title, instead of the unit.
    about: Callable[[Results], str] | None = None
    #: False for alignment only, True for navigation only, None for both. CSV has the alignment scores of every task, JSON
    #: only those that navigation does not replace.
    navigates: bool | None = None
    known: Callable[[Results], bool] = lambda one: True  #: a table has the column if this holds for any of its solvers
    #: Whether this is the score that the task is about, which is always shown with its interval.
    main: Callable[[EvaluationTask], bool] = lambda task: False
    drop: int = 0  #: order in which a narrow terminal leaves columns out, from 1; 0 is never left out
    part: str = ""  #: name in the line that lists what was left out; columns of one part are left out together
    intervals: str = ""  #: name of the intervals that go before any column does; empty if this one's intervals stay
    csv: tuple[str, ...] = ()  #: headings of ``figures``
    figures: Callable[[Results], Sequence[Any]] = lambda one: ()
    json: Callable[[Results], dict[str, Any]] = lambda one: {}  #: entries in JSON; objects under one key are merged

    def holds(self, one: Results) -> bool:
        """Return whether CSV and JSON have the score for this solver's task."""
        return not self.navigates or one.records.criteria.navigates

    def shown(self, one: Results) -> Cell:
        """Return the cell of the solver in a table."""
        assert self.cell is not None
        return self.cell(one)

    def stays(self, task: EvaluationTask) -> bool:
        """Return whether a table of the task keeps the column at any width."""
        return not self.drop or self.main(task)


def table_columns(group: Sequence[Results], form: str) -> list[Column]:
    """Return the columns of a table of one task's solvers, from left to right; ``form`` is one of TABLE_FORMS."""
    kinds = (None, group[0].records.criteria.navigates)
    there = [one for one in COLUMNS if one.cell and form in one.tables and one.navigates in kinds]
    return sorted((column for column in there if any(map(column.known, group))), key=lambda column: column.slot)


def data_columns(results: Sequence[Results]) -> list[Column]:
    """Return the columns of CSV and JSON; those of navigation only if any of the tasks navigates."""
    return [column for column in COLUMNS if any(map(column.holds, results))]


def navigation(one: Results) -> Navigation:
    """Return the navigation scores of a solver whose task navigates."""
    assert one.summary.navigation is not None
    return one.summary.navigation


def finite(value: float) -> float | None:
    """Return the value for JSON: None, which becomes null, if it is unknown or infinite."""
    return value if math.isfinite(value) else None


def sign(unit: str) -> str:
    """Return a unit as the terminal and Markdown show it."""
    return '"' if unit == "arcsec" else unit


def word(unit: str) -> str:
    """Return a unit as part of a key; 'm/s' becomes 'm_per_s'."""
    return unit.replace("/", "_per_")


def estimate(key: str, title: str, unit: str, value: Callable[[Results], Estimate], **more: Any) -> Column:
    """Make the column of a score with its interval in ``unit``, in all forms; ``more`` replaces fields of the column."""

    def figures(one: Results) -> tuple[float, ...]:
        found, ends = value(one)
        return (found, *ends)

    def json(one: Results) -> dict[str, Any]:
        found, *ends = figures(one)
        return {name: finite(found), f"{key}_ci": [finite(end) for end in ends]}

    name = f"{key}_{word(unit)}" if unit else key
    usual: dict[str, Any] = {
        "cell": lambda one: cells.with_interval(value(one), unit), "drop": 12, "part": title, "intervals": "the other errors",
        "csv": (name, f"{key}_low", f"{key}_high"), "figures": figures, "json": json,
    }  # fmt: skip
    return Column(key, title, unit, **{**usual, **more})


def _rms(axis: str, name: str, **more: Any) -> Column:
    def value(one: Results) -> Estimate:
        return one.summary.rms[axis], one.summary.rms_ci[axis]

    def json(one: Results) -> dict[str, Any]:
        rms, ends = value(one)
        return {"rms": {axis: finite(rms)}, "rms_ci": {axis: [finite(end) for end in ends]}}

    key = f"rms_{axis.lower()}"
    return estimate(key, f"{name} RMS", "arcsec", value, navigates=False, known=scored, json=json, **more)


#: Navigation errors that tables show, each with its ``drop`` and its ``part``.
_SHOWN = {
    "azimuth": (5, "heading"), "level": (2, "level"),
    "position_h": (5, "position"), "position_v": (1, "vertical errors"),
    "velocity_h": (3, "velocity"), "velocity_v": (1, "vertical errors"),
}  # fmt: skip


def _armse(name: str) -> Column:
    quantity = QUANTITIES[name]

    def value(one: Results) -> Estimate:
        found, (low, high) = navigation(one).armse[name]
        return found / quantity.unit, (low / quantity.unit, high / quantity.unit)

    def json(one: Results) -> dict[str, Any]:
        found, ends = value(one)
        told = {"armse": finite(found), "armse_ci": [finite(end) for end in ends], "armse_unit": quantity.unit_name}
        return {key: {name: one_told} for key, one_told in told.items()}

    drop, part = _SHOWN.get(name, (0, ""))
    return estimate(
        f"armse_{name}", quantity.name, quantity.unit_name, value, navigates=True, drop=drop, part=part, json=json,
        tables=TABLE_FORMS if name in _SHOWN else (),
    )  # fmt: skip


def _figure(key: str, value: Callable[[Results], Any], json: bool = False) -> Column:
    """Make the column of a navigation score that no table shows: it is in CSV and perhaps in JSON."""
    told = (lambda one: {key: finite(value(one))}) if json else lambda one: {}
    return Column(key, navigates=True, csv=(key,), figures=lambda one: (value(one),), json=told)


def _rms_of_span(name: str) -> Column:
    unit = QUANTITIES[name].unit
    return _figure(f"rms_{name}_{word(QUANTITIES[name].unit_name)}", lambda one: navigation(one).rms[name][0] / unit)


def _over_bound(name: str) -> Column:
    def value(one: Results) -> float:
        return navigation(one).armse[name][0] / one.bound_means.get(name, math.nan)

    return _figure(f"bound_ratio_{name}", value)


def _median_heading(one: Results) -> Estimate:
    value, (low, high) = navigation(one).median_azimuth
    return math.degrees(value), (math.degrees(low), math.degrees(high))


def _told(key: str, title: str, slot: Slot, cell: Callable[[Results], Cell], **more: Any) -> Column:
    """Make the column of a figure of the verdict, whose interval has the same name with ``_ci``."""

    def figures(one: Results) -> tuple[float, ...]:
        return (getattr(one.verdict, key), *getattr(one.verdict, f"{key}_ci"))

    def json(one: Results) -> dict[str, Any]:
        found, *ends = figures(one)
        return {key: finite(found), f"{key}_ci": [finite(end) for end in ends]}

    usual: dict[str, Any] = {
        "part": title, "known": scored, "csv": (key, f"{key}_low", f"{key}_high"), "figures": figures, "json": json,
    }  # fmt: skip
    return Column(key, title, slot=slot, cell=cell, **{**usual, **more})


def scored(one: Results) -> bool:
    """Return whether the errors of a solver are scored."""
    return one.summary.scored


def scoring(one: Results) -> int:
    """Return the version of the scoring: 1 if the errors are scored, but not capped, because the rows lack a bound or the error."""
    return 2 if one.verdict.capped or not one.summary.scored else 1


#: Figures of the comparison in CSV and JSON, with their names in the verdict.
_PAIR = {"common": "common", "p": "p", "p_adjusted": "p_adjusted", "verdict": "word", "fragile": "fragile",
         "preliminary": "preliminary", "rank": "rank", "beaten_by": "beaten_by"}  # fmt: skip


def _pair_json(one: Results) -> dict[str, Any]:
    told = {name: getattr(one.verdict, field) for name, field in _PAIR.items()}
    return {
        **told,
        "below_bound": one.verdict.below_bound,
        "rms_raw": finite(one.verdict.rms_raw),
        "scoring": scoring(one),
    }


def _pair_figures(one: Results) -> list[Any]:
    found = _pair_json(one)
    return [found[name] for name in _PAIR_CSV]


_PAIR_CSV = (*(name for name in _PAIR if name != "rank"), "rms_raw", "scoring")


def _bound_figures(one: Results) -> tuple[Any, ...]:
    return (*one.bound_ratio.values(), bool(one.bound.holds) if one.bound else None, one.below_bound)


def _nees(key: str, dof: int, found: Callable[[Results], tuple[Nees, ...]], navigates: bool) -> Column:
    def figures(one: Results) -> tuple[Any, ...]:
        return (found(one)[-1].mean / dof, found(one)[-1].inside) if found(one) else (None, None)

    return Column(
        f"{key}_over_{dof}", f"NEES / {dof}", "", Slot.CONSISTENCY, lambda one: cells.consistency(found(one), dof), drop=4,
        part="NEES", known=lambda one: bool(found(one)), navigates=navigates, csv=(f"{key}_over_{dof}", f"{key}_in_band"),
        figures=figures,
    )  # fmt: skip


def _times(one: Results) -> tuple[float, ...]:
    s = one.summary
    return (s.t_conv_median_s, *s.t_conv_ci_s, s.t_conv_restricted_mean_s)


_COUNTS = ("diverged", "frozen", "raised", "lost", "repaired")

#: Every score column, in the order of CSV and JSON.
COLUMNS: list[Column] = [
    _told("failed", "failed", Slot.FAILURES, cells.failed, known=lambda one: True),
    _told("aligned", "aligned", Slot.ALIGNED, cells.aligned, drop=4, intervals="aligned"),
    _told(
        "score", "score", Slot.SCORE, cells.score, main=lambda task: True,
        about=lambda one: QUANTITIES[headline(one.task)].name if one.records.criteria.navigates else "azimuth",
    ),
    _told("median", "median", Slot.TYPICAL, cells.median, drop=9, intervals="median"),
    _told("time_s", "time", Slot.TIME, cells.median_time, unit="s", navigates=False, drop=8, intervals="time"),
    _told("x_bound", "x bound", Slot.BOUND, cells.x_bound, drop=10, known=lambda one: one.bound is not None),
    _told(
        "ratio", f"score / {YARDSTICK}", Slot.PAIR, cells.against, part="ratio", drop=6, intervals="ratio",
        known=lambda one: math.isfinite(one.verdict.ratio), csv=("ratio", "ratio_low", "ratio_high"),
    ),
    Column(
        "verdict", f"against {YARDSTICK}", "", Slot.PAIR, cells.verdict, drop=11, part="verdict", csv=_PAIR_CSV,
        figures=_pair_figures, json=_pair_json,
        known=lambda one: one.verdict.capped,
    ),
    Column("runs", csv=("runs",), figures=lambda one: (one.summary.runs,), json=lambda one: {"runs": one.summary.runs}),
    Column(
        "success", csv=("success",), figures=lambda one: (one.summary.success,),
        json=lambda one: {"success": finite(one.summary.success)},
    ),
    Column(
        "t_conv_median", navigates=False,
        csv=("t_conv_median_s", "t_conv_low_s", "t_conv_high_s", "t_conv_restricted_mean_s"), figures=_times,
        json=lambda one: {"t_conv_median_s": finite(one.summary.t_conv_median_s)},
    ),
    _rms("E", "east", drop=3, part="east and north", intervals="east and north"),
    _rms("N", "north", drop=3, part="east and north", intervals="east and north"),
    _rms("U", "azimuth", tables=()),
    Column(
        "bound_ratio", json=lambda one: {"bound_ratio": finite(one.headline_ratio)}, figures=_bound_figures,
        csv=("bound_ratio_e", "bound_ratio_n", "bound_ratio_u", "bound_holds", "below_bound"),
    ),
    _nees("nees", ATTITUDE.size, lambda one: one.summary.nees, navigates=False),
    Column(
        "spread", "heading spread", "°", Slot.SPREAD, cells.spread, markdown="spread, deg",
        known=lambda one: shares_headings(one.task), csv=("spread_deg", "spread_runs"),
        figures=lambda one: (one.spread.deg, one.spread.runs),
    ),
    Column(
        "failures", csv=_COUNTS, figures=lambda one: [one.summary.counts[name] for name in _COUNTS],
        json=lambda one: {"failures": one.summary.failures},
    ),
    Column("fallbacks", csv=("fallbacks",), figures=lambda one: (one.summary.fallbacks,)),
    Column(
        "cost", f"cost / {YARDSTICK}", "", Slot.COST, cells.cost, drop=7, part="cost",
        csv=("cost_us", "cost_p95_us", "cost_ratio"), figures=lambda one: one.cost or (None,) * 3,
        json=lambda one: {"cost_ratio": one.cost.ratio if one.cost else None},
    ),
    *map(_armse, QUANTITIES),
    *map(_rms_of_span, QUANTITIES),
    *map(_over_bound, QUANTITIES),
    _figure("median_heading_deg", lambda one: _median_heading(one)[0], json=True),
    _figure("failure_rate", failure_rate, json=True),
    _nees("nees_all", NAVIGATION.size, lambda one: one.summary.nees_of_all, navigates=True),
]  # fmt: skip
