"""The order of a task's solvers, and the verdicts of their board.

Solvers with a rank come first. Those of one rank, and those without, are in the order of their scores.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from sins_env.evaluation.score.exact import LEVEL
from sins_env.evaluation.score.results import Results, summarise_together
from sins_env.evaluation.score.verdicts import Verdict, judge
from sins_env.evaluation.speed.cost import YARDSTICK


def ranked(
    results: Iterable[Results], yardstick: str = YARDSTICK, level: float = LEVEL
) -> list[tuple[int | None, Results]]:
    """Return the solvers of one task and suite with their ranks, the best first; None is no rank.

    The results that are returned hold their verdicts. If errors are not scored, the solvers keep their order.

    Args:
        results: results of the solvers.
        yardstick: name of the solver, with its usual settings, that the others are compared with.
        level: probability of a false win in the task.
    """
    given = list(results)
    summarise_together(given)
    told = [one.judged(verdict) for one, verdict in zip(given, verdicts(given, yardstick, level), strict=True)]
    return [(one.verdict.rank, one) for one in sorted(told, key=_merit)]


def verdicts(results: Sequence[Results], yardstick: str = YARDSTICK, level: float = LEVEL) -> list[Verdict]:
    """Return the verdict on each solver of one task and suite, in the given order; the arguments are those of :func:`ranked`."""
    if not results:
        return []
    names = [one.solver if not one.settings else "" for one in results]
    measure = min((one.measure for one in results), key=lambda measure: math.isnan(measure.bound))
    return judge([one.entry for one in results], measure, names.index(yardstick) if yardstick in names else None, level)


def claims(results: Sequence[Results]) -> int:
    """Return how many claims the verdicts of a board make: wins and losses against the yardstick."""
    return sum(one.verdict.word in ("wins", "loses") for one in results)


def _merit(one: Results) -> tuple[bool, int, float]:
    """Return the key that sorts solvers, smallest first; solvers whose score is unknown come last."""
    told = one.verdict
    return told.rank is None, told.rank or 0, math.inf if math.isnan(told.score) else told.score


def failure_rate(one: Results) -> float:
    """Return the share of runs that failed by their status, as board version 1 counted them."""
    return float(one.records.failed.mean())
