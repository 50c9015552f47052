"""The ranked table in its forms as Markdown, CSV and JSON, and the words that all tables share (terminal.py draws it)."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Sequence
from typing import Any

from sins_env.evaluation.metrics import Interval, Summary
from sins_env.evaluation.monte_carlo import Results
from sins_env.evaluation.ranking import ranked


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


def failure_text(summary: Summary) -> str:
    """'2 diverged, 1 raised', or '0'."""
    parts = [f"{count} {name}" for name, count in summary.counts.items() if count and name != "any"]
    return ", ".join(parts) or "0"


def nees_text(summary: Summary) -> tuple[str, bool | None]:
    """Mean NEES at T over its expectation 3, and whether it is in its band; '-' and None: not scored."""
    if not summary.nees:
        return "-", None
    last = summary.nees[-1]
    return ("inf" if math.isinf(last.mean) else number(last.mean / 3)), last.inside


def bound_text(one: Results) -> tuple[str, bool | None]:
    """Azimuth RMS over the bound, in brackets over what is only a reference; whether that is too good; '-': none."""
    text = number(one.bound_ratio["U"])
    return (f"({text})" if one.bound and not one.bound.holds else text), one.below_bound


def cost_text(one: Results) -> str:
    return number(one.cost.ratio, 2) if one.cost and one.cost.ratio is not None else "-"


def spread_text(s: Summary) -> tuple[str, str]:
    """Spread of the heading in degrees, and of how many runs where some have none."""
    return number(s.spread_deg), f"of {s.spread_runs}" if s.spread_runs < s.runs else ""


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
        f"RMS over runs and the last {s.steady_s:g} s; 95 % intervals.",
        "Equal ranks: not told from the rank's first, by the 95 % interval of the azimuth RMS' ratio over common runs.",
    ]
    if any(one.summary.nees for one in results):
        lines.append(f"NEES / 3 is 1 where the solver's covariance is right, 95 % band {_bands(results)}.")
    lines += _bound_note(results)
    helped = [f"{one.label} {number(one.summary.fallbacks)}" for one in results if one.summary.fallbacks]
    if helped:
        lines.append(f"Fallbacks per run, where a safeguard replaced the solver's own rule: {', '.join(helped)}.")
    if any(one.summary.counts["raised"] + one.summary.counts["lost"] for one in results):
        lines.append("Runs that raised or were lost enter every score with the worst error from there on.")
    return "\n".join(lines + _spread_note(results))


def _bound_note(results: Sequence[Results]) -> list[str]:
    """What the column means, and who is too good to be true."""
    bound = next((one.bound for one in results if one.bound), None)
    if bound is None:
        return []
    text = "RMS / bound: of the azimuth, over the Cramér-Rao bound of estimators that know nothing of the motion"
    lines = [text + ("." if bound.holds else "; in brackets, for it is only a reference here.")]
    below = [one.label for one in results if one.below_bound]
    if below:
        lines.append(
            f"Below the bound at the end (99.9 %): {', '.join(below)}: uses knowledge of the motion, leak or bug."
        )
    return lines


def _bands(results: Sequence[Results]) -> str:
    """The band for each number of runs that has a NEES; of more than three the fewest and the most."""
    bands = {one.summary.nees[-1].runs: one.summary.nees[-1].band for one in results if one.summary.nees}
    runs = sorted(bands)
    kept = runs if len(runs) <= 3 else [runs[0], runs[-1]]
    return ", ".join(f"{bands[n][0] / 3:.2f}–{bands[n][1] / 3:.2f} for {n} run{'s' * (n > 1)}" for n in kept)


def _spread_note(results: Sequence[Results]) -> list[str]:
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
    return {
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


def as_csv(results: Iterable[Results]) -> str:
    """One line per solver with every figure; empty where a value is not known."""
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for (task, suite), group in by_task(results).items():
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
            told = (*nees, s.spread_deg, s.spread_runs, *counts, s.fallbacks)
            ratios = (*one.bound_ratio.values(), bool(one.bound.holds) if one.bound else None, one.below_bound)
            times = (s.t_conv_median_s, *s.t_conv_ci_s, s.t_conv_restricted_mean_s)
            row = (*head, *times, *rms, *ratios, *told, *(one.cost or (None,) * 3))
            writer.writerow(["" if isinstance(v, float) and math.isnan(v) else v for v in row])
    return out.getvalue()


def as_markdown(results: Iterable[Results]) -> str:
    """A table per task."""
    parts = []
    for (name, _), group in by_task(results).items():
        lines = ranked(group)
        head = [
            "#",
            "solver",
            "runs",
            "aligned",
            "median time, s",
            'azimuth RMS, "',
            'east RMS, "',
            'north RMS, "',
        ]
        bounded = any(one.bound for one in group)
        head += (["RMS / bound"] if bounded else []) + ["NEES / 3", "failures", "cost / ckf"]
        head += ["spread, deg"] if group[0].task.windows else []
        rows = [head, ["---:" if i != 1 else "---" for i in range(len(head))]]
        for rank, one in lines:
            s = one.summary
            cells = [str(rank) if s.scored else "-", one.label, str(s.runs), success_text(s)]
            cells += [_inline(seconds(s.t_conv_median_s), seconds_interval(s.t_conv_ci_s))]
            cells += [_inline(angle(s.rms[axis]), angle_interval(s.rms_ci[axis])) for axis in "UEN"]
            ratio, below = bound_text(one)
            text, inside = nees_text(s)
            cells += [ratio + (" (below)" if below else "")] if bounded else []
            cells += [text + (" (outside)" if inside is False else ""), failure_text(s)]
            cells += [cost_text(one)]
            rows.append(cells + ([" ".join(spread_text(s)).strip()] if group[0].task.windows else []))
        body = "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows)
        parts.append(f"### {name}\n\n{group[0].task.what}\n\n{body}\n\n{footer(group)}\n")
    return "\n".join(parts)


def _inline(value: str, below: str) -> str:
    return f"{value} [{below}]" if below else value
