"""The ranked table in its forms as Markdown, CSV and JSON (terminal.py draws it, report.py makes a page of it)."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable
from typing import Any

from sins_env.evaluation.score.quantities import QUANTITIES
from sins_env.evaluation.score.ranking import failure_rate, ranked
from sins_env.evaluation.score.results import Results, by_task
from sins_env.evaluation.show.columns import (
    bound_heading,
    bound_ratio,
    bound_text,
    cost_text,
    error_columns,
    failure_text,
    has_spread,
    nees_of,
    nees_text,
    spread_of,
    spread_text,
    success_text,
)
from sins_env.evaluation.show.footer import footer
from sins_env.evaluation.show.numbers import seconds, seconds_interval


def as_json(results: Iterable[Results]) -> str:
    """A list of objects with the keys of docs/tasks_and_scores.md#json-keys; what is not known or infinite is null."""
    return json.dumps([_entry(one) for group in by_task(results).values() for _, one in ranked(group)], indent=2)


def _entry(one: Results) -> dict[str, Any]:
    s = one.summary
    entry = {
        "task": one.task.name,
        "solver": one.solver,
        "settings": dict(one.settings),
        "runs": s.runs,
        "success": _finite(s.success),
        "t_conv_median_s": _finite(s.t_conv_median_s),
        "rms": {axis: _finite(s.rms[axis]) for axis in "ENU"},
        "rms_ci": {axis: [_finite(end) for end in s.rms_ci[axis]] for axis in "ENU"},
        "bound_ratio": _finite(one.bound_ratio["U"]),
        "failures": s.failures,
        "cost_ratio": one.cost.ratio if one.cost else None,
    }
    if s.navigation is not None:
        entry["bound_ratio"] = _finite(bound_ratio(one))
        entry["failure_rate"] = failure_rate(one)
        entry["median_heading_deg"] = _finite(math.degrees(s.navigation.median_azimuth[0]))
        armse = {(name, QUANTITIES[name]): estimate for name, estimate in s.navigation.armse.items()}
        entry["armse"] = {name: _finite(value / q.unit) for (name, q), (value, _) in armse.items()}
        entry["armse_ci"] = {name: [_finite(end / q.unit) for end in ci] for (name, q), (_, ci) in armse.items()}
        entry["armse_unit"] = {name: q.unit_name for name, q in armse}
    return entry


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


_COLUMNS = (
    "task", "suite", "rank", "solver", "settings", "runs", "success",
    "t_conv_median_s", "t_conv_low_s", "t_conv_high_s", "t_conv_restricted_mean_s",
    "rms_e_arcsec", "rms_e_low", "rms_e_high", "rms_n_arcsec", "rms_n_low", "rms_n_high",
    "rms_u_arcsec", "rms_u_low", "rms_u_high", "bound_ratio_e", "bound_ratio_n", "bound_ratio_u", "bound_holds",
    "below_bound", "nees_over_3", "nees_in_band", "spread_deg", "spread_runs",
    "diverged", "frozen", "raised", "lost", "repaired", "fallbacks", "cost_us", "cost_p95_us", "cost_ratio",
)  # fmt: skip


#: After the others, in files that hold navigation.
_NAVIGATION = (
    *(f"armse_{name}{end}" for name, q in QUANTITIES.items() for end in (f"_{q.unit_name.replace('/', '_per_')}", "_low", "_high")),
    *(f"rms_{name}_{q.unit_name.replace('/', '_per_')}" for name, q in QUANTITIES.items()),
    *(f"bound_ratio_{name}" for name in QUANTITIES),
    "median_heading_deg", "failure_rate", "nees_all_over_9", "nees_all_in_band",
)  # fmt: skip


def _navigation(one: Results) -> tuple[Any, ...]:
    s = one.summary.navigation
    if s is None:
        return ("",) * len(_NAVIGATION)
    armse = [x / q.unit for name, q in QUANTITIES.items() for x in (s.armse[name][0], *s.armse[name][1])]
    rms = [s.rms[name][0] / q.unit for name, q in QUANTITIES.items()]
    ratios = [s.armse[name][0] / one.bound_means.get(name, math.nan) for name in QUANTITIES]
    nees = (s.nees[-1].mean / 9, s.nees[-1].inside) if s.nees else (None, None)
    return (*armse, *rms, *ratios, math.degrees(s.median_azimuth[0]), failure_rate(one), *nees)


def as_csv(results: Iterable[Results]) -> str:
    """One line per solver with every figure; empty where a value is not known. Navigation has columns of its own."""
    out, given = io.StringIO(), list(results)
    writer = csv.writer(out, lineterminator="\n")
    navigates = any(one.summary.navigation for one in given)
    writer.writerow([*_COLUMNS, *(_NAVIGATION if navigates else ())])
    for (task, suite), group in by_task(given).items():
        for rank, one in ranked(group):
            s = one.summary
            rms = [value for axis in "ENU" for value in (s.rms[axis], *s.rms_ci[axis])]
            nees = (s.nees[-1].mean / 3, s.nees[-1].inside) if s.nees else (None, None)
            counts = [s.counts[name] for name in ("diverged", "frozen", "raised", "lost", "repaired")]
            head = (
                task,
                suite,
                rank if s.scored else "",
                one.solver,
                json.dumps(dict(one.settings), sort_keys=True),
                s.runs,
                s.success,
            )
            told = (*nees, *spread_of(one), *counts, s.fallbacks)
            ratios = (*one.bound_ratio.values(), bool(one.bound.holds) if one.bound else None, one.below_bound)
            times = (s.t_conv_median_s, *s.t_conv_ci_s, s.t_conv_restricted_mean_s)
            row = (*head, *times, *rms, *ratios, *told, *(one.cost or (None,) * 3))
            row += _navigation(one) if navigates else ()
            writer.writerow(["" if isinstance(v, float) and math.isnan(v) else v for v in row])
    return out.getvalue()


def as_markdown(results: Iterable[Results]) -> str:
    """A table per task."""
    parts = []
    for (name, _), group in by_task(results).items():
        lines = ranked(group)
        columns, navigates = error_columns(group[0]), group[0].summary.navigation is not None
        head = ["#", "solver", "runs", "aligned", *(() if navigates else ("median time, s",))]
        head += [f"{column.name}, {column.unit}" for column in columns]
        bounded = any(one.bound for one in group)
        head += ([bound_heading(group[0])] if bounded else []) + [f"NEES / {nees_of(group[0].summary)[1]}"]
        head += ["failures", "cost / ckf"]
        head += ["spread, deg"] if has_spread(group[0].task) else []
        rows = [head, ["---:" if i != 1 else "---" for i in range(len(head))]]
        for rank, one in lines:
            s = one.summary
            cells = [str(rank) if s.scored else "-", one.label, str(s.runs), success_text(s)]
            cells += [] if navigates else [_inline(seconds(s.t_conv_median_s), seconds_interval(s.t_conv_ci_s))]
            cells += [_inline(*column.cell(one)) for column in columns]
            ratio, below = bound_text(one)
            text, inside = nees_text(s)
            cells += [ratio + (" (below)" if below else "")] if bounded else []
            cells += [text + (" (outside)" if inside is False else ""), failure_text(s)]
            cells += [cost_text(one)]
            rows.append(cells + ([" ".join(spread_text(one)).strip()] if has_spread(group[0].task) else []))
        body = "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows)
        parts.append(f"### {name}\n\n{group[0].task.what}\n\n{body}\n\n{footer(group)}\n")
    return "\n".join(parts)


def _inline(value: str, below: str) -> str:
    return f"{value} [{below}]" if below else value
