"""What tables say, in the words of all of them: numbers, intervals, columns of errors, and the lines below a table."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from sins_env.evaluation.consistency import Nees
from sins_env.evaluation.metrics import Summary
from sins_env.evaluation.monte_carlo import Results
from sins_env.evaluation.paired import LEAST_RUNS
from sins_env.evaluation.quantities import QUANTITIES
from sins_env.evaluation.ranking import by_failures, headline
from sins_env.evaluation.resampling import Interval
from sins_env.evaluation.tasks import EvaluationTask


def number(value: float, digits: int = 3) -> str:
    """Three significant digits, without an exponent below ten million; '-' for what is not known."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "never"
    if value == 0:
        return "0"
    if abs(value) >= 1e7:  # whatever has diverged
        return f"{value:.{digits - 1}e}"
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


def footer(results: Sequence[Results]) -> str:
    task, s = results[0].task, results[0].summary
    if not s.scored:
        lines = ["The recording has no reference: errors are not scored and nothing is ranked."]
        return "\n".join(lines + _spread_note(results))
    aligned = f"aligned: {task.thresholds} until the end, for {task.hold_s:g} s or more"
    if s.navigation is None:
        aligned += "; time from the start of fine alignment"
        aligned += f" (switch-on: + {s.coarse_s:g} s)" if s.coarse_s else ""
    lines = [f"{aligned}.", *_meaning(task, s)]
    fewest = min(one.summary.runs for one in results)
    if len(results) > 1 and fewest < LEAST_RUNS:
        more = "" if fewest == task.max_runs else ": --resume with more --runs adds to them"
        lines.append(f"Fewer than {LEAST_RUNS} runs tell no solvers apart{more}.")
    if any(nees_of(one.summary)[0] for one in results):
        dof = nees_of(s)[1]
        lines.append(
            f"NEES / {dof} is 1 where the solver's covariance is right, 95 % band {_bands(results)}{_silent(results)}."
        )
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
    equal = "shares not told apart over common runs (95 %)"
    if not by_failures(task):
        name = QUANTITIES[task.rank_by].name
        equal = (
            f"not told from the rank's first, by the 95 % interval of the ratio of their {name} RMS over common runs"
        )
    return [errors, f"Order: {order(task)}. Equal ranks: {equal}."]


def order(task: EvaluationTask) -> str:
    """What orders the solvers of a navigation task."""
    if not by_failures(task):
        return f"{QUANTITIES[task.rank_by].name} RMS over runs and time"
    limit = (
        f" (also those whose azimuth is beyond {task.fail_azimuth_deg:g} deg at the end)"
        if task.fail_azimuth_deg
        else ""
    )
    return f"share of failed runs{limit}, then median heading error at the end"


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


def _silent(results: Sequence[Results]) -> str:
    """What '-' in the column means, where it stands there."""
    none = any(not nees_of(one.summary)[0] for one in results)
    return "; -: the solver states no covariance" if none else ""


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
    if not has_spread(results[0].task):
        return []
    less = any(one.summary.spread_runs < one.summary.runs for one in results)
    left = "; runs that raised, were lost or gave no attitude at the end have none" if less else ""
    return [f"Heading spread: standard deviation over runs of the last heading{left}."]
