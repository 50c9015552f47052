"""Results of an evaluation: the records of a solver on a task, their summary, and the bound."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from html import escape
from typing import Any, Literal, NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.bound import bounds
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.play.records import FIELDS, Records
from sins_env.evaluation.score.headline import bound_of, cap_of, error_of_run, failed_runs, headline
from sins_env.evaluation.score.metrics import Summary, bound_ratios, summaries
from sins_env.evaluation.score.navigation import bound_means
from sins_env.evaluation.score.quantities import quantity
from sins_env.evaluation.score.repeatability import Repeatability, repeatability
from sins_env.evaluation.score.resampling import NO_INTERVAL, Interval
from sins_env.evaluation.score.verdicts import Entry, Measure, Verdict, judge
from sins_env.evaluation.speed.cost import Cost
from sins_env.evaluation.tasks.task import EvaluationTask


class MainScore(NamedTuple):
    """Score of a solver with its 95 % interval and its bound, in a unit for readers."""

    name: str
    unit: str
    value: float
    interval: Interval
    bound: float  #: bound of the error, NaN if there is none


@dataclass(frozen=True, repr=False)
class Results:
    """Results of one solver on one task and one suite."""

    task: EvaluationTask
    solver: str
    settings: Mapping[str, Any]
    suite: str  #: hash of the suite seed
    records: Records
    cost: Cost | None = None
    stored_bound: Bound | Literal["ask"] | None = "ask"  #: bound from a results file; "ask" finds that of the task
    oracle: Records | None = None  #: runs of the oracle in the same suite; None if they are not known
    told: Verdict | None = None  #: verdict of the board of its task; None finds that of a board of this solver alone

    @cached_property
    def summary(self) -> Summary:
        """Scores over the runs, with intervals."""
        return summaries([self.records])[0]

    @cached_property
    def bound(self) -> Bound | None:
        """Bound of the task; None if there is none, or if these scores are taken at other epochs than it."""
        if not self.records.criteria.scored:
            return None
        found = bounds.find(self.task) if self.stored_bound == "ask" else self.stored_bound
        return found if found and found.fits(self.records.criteria) else None

    @cached_property
    def measure(self) -> Measure:
        """Cap and bound of the score."""
        bound = self.bound
        cap, known = (of(self.task, self.records, bound) for of in (cap_of, bound_of))
        return Measure(cap, known, bound is None or bool(bound.holds))

    @cached_property
    def entry(self) -> Entry:
        """The runs as they are judged."""
        records, unknown = self.records, np.full(len(self.records), np.nan)
        failed, scored = failed_runs(self.task, records, self.measure.cap), records.criteria.scored
        error = error_of_run(self.task, records) if scored else unknown
        return Entry(records.run, error, failed, records.aligned_s if scored else unknown, self._luck())

    def _luck(self) -> Array | None:
        """Return the squared errors of the oracle in these runs, (R,); None if any is not known."""
        if self.oracle is None or not np.isin(self.records.run, self.oracle.run).all():
            return None
        squares: Array = np.square(error_of_run(self.task, self.oracle))
        rows = np.argsort(self.oracle.run)
        found = squares[rows[np.searchsorted(self.oracle.run, self.records.run, sorter=rows)]]
        return found if np.isfinite(found).all() else None

    @cached_property
    def verdict(self) -> Verdict:
        """What the board of its task says of this solver."""
        return self.told or judge([self.entry], self.measure)[0]

    def judged(self, verdict: Verdict) -> Results:
        """Return the same results with a verdict; what was computed before is kept."""
        out = replace(self, told=verdict)
        given = {one.name for one in fields(self)} | {"verdict"}
        vars(out).update({name: value for name, value in vars(self).items() if name not in given})
        return out

    @cached_property
    def bound_ratio(self) -> dict[str, float]:
        """RMS divided by the bound, by axis; NaN without a bound."""
        return bound_ratios(self.records, self.bound) if self.bound else dict.fromkeys("ENU", math.nan)

    @cached_property
    def bound_means(self) -> dict[str, float]:
        """Bound of each ARMSE of a navigation task, by name (quantities.py); empty without a bound."""
        return bound_means(self.records, self.bound) if self.bound and self.records.criteria.navigates else {}

    @property
    def headline_ratio(self) -> float:
        """Azimuth RMS, or ARMSE of the headline in navigation, divided by its bound; NaN without a bound."""
        if self.summary.navigation is None:
            return self.bound_ratio["U"]
        name = headline(self.task)
        return self.summary.navigation.armse[name][0] / self.bound_means.get(name, math.nan)

    @property
    def main_score(self) -> MainScore:
        """Score that tables show first and figures draw, in deg, m/s or m."""
        one, (low, high) = quantity(headline(self.task), self.records.criteria.navigates), self.verdict.score_ci
        interval = low / one.unit, high / one.unit
        name = f"score of the {one.name}"
        return MainScore(name, one.unit_name, self.verdict.score / one.unit, interval, self.measure.bound / one.unit)

    @property
    def spread(self) -> Repeatability:
        """Standard deviation of the heading: within its groups if the task has records, else over all runs."""
        if self.task.records:
            return self.repeatability[-1]
        return Repeatability("all", self.summary.spread_runs, self.summary.spread_deg, NO_INTERVAL)

    @cached_property
    def repeatability(self) -> list[Repeatability]:
        """Repeatability at each heading of the task, and last that of all together."""
        return repeatability(self.records, self.task)

    @cached_property
    def below_bound(self) -> bool | None:
        """Whether the solver is better than the bound allows; None if there is no bound or it is only a reference."""
        return self.verdict.below_bound

    @property
    def label(self) -> str:
        """Name of the solver with its settings, for tables and figures."""
        given = ", ".join(f"{name}={value}" for name, value in sorted(self.settings.items()))
        return f"{self.solver} ({given})" if given else self.solver

    def row(self) -> dict[str, Any]:
        """Return what matters most as plain values: task, solver, runs, failed runs, and the score with interval and bound."""
        score = self.main_score
        return {
            "task": self.task.name,
            "solver": self.label,
            "runs": len(self.records.run),
            "failed": int(np.count_nonzero(self.entry.failed)),
            score.name: float(score.value),
            "low": float(score.interval[0]),
            "high": float(score.interval[1]),
            "unit": score.unit,
            "bound": float(score.bound),
        }

    def rows(self) -> list[dict[str, Any]]:
        """Return a plain dict for each run, with its number and all that was scored, in rad, m/s, m and s; no histories.

        A table is made of it as it is: ``pandas.DataFrame(results.rows())``.
        """
        kept = [one for one in FIELDS.values() if one.kind != "curve"]
        return [
            {
                heading: value.item() if isinstance(value, np.generic) else value
                for one in kept
                for heading, value in zip(one.headings, np.atleast_1d(run[one.name]), strict=False)
            }
            for run in map(self.records.row, range(len(self.records)))
        ]

    def _repr_html_(self) -> str:
        shown = (
            (name, f"{value:.4g}" if isinstance(value, float) else str(value)) for name, value in self.row().items()
        )
        cells = "".join(f"<tr><th>{escape(name)}</th><td>{escape(text)}</td></tr>" for name, text in shown)
        return f"<table>{cells}</table>"

    def __repr__(self) -> str:
        return f"<Results of {self.label} on {self.task.name}: {len(self.records.run)} runs>"


def summarise_together(results: Sequence[Results]) -> None:
    """Compute the summaries that are not known yet, all at once, which is several times faster than one by one."""
    todo = [one for one in results if "summary" not in vars(one)]
    for one, summary in zip(todo, summaries([one.records for one in todo]), strict=True):
        vars(one)["summary"] = summary  # where cached_property keeps it


def by_task(results: Iterable[Results]) -> dict[tuple[str, str], list[Results]]:
    """Return the results by task and suite, each group in the given order."""
    out: dict[tuple[str, str], list[Results]] = {}
    for one in results:
        out.setdefault((one.task.name, one.suite), []).append(one)
    return out
