"""Remarks below a ranked table: the meaning of its columns, and the limits of its runs."""

from __future__ import annotations

from collections.abc import Sequence

from sins_env.evaluation.score.headline import CAPS, by_failures, headline
from sins_env.evaluation.score.quantities import quantity
from sins_env.evaluation.score.ranking import claims
from sins_env.evaluation.score.repeatability import shares_headings
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.score.verdicts import LEAST_INTERVAL, LEAST_VERDICT
from sins_env.evaluation.show.cells import failure_text
from sins_env.evaluation.show.numbers import number_text
from sins_env.evaluation.speed.cost import YARDSTICK
from sins_env.evaluation.tasks.task import EvaluationTask


def footer(results: Sequence[Results]) -> str:
    """Return the remarks below the table of one task's solvers, as :func:`ranked` gives them."""
    task, s = results[0].task, results[0].summary
    if not s.scored:
        lines = ["The recording has no reference: errors are not scored and nothing is ranked."]
        return "\n".join([*lines, *_statuses(results), *_spread_note(results)])
    aligned = f"aligned: {task.thresholds} until the end, for {task.hold_s:g} s or more"
    if s.navigation is None:
        aligned += "; time from the start of fine alignment"
        aligned += f" (switch-on: + {s.coarse_s:g} s)" if s.coarse_s else ""
    lines = [f"{aligned}. Intervals are of 95 %.", *_score_note(results[0]), *_verdict_note(results)]
    if any(one.summary.nees_of_all for one in results):
        lines.append(
            f"NEES / {s.nees_dof} is 1 where the solver's covariance is right, 95 % band {_bands(results)}{_silent(results)}."
        )
    lines += _bound_note(results)
    lines += _statuses(results)
    helped = [f"{one.label} {number_text(one.summary.fallbacks)}" for one in results if one.summary.fallbacks]
    if helped:
        lines.append(f"Fallbacks per run, where a safeguard replaced the solver's own rule: {', '.join(helped)}.")
    if any(one.summary.counts["raised"] + one.summary.counts["lost"] for one in results):
        lines.append("Runs that raised or were lost enter every score with the worst error from there on.")
    return "\n".join(lines + _spread_note(results))


def order(task: EvaluationTask) -> str:
    """Return the text that names the score by which a navigation task orders solvers."""
    if not by_failures(task):
        return f"score of the {quantity(task.rank_by, True).name}, capped at three bounds"
    limit = f", capped at {task.fail_azimuth_deg:g} deg, beyond which a run has failed" if task.fail_azimuth_deg else ""
    return f"score of the heading error at the end{limit}"


def _score_note(one: Results) -> list[str]:
    """Return the lines that explain failed runs and the score."""
    quantity_, cap = quantity(headline(one.task), one.records.criteria.navigates), one.measure.cap
    error = f"{quantity_.name} error"
    span = f"over the last {one.summary.steady_s:g} s"
    if one.summary.navigation is not None:
        start = one.summary.navigation.from_s
        span = "at the end" if by_failures(one.task) else f"over time{f' from {start:g} s on' if start else ''}"
    what = f"the {error} {'' if by_failures(one.task) else 'RMS '}{span}"
    if not one.verdict.capped:
        return [
            f"Score: RMS over runs of {what}, without a cap, for this table has no bound to take it from (scoring 1)."
        ]
    unit = quantity_.unit_name
    limit = cap if by_failures(one.task) else CAPS * cap
    level = CAPS * one.task.delta_level_arcsec
    failed = f"{number_text(limit / quantity_.unit)} {unit}{' at the end' if one.summary.navigation else ''}"
    return [
        f'Failed: {error} beyond {failed}, level beyond {level:g}", or a status that is not ok.',
        f"Score: root of the mean over runs of min(e, {number_text(cap / quantity_.unit)} {unit})², e = {what}. Median: of e.",
    ]


def _verdict_note(results: Sequence[Results]) -> list[str]:
    """Return the lines that explain verdicts and ranks, and tell how many claims the table makes."""
    lines = []
    compared = sum(one.verdict.p_adjusted is not None for one in results)
    if compared:
        made = claims(results)
        lines.append(
            f"Verdict: wins or loses against {YARDSTICK} in the same runs, by sign flips of the losses; p is adjusted (Holm) for "
            f"{compared} comparison{'s' * (compared > 1)}. equal: within 2 %; open: not told apart."
        )
        if any(one.verdict.fragile for one in results):
            lines.append("fragile: one more run, in which the winner fails, would undo it.")
        lines.append(
            f"The table makes {made} claim{'s' * (made != 1)} of a win or a loss; one table in twenty may hold a false one."
        )
    ranks = sum(one.verdict.rank is not None for one in results)
    if ranks > 1:
        lines.append(
            f"Rank: one more than the number of solvers that beat it, one-sided at 5 % / {ranks - 1}; rank 1 holds the best with "
            "95 %."
        )
    if any(one.verdict.preliminary and one.verdict.capped for one in results):
        fewest, most = min(one.verdict.runs for one in results), results[0].task.max_runs
        more = "" if fewest == most else "; --resume with more --runs adds to them"
        lines.append(
            f"Fewer than {LEAST_VERDICT} common runs are preliminary, without p and rank; fewer than {LEAST_INTERVAL} give "
            f"values alone{more}."
        )
    return lines


def _bound_note(results: Sequence[Results]) -> list[str]:
    """Return the lines that explain the ratio to the bound and name solvers below the bound."""
    bounded = [one for one in results if one.bound]
    if not bounded:
        return []
    text = "x bound: score over the Cramér-Rao bound of estimators that know nothing of the motion"
    measure = bounded[0].measure
    if not measure.holds:
        text += "; in brackets, for it is only a reference here"
    elif not measure.comparable:
        text += f"; in brackets, for the cap is only {number_text(measure.cap / measure.bound)} times the bound"
    adjusted = [one.verdict.adjusted for one in bounded]
    if all(adjusted):
        text += "; adjusted by the luck of the oracle in the same runs"
    elif not any(adjusted):
        text += "; not adjusted by the oracle, whose runs are not there"
    else:
        text += "; not adjusted by the oracle, whose runs are not there: "
        text += ", ".join(one.label for one in bounded if not one.verdict.adjusted)
    lines = [f"{text}."]
    below = [one.label for one in results if one.below_bound]
    if below:
        lines.append(
            f"Below 0.98 of the bound (99.9 %): {', '.join(below)}: uses knowledge of the motion, leak or bug."
        )
    return lines


def _statuses(results: Sequence[Results]) -> list[str]:
    """Return the line with the kinds of failures of each solver that has any."""
    found = [f"{one.label} {failure_text(one.summary)}" for one in results if one.summary.failures]
    return [f"Status of runs: {'; '.join(found)}."] if found else []


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
