"""Remarks below a ranked table: the meaning of its columns, and the limits of its runs."""

from __future__ import annotations

from collections.abc import Sequence

from sins_env.evaluation.score.headline import by_failures, headline
from sins_env.evaluation.score.metrics import Summary
from sins_env.evaluation.score.quantities import QUANTITIES
from sins_env.evaluation.score.repeatability import shares_headings
from sins_env.evaluation.score.resampling import LEAST_RUNS
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.numbers import number_text
from sins_env.evaluation.tasks.task import EvaluationTask


def footer(results: Sequence[Results]) -> str:
    """Return the remarks below the table of one task's solvers."""
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
    if any(one.summary.nees_of_all for one in results):
        lines.append(
            f"NEES / {s.nees_dof} is 1 where the solver's covariance is right, 95 % band {_bands(results)}{_silent(results)}."
        )
    lines += _bound_note(results)
    helped = [f"{one.label} {number_text(one.summary.fallbacks)}" for one in results if one.summary.fallbacks]
    if helped:
        lines.append(f"Fallbacks per run, where a safeguard replaced the solver's own rule: {', '.join(helped)}.")
    if any(one.summary.counts["raised"] + one.summary.counts["lost"] for one in results):
        lines.append("Runs that raised or were lost enter every score with the worst error from there on.")
    return "\n".join(lines + _spread_note(results))


def _meaning(task: EvaluationTask, s: Summary) -> list[str]:
    """Return the lines that explain errors and ranks."""
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
    """Return the text that names the score by which a navigation task orders solvers."""
    if not by_failures(task):
        return f"{QUANTITIES[task.rank_by].name} RMS over runs and time"
    limit = (
        f" (also those whose azimuth is beyond {task.fail_azimuth_deg:g} deg at the end)"
        if task.fail_azimuth_deg
        else ""
    )
    return f"share of failed runs{limit}, then median heading error at the end"


def _bound_note(results: Sequence[Results]) -> list[str]:
    """Return the lines that explain the ratio to the bound and name solvers below the bound."""
    bound = next((one.bound for one in results if one.bound), None)
    if bound is None:
        return []
    navigates = results[0].summary.navigation is not None
    what, quantity = ("error", QUANTITIES[headline(results[0].task)].name) if navigates else ("RMS", "azimuth")
    text = f"{what} / bound: of the {quantity}, over the Cramér-Rao bound of estimators that know "
    text += "nothing of the motion"
    lines = [text + ("." if bound.holds else "; in brackets, for it is only a reference here.")]
    below = [one.label for one in results if one.below_bound]
    if below:
        lines.append(
            f"Below the bound at the end (99.9 %): {', '.join(below)}: uses knowledge of the motion, leak or bug."
        )
    return lines


def _silent(results: Sequence[Results]) -> str:
    """Return the meaning of '-' in the column of NEES, if any solver has one."""
    none = any(not one.summary.nees_of_all for one in results)
    return "; -: the solver states no covariance" if none else ""


def _bands(results: Sequence[Results]) -> str:
    """Return the band of NEES for each number of runs; if there are more than three, for the fewest and the most."""
    dof = results[0].summary.nees_dof
    known = [one.summary.nees_of_all[-1] for one in results if one.summary.nees_of_all]
    bands = {last.runs: (last.band[0] / dof, last.band[1] / dof) for last in known}
    runs = sorted(bands)
    kept = runs if len(runs) <= 3 else [runs[0], runs[-1]]
    return ", ".join(f"{bands[n][0]:.2f}–{bands[n][1]:.2f} for {n} run{'s' * (n > 1)}" for n in kept)


def _spread_note(results: Sequence[Results]) -> list[str]:
    if results[0].task.records:
        return ["Heading spread: standard deviation of the last heading's error at the same heading; 95 % intervals."]
    if not shares_headings(results[0].task):
        return []
    less = any(one.summary.spread_runs < one.summary.runs for one in results)
    left = "; runs that raised, were lost or gave no attitude at the end have none" if less else ""
    return [f"Heading spread: standard deviation over runs of the last heading{left}."]
