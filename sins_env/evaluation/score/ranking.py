"""The order of a task's solvers, and their ranks.

The best solver leads rank 1. A solver shares the rank of its leader if the two do not differ: the interval of the ratio
of their RMS, paired over the common runs, contains 1. The first solver that differs leads the next rank.

Alignment ranks by the RMS of azimuth in the steady state. Navigation ranks by the RMS over the scored span of the
quantity that the task names. A task may instead rank by the share of failed runs and then by the median heading error at
the end. The RMS ranks, not a convergence time, because it depends on no threshold.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.score.exact import LEVEL
from sins_env.evaluation.score.headline import by_failures, headline
from sins_env.evaluation.score.paired import Pairing, apart, common, difference_of_rates
from sins_env.evaluation.score.quantities import run_errors
from sins_env.evaluation.score.results import Results, summarise_together
from sins_env.evaluation.score.verdicts import Verdict, judge
from sins_env.evaluation.speed.cost import YARDSTICK


def ranked(results: Iterable[Results]) -> list[tuple[int, Results]]:
    """Return the solvers of one task with their ranks, the best first.

    If errors are not scored, all have rank 1 and keep their order.
    """
    given = list(results)
    summarise_together(given)
    if not all(one.summary.scored for one in given):
        return [(1, one) for one in given]
    lines = sorted(given, key=merit)
    if lines and by_failures(lines[0].task):
        told_apart = _Rates(lines).apart
    else:
        told_apart = Pairing(lines, [_counted(one) for one in lines], [_interval(one) for one in lines]).apart
    leader, ranks = 0, []
    for i in range(len(lines)):
        if i and told_apart(leader, i):
            leader = i
        ranks.append(leader + 1)
    return list(zip(ranks, lines, strict=True))


def verdicts(results: Sequence[Results], yardstick: str = YARDSTICK, level: float = LEVEL) -> list[Verdict]:
    """Return the verdict on each solver of one task and suite, in the given order.

    Args:
        results: results of the solvers.
        yardstick: name of the solver, with its usual settings, that the others are compared with.
        level: probability of a false win in the task.
    """
    names = [one.solver if not one.settings else "" for one in results]
    measure = max((one.measure for one in results), key=lambda measure: not math.isnan(measure.bound))
    return judge([one.entry for one in results], measure, names.index(yardstick) if yardstick in names else None, level)


def merit(one: Results) -> tuple[float, ...]:
    """Return the key that sorts solvers, smallest first."""
    s = one.summary
    if s.navigation is None:
        return (s.rms["U"],)
    if by_failures(one.task):
        return failure_rate(one), s.navigation.median_azimuth[0]
    return (s.navigation.rms[one.task.rank_by][0],)


def failure_rate(one: Results) -> float:
    """Return the share of failed runs."""
    return float(one.records.failed.mean())


def _counted(one: Results) -> Array:
    """Return the error (R,) of each run that ranks."""
    return run_errors(one.records, headline(one.task))[0]


def _interval(one: Results) -> tuple[float, float]:
    s = one.summary
    return s.navigation.rms[headline(one.task)][1] if s.navigation else s.rms_ci["U"]


class _Rates:
    """Pairwise comparison of solvers by the share of their common runs that fail."""

    def __init__(self, results: Sequence[Results]) -> None:
        self.results = results

    def apart(self, i: int, j: int) -> bool:
        a, b = self.results[i], self.results[j]
        if not np.intersect1d(a.records.run, b.records.run).size:
            return False
        mine, its = common(a.records, b.records)
        _, (low, high) = difference_of_rates(a.records.failed[mine], b.records.failed[its])
        return apart(len(mine), (1 + low, 1 + high))
