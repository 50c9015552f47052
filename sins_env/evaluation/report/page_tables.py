"""Rows of the tables in the report, with the cells of the terminal's tables."""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from sins_env.evaluation.report.panel import Lineup, Look
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.cells import Cell
from sins_env.evaluation.show.columns import PAGE, Column, table_columns

AXIS = 5.0  #: end of the axis of intervals, over the median RMS
_WHEN = re.compile(r",? at (\d+(?:\.\d+)?) s\b")


class Whisker(NamedTuple):
    """Main score with its interval on the log axis of its column, as shares of the width; above 1 it is off the axis."""

    value: float
    low: float
    high: float
    bound: float | None


class Row(NamedTuple):
    """Row of a table: one solver."""

    rank: str
    name: str
    more: list[str]  #: module and settings of the solver, a line each
    look: Look | None
    whisker: Whisker | None
    cells: list[Cell]
    preliminary: bool  #: whether its runs are too few for a verdict


class Failure(NamedTuple):
    """Runs of one solver that failed for one reason."""

    solver: str
    status: str
    reason: str
    runs: int
    which: str
    when: str


def with_unit(text: str, unit: str) -> str:
    """Return a number with the unit that tables leave out."""
    return text if text.endswith("°") else f"{text}″" if unit == "arcsec" else f"{text} {unit}"


def page_columns(group: Sequence[Results]) -> list[Column]:
    """Return the columns to the right of the solver; the main score comes first, beside its whisker."""
    return sorted(table_columns(group, PAGE), key=lambda column: not column.main(group[0].task))


def heads_of(group: Sequence[Results]) -> list[tuple[str, str]]:
    """Return the headings of the columns, each with its unit or another text in small type."""
    return [(one.title, one.about(group[0]) if one.about else one.unit) for one in page_columns(group)]


def rows_of(lines: Sequence[tuple[int | None, Results]], lineup: Lineup) -> list[Row]:
    """Return the rows of ranked results."""
    group = [one for _, one in lines]
    columns, whisker = page_columns(group), whiskers(group)
    out = []
    for rank, one in lines:
        module, _, name = one.solver.rpartition(":")
        more = ([module] if module else []) + [f"{name}={value}" for name, value in sorted(one.settings.items())]
        cells = [column.shown(one) for column in columns]
        few = one.verdict.preliminary and one.summary.scored
        out.append(Row(str(rank or "-"), name, more, lineup.looks.get(one.label), whisker(one), cells, few))
    return out


def whiskers(group: Sequence[Results]) -> Callable[[Results], Whisker | None]:
    """Return a function that places the main score of a solver and its interval on the axis.

    The axis ends at AXIS times the median, so that a few failing solvers do not hide the differences of the others.
    """
    scores = {one.label: one.main_score for one in group}
    bound = next((score.bound for score in scores.values() if math.isfinite(score.bound)), None)
    values = [score.value for score in scores.values()]
    ends = [end for score in scores.values() for end in (score.value, *score.interval)] + [bound or math.nan]
    known = [math.log(end) for end in ends if math.isfinite(end) and end > 0]
    low, high = (min(known), max(known)) if known else (0.0, 0.0)
    usual = statistics.median(values)
    if usual > 0:
        high = min(high, math.log(AXIS * usual))

    def place(value: float) -> float:
        return (math.log(value) - low) / (high - low) if value > 0 else 0.0

    def whisker(one: Results) -> Whisker | None:
        _, _, value, interval, _ = scores[one.label]
        if not math.isfinite(value) or high <= low:
            return None
        ci = [end if math.isfinite(end) else value for end in interval]
        return Whisker(place(value), place(ci[0]), place(ci[1]), place(bound) if bound else None)

    return whisker


def failures_of(group: Iterable[Results]) -> list[Failure]:
    """Return the failures, grouped by reason without its time; the most frequent come first within each solver."""
    out = []
    for one in group:
        r = one.records
        found: dict[tuple[str, str], list[tuple[int, list[float]]]] = {}
        for run, status, reason in zip(r.run, r.status, r.reason, strict=True):
            if status != "ok":
                times = [float(t) for t in _WHEN.findall(reason)]
                found.setdefault((str(status), _WHEN.sub("", reason)), []).append((int(run), times))
        repaired = r.repairs > 0
        if repaired.any():
            text = f"covariance repaired, {int(r.repairs.sum())} times in all"
            found[("repaired", text)] = [(int(run), []) for run in r.run[repaired]]
        for (status, reason), runs in sorted(found.items(), key=lambda item: (-len(item[1]), item[0])):
            times = [t for _, ts in runs for t in ts]
            when = "" if not times else f"{min(times):g}" + (f"–{max(times):g}" if max(times) > min(times) else "")
            which = ", ".join(str(run) for run, _ in runs[:8]) + (", …" if len(runs) > 8 else "")
            out.append(Failure(one.label, status, reason, len(runs), which, when))
    return out
