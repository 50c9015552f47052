"""The ranked table: in the terminal, as Markdown, CSV and JSON.

A solver's rank is one more than the number of solvers whose azimuth RMS is better with disjoint intervals,
so that ranks tie where intervals overlap. That comparison is unpaired; all solvers meet the same runs, and
pairing them will separate more of them. The RMS, not a convergence time, ranks: it hangs on no threshold.
"""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Sequence
from typing import Any

from rich import box
from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from sins_env.evaluation.metrics import Interval, Summary
from sins_env.evaluation.monte_carlo import Results


def ranked(results: Iterable[Results]) -> list[tuple[int, Results]]:
    """Solvers of one task with their ranks, the best first."""
    lines = sorted(results, key=lambda r: r.summary.rms["U"])
    return [(1 + sum(_better(other, one) for other in lines), one) for one in lines]


def _better(a: Results, b: Results) -> bool:
    """Whether a's interval lies below b's; without an interval (one run) nothing is told apart."""
    return a.summary.rms_ci["U"][1] < b.summary.rms_ci["U"][0]


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
    return number(value) if math.isinf(value) else f"{value:.{0 if value >= 10 else 1}f}"


def seconds_interval(ci: Interval) -> str:
    """'115–147'; empty where there is nothing to enclose."""
    return "" if math.isinf(ci[0]) or ci[0] == ci[1] else f"{seconds(ci[0])}–{seconds(ci[1])}"


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


NARROW = 96  #: columns below which a terminal gets no intervals of the level errors


def table(results: Sequence[Results], width: int = 100) -> RenderableType:
    """One task's solvers for a terminal of ``width`` columns: a value, and its 95 % interval on the line below."""
    task, lines = results[0].task, ranked(results)
    summaries = [one.summary for _, one in lines]
    wide = width >= NARROW
    spread, nees = bool(task.windows), any(s.nees for s in summaries)
    out = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1), collapse_padding=True)
    title = Text.assemble((task.name, "bold"), f"  {task.what}")
    for name, justify in _HEADINGS + ((("heading\nspread, °", "right"),) if spread else ()):
        if name.startswith("NEES") and not nees:
            continue
        out.add_column(name, justify=justify, overflow="fold")  # type: ignore[arg-type]
    for (rank, one), s in zip(lines, summaries, strict=True):
        cells: list[RenderableType] = [
            Text(str(rank), style="bold green" if rank == 1 else ""),
            _label(one, rank),
            _success(s),
            _stacked(seconds(s.t_conv_median_s), seconds_interval(s.t_conv_ci_s)),
            _stacked(angle(s.rms["U"]), angle_interval(s.rms_ci["U"])),
            *(_stacked(angle(s.rms[axis]), angle_interval(s.rms_ci[axis]) if wide else "") for axis in "EN"),
            *([_nees(s)] if nees else []),
            Text(failure_text(s).replace(", ", "\n"), style="red" if s.failures else "dim"),
            number(one.cost.ratio, 2) if one.cost and one.cost.ratio is not None else "-",
        ]
        out.add_row(*cells, *([number(s.spread_deg)] if spread else []))
    return Group(title, out, Text(_footer(results), style="dim"))


_HEADINGS: tuple[tuple[str, str], ...] = (
    ("#", "right"),
    ("solver", "left"),
    ("runs\naligned", "right"),
    ("median\ntime, s", "right"),
    ('azimuth\nRMS, "', "right"),
    ('east\nRMS, "', "right"),
    ('north\nRMS, "', "right"),
    ("NEES\n/ 3", "right"),
    ("failed", "right"),
    ("cost\n/ ckf", "right"),
)


def _label(one: Results, rank: int) -> Text:
    module, _, name = one.solver.rpartition(":")
    text = Text(name, style="bold" if rank == 1 else "")
    if module:
        text.append(f"\n{module}", style="dim")
    return text.append("".join(f"\n{name}={v}" for name, v in sorted(one.settings.items())), style="dim")


