"""Check of a solver by the contract, in this process or in one of its own."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from sins_env.evaluation.contract.checker import TOLERANCE, Check, Checker
from sins_env.evaluation.contract.points import results
from sins_env.evaluation.contract.told import ALIGNMENT, NAVIGATION
from sins_env.evaluation.estimators import finding, isolation
from sins_env.evaluation.estimators.child import UNSENDABLE
from sins_env.evaluation.estimators.guard import EstimatorError
from sins_env.evaluation.estimators.wire import Answer


def check_estimator(
    solver: finding.Solver,
    settings: Mapping[str, Any] | None = None,
    on_check: Callable[[Check], None] | None = None,
    *,
    tolerance: float = TOLERANCE,
    apart: bool = False,
    epoch_timeout_s: float | None = None,
) -> list[Check]:
    """Check an estimator by the contract; it keeps it if ``all(check.passed is not False for check in ...)``.

    The contract is that of alignment, of navigation, or both, whichever tasks the estimator answers.

    Args:
        solver: a factory, a name, or ``module:Factory``.
        settings: settings of the solver.
        on_check: function called with the result of each check when it ends.
        tolerance: largest difference of results that must be the same; float32 needs about 1e-6.
        apart: run the checks in a process of their own, as for a stranger's solver, for a class that may end it.
        epoch_timeout_s: longest time of one call of the solver, s, as in ``evaluate``.

    Raises:
        ValueError: no such solver, settings that it refuses, or an estimator without ``batched``, ``reset`` or ``step``; a
            tolerance that is not positive.
        EstimatorError: the estimator ended the process of the checks, or a call of it took too long.
    """
    if not 0 < tolerance < math.inf:
        raise ValueError(f"tolerance = {tolerance!r}; allowed: a positive number")
    limits = isolation.limits(solver, epoch_timeout_s) or (isolation.Limits() if apart else None)
    found, given = [], (solver, settings, tolerance)
    for check in _checks(*given) if limits is None else _elsewhere(*given, limits):
        found.append(check)
        if on_check:
            on_check(check)
    return found


def _checks(solver: finding.Solver, settings: Mapping[str, Any] | None, tolerance: float) -> Iterator[Check]:
    finding.make(solver, settings)
    alignment, navigation = (Checker(solver, settings, tolerance, world) for world in (ALIGNMENT, NAVIGATION))
    not_navigating = navigation.refusal()
    if not not_navigating and (reason := alignment.refusal()):
        yield Check("alignment", None, f"does not apply: it navigates only ({reason})")
    else:
        yield from results(alignment)
    if not_navigating:
        yield Check("navigation", None, f"does not apply ({not_navigating})")
        return
    for check in results(navigation):
        yield check._replace(name=f"navigation: {check.name}")


def _elsewhere(
    solver: finding.Solver, settings: Mapping[str, Any] | None, tolerance: float, limits: isolation.Limits
) -> Iterator[Check]:
    """Yield the same checks from a process of their own, each when it ends."""
    child, name = isolation.child_of(solver, f"{__name__}:Served"), finding.solver_name(solver)
    limit_s = limits.first_s  # any call may be the first with arrays of its shape, and so compile
    try:
        child.call("begin", limits.make_s, solver, dict(settings or {}), tolerance)
        while (check := child.call("check", limit_s, beats=MOST_BEATS)).value in range(len(PASSED)):
            yield Check(check.first, PASSED[check.value], " ".join(check.second.split()))
    except UNSENDABLE as error:
        raise ValueError(f"solver {name!r} cannot be checked in a process of its own: {error}") from error
    except EstimatorError as error:
        if error.ended:
            raise EstimatorError(f"{name} ended its process in the middle of the checks ({error.ended})") from None
        if error.late:
            raise EstimatorError(f"{name}: a call in the checks took longer than {limit_s:g} s") from None
        raise EstimatorError(f"{name}: {error}") from error
    finally:
        child.close()


#: Most beats within one check, each after an epoch; a check has fewer epochs.
MOST_BEATS = 1000
PASSED = (False, True, None)  #: results of a check, as numbers that pass between processes
END = len(PASSED)  #: the number that tells that there are no more


class Served:
    """The checks in the other process, as :func:`_elsewhere` asks for them."""

    def __init__(self, memory: int) -> None:
        pass

    def begin(self, solver: finding.Solver, settings: Mapping[str, Any], tolerance: float) -> None:
        self._rest = _checks(solver, settings, tolerance)

    def check(self) -> Answer:
        """Return the next check, or END after the last."""
        for one in self._rest:
            return Answer(PASSED.index(one.passed), one.name, one.detail)
        return Answer(END)
