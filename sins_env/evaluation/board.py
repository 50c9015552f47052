"""The ranked table in its forms as Markdown, CSV and JSON, and the words that all tables share (terminal.py draws it)."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from sins_env.evaluation.consistency import Nees
from sins_env.evaluation.metrics import Summary
from sins_env.evaluation.monte_carlo import Results
from sins_env.evaluation.quantities import QUANTITIES
from sins_env.evaluation.ranking import by_failures, failure_rate, headline, ranked
from sins_env.evaluation.resampling import Interval
from sins_env.evaluation.tasks import EvaluationTask


def by_task(results: Iterable[Results]) -> dict[tuple[str, str], list[Results]]:
    """Results by task and suite, in their order."""
    out: dict[tuple[str, str], list[Results]] = {}
    for one in results:
        out.setdefault((one.task.name, one.suite), []).append(one)
    return out


def number(value: float, digits: int = 3) -> str:
    """Three significant digits without an exponent; '-' for what is not known."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "never"
    if value == 0:
        return "0"
    decimals = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:,.{decimals}f}"


def seconds(value: float) -> str:
    """Whole seconds, tenths below ten."""
    return number(value) if not math.isfinite(value) else f"{value:.{0 if value >= 10 else 1}f}"


def seconds_interval(ci: Interval) -> str:
    """'115–147'; empty where there is nothing to enclose."""
    return "" if not math.isfinite(ci[0]) or ci[0] == ci[1] else f"{seconds(ci[0])}–{seconds(ci[1])}"


def angle(arcsec: float) -> str:
    """Arcseconds without a unit; from 10,000 on degrees, with their sign."""
    return f"{number(arcsec / 3600)}°" if 1e4 <= arcsec < math.inf else number(arcsec)


def angle_interval(ci: Interval) -> str:
    return "" if math.isnan(ci[0]) else f"{angle(ci[0])}–{angle(ci[1])}".replace(",", "")


class Column(NamedTuple):
    """Of errors: a value with its interval for each solver."""

    name: str
    unit: str
    cell: Callable[[Results], tuple[str, str]]
    main: bool = False  #: what the task is about


def error_columns(one: Results) -> list[Column]:
    """What a task's solvers are scored by; ``one`` is any of them."""
    if one.summary.navigation is None:
        return [_axial(name, axis) for name, axis in (("azimuth RMS", "U"), ("east RMS", "E"), ("north RMS", "N"))]
    names = ("azimuth", "level", "position_h", "position_v", "velocity_h", "velocity_v")
    columns = [_averaged(name, name == about(one.task)) for name in names]
    if by_failures(one.task):
        columns.insert(0, Column("median heading at the end", "deg", _median))
    return columns


def about(task: EvaluationTask) -> str:
    """Of the columns of a navigation task the one that stands for what ranks."""
    main = headline(task)
    return {"position": "position_h", "velocity": "velocity_h"}.get(main, main)


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


def interval(ci: Interval) -> str:
    return "" if math.isnan(ci[0]) else f"{number(ci[0])}–{number(ci[1])}".replace(",", "")


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
    return bool(task.windows or task.records)


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


def footer(results: Sequence[Results]) -> str:
    task, s = results[0].task, results[0].summary
    if not s.scored:
        lines = ["The recording has no reference: errors are not scored and nothing is ranked."]
        return "\n".join(lines + _spread_note(results))
    lines = [
        f"aligned: {task.thresholds} until the end, for {task.hold_s:g} s or more; time from the start of "
        "fine alignment" + (f" (switch-on: + {s.coarse_s:g} s)." if s.coarse_s else "."),
        *_meaning(task, s),
    ]
    if any(nees_of(one.summary)[0] for one in results):
        dof = nees_of(s)[1]
        lines.append(f"NEES / {dof} is 1 where the solver's covariance is right, 95 % band {_bands(results)}.")
    lines += _bound_note(results)
    helped = [f"{one.label} {number(one.summary.fallbacks)}" for one in results if one.summary.fallbacks]
    if helped:
        lines.append(f"Fallbacks per run, where a safeguard replaced the solver's own rule: {', '.join(helped)}.")
    if any(one.summary.counts["raised"] + one.summary.counts["lost"] for one in results):
        lines.append("Runs that raised or were lost enter every score with the worst error from there on.")
    return "\n".join(lines + _spread_note(results))


def _meaning(task: EvaluationTask, s: Summary) -> list[str]:
    """What errors and ranks are."""
    if s.navigation is None:
        return [
            f"RMS over runs and the last {s.steady_s:g} s; 95 % intervals.",
            "Equal ranks: not told from the rank's first, by the 95 % interval of the azimuth RMS' ratio over common runs.",
        ]
    span = f" from {s.navigation.from_s:g} s on" if s.navigation.from_s else ""
    errors = f"Errors: mean over time{span} of the RMS over runs; 95 % intervals."
    if by_failures(task):
        limit = (
            f" (here also: azimuth beyond {task.fail_azimuth_deg:g} deg at the end)" if task.fail_azimuth_deg else ""
        )
        rule = "the share of failed runs, then the median heading error at the end, ranks"
        return [errors, f"Order: {rule}{limit}. Equal ranks: shares not told apart over common runs (95 %)."]
    name = QUANTITIES[task.rank_by].name
    told = f"by the 95 % interval of the ratio of their {name} RMS (over runs and time) over common runs"
    return [errors, f"Order: {name} RMS over runs and time. Equal ranks: not told from the rank's first, {told}."]


def _bound_note(results: Sequence[Results]) -> list[str]:
    """What the column means, and who is too good to be true."""
    bound = next((one.bound for one in results if one.bound), None)
    if bound is None:
        return []
    text = f"{bound_heading(results[0])}: of the {bound_of(results[0])}, over the Cramér-Rao bound of estimators that know "
    text += "nothing of the motion"
    lines = [text + ("." if bound.holds else "; in brackets, for it is only a reference here.")]
    below = [one.label for one in results if one.below_bound]
    if below:
        lines.append(
            f"Below the bound at the end (99.9 %): {', '.join(below)}: uses knowledge of the motion, leak or bug."
        )
    return lines


def bound_heading(one: Results) -> str:
    return "RMS / bound" if one.summary.navigation is None else "error / bound"


def bound_of(one: Results) -> str:
    """What the bound's column is about."""
    return "azimuth" if one.summary.navigation is None else QUANTITIES[headline(one.task)].name


def _bands(results: Sequence[Results]) -> str:
    """The band for each number of runs that has a NEES; of more than three the fewest and the most."""
    known = [(found[-1], dof) for found, dof in (nees_of(one.summary) for one in results) if found]
    bands = {last.runs: (last.band[0] / dof, last.band[1] / dof) for last, dof in known}
    runs = sorted(bands)
    kept = runs if len(runs) <= 3 else [runs[0], runs[-1]]
    return ", ".join(f"{bands[n][0]:.2f}–{bands[n][1]:.2f} for {n} run{'s' * (n > 1)}" for n in kept)


def _spread_note(results: Sequence[Results]) -> list[str]:
    if results[0].task.records:
        return ["Heading spread: standard deviation of the last heading's error at the same heading; 95 % intervals."]
    if not results[0].task.windows:
        return []
    less = any(one.summary.spread_runs < one.summary.runs for one in results)
    left = "; runs that raised, were lost or gave no attitude at the end have none" if less else ""
    return [f"Heading spread: standard deviation over runs of the last heading{left}."]


def as_json(results: Iterable[Results]) -> str:
    """A list of objects with the keys of evaluation.md section 4; what is not known or infinite is null."""
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
