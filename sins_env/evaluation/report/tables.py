"""The rows of the report's tables, in the words of the terminal's (board.py)."""

from __future__ import annotations

import math
import re
import statistics
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from sins_env.evaluation.report.panel import Look, Task
from sins_env.evaluation.score import ranking
from sins_env.evaluation.score.resampling import Interval
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show import columns, numbers
from sins_env.units import ARCSEC

AXIS = 5.0  #: the column of intervals ends at so many times the median RMS
_WHEN = re.compile(r",? at (\d+(?:\.\d+)?) s\b")


class Cell(NamedTuple):
    """A value, what stands below it, and how it is marked: good, fair, bad or nothing."""

    value: str
    below: str = ""
    mark: str = ""


class Whisker(NamedTuple):
    """An RMS with its interval on the log axis of its column: parts of the width; beyond 1 it is off the axis."""

    value: float
    low: float
    high: float
    bound: float | None


class Row(NamedTuple):
    rank: str
    name: str
    more: list[str]  #: module and settings
    look: Look | None
    whisker: Whisker | None
    cells: list[Cell]


class Failure(NamedTuple):
    """Runs of one solver that failed for one reason."""

    solver: str
    status: str
    reason: str
    runs: int
    which: str
    when: str


def with_unit(text: str, unit: str) -> str:
    """With the unit that the tables leave out."""
    return text if text.endswith("°") else f"{text}″" if unit == '"' else f"{text} {unit}"


def heads_of(group: Sequence[Results]) -> list[tuple[str, str]]:
    """Columns right of the solver: heading and unit."""
    first, *others = [(column.name, _UNITS.get(column.unit, column.unit)) for column in _columns(group[0])]
    heads = [first, ("runs aligned", "")]
    navigates = group[0].summary.navigation is not None
    heads += [("failed", "runs")] if navigates else [("median time", "s")]  # its many errors would hide what failed
    heads += others
    heads += [(columns.bound_heading(group[0]), columns.bound_of(group[0]))] if any(one.bound for one in group) else []
    heads += [(_nees_heading(group[0]), "")] if any(columns.nees_of(one.summary)[0] for one in group) else []
    heads += [*(() if navigates else [("failed", "runs")]), ("cost / ckf", "")]
    return heads + ([("heading spread", "°")] if columns.has_spread(group[0].task) else [])


_UNITS = {'"': "arcsec"}


def _columns(one: Results) -> list[columns.Column]:
    """The main score first, beside its whisker."""
    return sorted(columns.error_columns(one), key=lambda column: not column.main)


def _nees_heading(one: Results) -> str:
    return f"NEES / {columns.nees_of(one.summary)[1]}"


def rows_of(lines: Sequence[tuple[int, Results]], task: Task) -> list[Row]:
    group = [one for _, one in lines]
    names = [name for name, _ in heads_of(group)]
    whisker = _whiskers(group, task)
    out = []
    for rank, one in lines:
        module, _, name = one.solver.rpartition(":")
        more = ([module] if module else []) + [f"{name}={value}" for name, value in sorted(one.settings.items())]
        cells = _cells(one)
        scored = one.summary.scored
        kept = [cells[name] for name in names]
        out.append(Row(str(rank) if scored else "-", name, more, task.looks.get(one.label), whisker(one), kept))
    return out


def _cells(one: Results) -> dict[str, Cell]:
    s = one.summary
    nees, inside = columns.nees_text(s)
    ratio, below = columns.bound_text(one)
    aligned = "" if not s.scored else "good" if s.success >= 0.95 else "fair" if s.success >= 0.5 else "bad"
    failed = columns.failure_text(s)
    return {
        **{column.name: Cell(*column.cell(one)) for column in _columns(one)},
        "runs aligned": Cell(columns.success_text(s), f"of {s.runs}", aligned),
        "median time": Cell(numbers.seconds(s.t_conv_median_s), numbers.seconds_interval(s.t_conv_ci_s)),
        columns.bound_heading(one): Cell(ratio, "below" if below else "", "bad" if below else ""),
        _nees_heading(one): Cell(
            nees, "outside" if inside is False else "", {None: "", True: "good", False: "fair"}[inside]
        ),
        "failed": Cell(failed.replace(", ", "\n"), "", "bad" if s.failures else ""),
        "cost / ckf": Cell(columns.cost_text(one)),
        "heading spread": Cell(*columns.spread_text(one)),
    }


def _score(one: Results) -> tuple[float, Interval]:
    """The main score with its interval, in the unit of :func:`_limit`."""
    s = one.summary
    if s.navigation is None:
        return s.rms["U"], s.rms_ci["U"]
    return s.navigation.armse[ranking.about(one.task)]


def _limit(one: Results, task: Task) -> float | None:
    """The bound of the main score."""
    if not task.bound:
        return None
    if one.summary.navigation is None:
        return float(task.bound.steady[2]) / ARCSEC
    found = one.bound_means.get(ranking.about(one.task), math.nan)
    return found if math.isfinite(found) else None


def _whiskers(group: Sequence[Results], task: Task) -> Callable[[Results], Whisker | None]:
    """Places of the main score and its interval; a few solvers that fail are off the axis, lest they flatten the others."""
    bound = _limit(group[0], task)
    scores = {one.label: _score(one) for one in group}
    values = [value for value, _ in scores.values()]
    ends = [end for value, ci in scores.values() for end in (value, *ci)] + [bound or math.nan]
    known = [math.log(end) for end in ends if math.isfinite(end) and end > 0]
    low, high = (min(known), max(known)) if known else (0.0, 0.0)
    usual = statistics.median(values)
    if usual > 0:
        high = min(high, math.log(AXIS * usual))

    def place(value: float) -> float:
        return (math.log(value) - low) / (high - low) if value > 0 else 0.0

    def whisker(one: Results) -> Whisker | None:
        value, interval = scores[one.label]
        if not math.isfinite(value) or high <= low:
            return None
        ci = [end if math.isfinite(end) else value for end in interval]
        return Whisker(place(value), place(ci[0]), place(ci[1]), place(bound) if bound else None)

    return whisker


def failures_of(group: Iterable[Results]) -> list[Failure]:
    """Grouped by what is said but for its time, the most frequent first within each solver."""
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