def _success(s: Summary) -> Text:
    style = "green" if s.success >= 0.95 else "yellow" if s.success >= 0.5 else "red"
    return Text.assemble((f"{100 * s.success:.0f} %", style), (f"\nof {s.runs}", "dim"))


def _stacked(value: str, below: str) -> Text:
    return Text.assemble(value, ("\n" + below, "dim")) if below else Text(value)


def _nees(s: Summary) -> Text:
    text, inside = nees_text(s)
    return Text(text, style="" if inside is None else "green" if inside else "yellow")


def _footer(results: Sequence[Results]) -> str:
    task, s = results[0].task, results[0].summary
    lines = [
        f"aligned: {task.thresholds} until the end, for {task.hold_s:g} s or more; time from the start of "
        "fine alignment" + (f" (switch-on: + {s.coarse_s:g} s)." if s.coarse_s else "."),
        f"RMS over runs and the last {s.steady_s:g} s; 95 % intervals; equal ranks: intervals overlap.",
    ]
    if any(one.summary.nees for one in results):
        low, high = results[0].summary.nees[-1].band if results[0].summary.nees else (math.nan, math.nan)
        band = f", 95 % band {low / 3:.2f}–{high / 3:.2f} for {s.runs} runs" if low == low else ""
        lines.append(f"NEES / 3 is 1 where the solver's covariance is right{band}.")
    if any(one.summary.counts["raised"] + one.summary.counts["lost"] for one in results):
        lines.append("Runs that raised or were lost enter every score with the worst error from there on.")
    return "\n".join(lines)


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
        "success": s.success,
        "t_conv_median_s": _finite(s.t_conv_median_s),
        "rms": {axis: _finite(s.rms[axis]) for axis in "ENU"},
        "rms_ci": {axis: [_finite(end) for end in s.rms_ci[axis]] for axis in "ENU"},
        "bound_ratio": None,
        "failures": s.failures,
        "cost_ratio": one.cost.ratio if one.cost else None,
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


_COLUMNS = (
    "task", "suite", "rank", "solver", "settings", "runs", "success",
    "t_conv_median_s", "t_conv_low_s", "t_conv_high_s", "t_conv_restricted_mean_s",
    "rms_e_arcsec", "rms_e_low", "rms_e_high", "rms_n_arcsec", "rms_n_low", "rms_n_high",
    "rms_u_arcsec", "rms_u_low", "rms_u_high", "nees_over_3", "nees_in_band", "spread_deg",
    "diverged", "frozen", "raised", "lost", "repaired", "cost_us", "cost_p95_us", "cost_ratio",
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
                rank,
                one.solver,
                json.dumps(dict(one.settings), sort_keys=True),
                s.runs,
                s.success,
            )
            times = (s.t_conv_median_s, *s.t_conv_ci_s, s.t_conv_restricted_mean_s)
            row = (*head, *times, *rms, *nees, s.spread_deg, *counts, *(one.cost or (None,) * 3))
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
        head += ["NEES / 3", "failures", "cost / ckf"] + (["spread, deg"] if group[0].task.windows else [])
        rows = [head, ["---:" if i != 1 else "---" for i in range(len(head))]]
        for rank, one in lines:
            s = one.summary
            cells = [str(rank), one.label, str(s.runs), f"{100 * s.success:.0f} %"]
            cells += [_inline(seconds(s.t_conv_median_s), seconds_interval(s.t_conv_ci_s))]
            cells += [_inline(angle(s.rms[axis]), angle_interval(s.rms_ci[axis])) for axis in "UEN"]
            text, inside = nees_text(s)
            cells += [text + (" (outside)" if inside is False else ""), failure_text(s)]
            cells += [number(one.cost.ratio, 2) if one.cost and one.cost.ratio is not None else "-"]
            rows.append(cells + ([number(s.spread_deg)] if group[0].task.windows else []))
        body = "\n".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |" for row in rows)
        parts.append(f"### {name}\n\n{group[0].task.what}\n\n{body}\n\n{_footer(group)}\n")
    return "\n".join(parts)


def _inline(value: str, below: str) -> str:
    return f"{value} [{below}]" if below else value
