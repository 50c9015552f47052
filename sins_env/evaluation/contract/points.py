"""The points of the estimator contract, each with the advice for an estimator that breaks it.

See docs/tasks_and_scores.md#estimator-contract.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np

from sins_env.evaluation.contract.checker import Bad, Check, Checker, Witness, loop_of, play
from sins_env.evaluation.contract.told import COARSE_S, RUNS, UNKNOWN_START, Told
from sins_env.evaluation.estimators.guard import EstimatorError


class Point(NamedTuple):
    """Point of the contract; its texts may name the Checker's width, errors and action."""

    name: str
    advice: str  #: what to do if it fails
    check: Callable[[Checker], str | None]  #: returns a remark, or None if it does not apply; raises Bad


POINTS: list[Point] = []  #: all points, in the order in which they are checked


def _point(name: str, advice: str) -> Callable[[Callable[[Checker], str | None]], Callable[[Checker], str | None]]:
    def add(check: Callable[[Checker], str | None]) -> Callable[[Checker], str | None]:
        POINTS.append(Point(name, advice, check))
        return check

    return add


def results(c: Checker) -> Iterator[Check]:
    """Yield the result of each point; after a run has failed, the others are not checked."""
    one_run = True
    for name, advice, check in POINTS:
        title, to_do = (text.format(width=c.width, errors=c.errors, action=c.action) for text in (name, advice))
        if not one_run:
            yield Check(title, None, "not looked at: a run fails")
            continue
        try:
            detail = check(c)
            yield Check(title, None if detail is None else True, "does not apply" if detail is None else detail)
            continue
        except Bad as error:
            yield Check(title, False, f"{error}; {to_do}")
        except Exception as error:
            yield Check(title, False, f"{type(error).__name__}: {' '.join(str(error).split())}; {to_do}")
        one_run = check is not single


@_point("batched is a bool; reset and step are there", "write them as methods of the class")
def members(c: Checker) -> str:
    """Check the members of the estimator."""
    estimator = c.make()
    for name in ("reset", "step"):
        if not callable(getattr(estimator, name)):
            raise Bad(f"{name} cannot be called")
    return f"batched = {bool(estimator.batched)}"


@_point("one run: actions of shape ({width},), finite", "let step return {action}")
def single(c: Checker) -> str:
    """Play one run."""
    return f"{len(c.alone)} epochs"


@_point(
    "a batch: actions of shape (runs, {width})",
    "let step return a row for each run, or set batched = False to get one run at a time",
)
def batch(c: Checker) -> str | None:
    """Play several runs at once."""
    if not c.batched:
        return None
    c.drive(c.make(), c.told.play(), batched=True)
    return f"{RUNS} runs"


@_point(
    "a run does not depend on its neighbours in the batch",
    "work each row out from its own row and its own rng alone (for float32: --tolerance 1e-6)",
)
def neighbours(c: Checker) -> str | None:
    """Compare a run alone with the same run in a batch."""
    if not c.batched:
        return None
    together = c.drive(c.make(), c.told.play(), batched=True)[:, :1]
    return c.same(c.alone, together, "run 0 alone and in a batch")


@_point("the same rng gives the same result", "draw from the rng of reset, and use no clock and no global state")
def deterministic(c: Checker) -> str:
    """Play a run twice."""
    return c.same(c.alone, c.drive(c.make(), c.told.run(0)), "two estimators with the same rng")


@_point("reset begins anew", "set all that step changes in reset")
def reusable(c: Checker) -> str:
    """Play a run after another one, with one estimator."""
    estimator = c.make()
    c.drive(estimator, c.told.run(1))
    again = c.drive(estimator, c.told.run(0))
    return c.same(c.alone, again, "a fresh estimator and one reset after another run")


@_point("leaves observations and task as they were", "copy what you change: np.array(obs['dtheta'])")
def untouched(c: Checker) -> str:
    """Compare observations and task before and after a run."""
    witness = Witness(c.make())
    c.drive(witness, c.told.run(0))
    for k, (obs, old) in enumerate(witness.given, start=1):
        for name in obs.keys() | old.keys():
            if name not in obs or name not in old or not np.array_equal(obs[name], old[name]):
                raise Bad(f"{name} of observation {k} was changed")
    if any((a != b).any() for a, b in witness.starts):
        raise Bad("the start in the task was changed")
    return ""


@_point("draws from its rng only", "draw from the rng that is given to reset")
def global_random(c: Checker) -> str:
    """Compare the state of NumPy's global generator before and after a run."""
    before: Any = np.random.get_state()  # noqa: NPY002
    c.drive(c.make(), c.told.run(0))
    after: Any = np.random.get_state()  # noqa: NPY002
    if not (np.array_equal(before[1], after[1]) and before[2] == after[2]):
        raise Bad("NumPy's global random state was used")
    return ""


@_point("goes on without fixes", "use a fix only where obs['gps_valid'] is 1")
def without_fixes(c: Checker) -> str:
    """Play a run with every other fix missing."""
    playback = c.told.run(0)
    for obs in playback.observations[::2]:
        obs["gps_valid"][...] = 0
        obs["gps_vel"][...] = obs["gps_pos"][...] = 0.0
    c.drive(c.make(), playback)
    return "every other one missing"


@_point("begins without a told attitude", "task.start is None there: begin anywhere, and align in the coarse phase")
def unknown_start(c: Checker) -> str | None:
    """Play a run without a told attitude."""
    if c.told.task.navigate:
        return None
    c.drive(c.make(), Told(**UNKNOWN_START).run(0))
    return f"{COARSE_S:g} s coarse"


@_point("can be pickled", "keep lambdas, open files, locks and the like out of its attributes")
def picklable(c: Checker) -> str:
    """Play a run with a pickled copy."""
    try:
        copy = pickle.loads(pickle.dumps(c.make()))
    except Exception as error:
        raise Bad(f"{type(error).__name__}: {error}") from error
    return c.same(c.alone, c.drive(copy, c.told.run(0)), "an estimator and its pickled copy")


@_point(
    "covariance, if any: ({errors}, {errors}), symmetric, positive",
    "return that of the errors of what step returned last, or leave covariance out",
)
def covariance(c: Checker) -> str | None:
    """Check shape and sign of the covariance at the end of a run, and of a batch."""
    if not hasattr(c.make(), "covariance"):
        return None
    for playback, batched in ((c.told.run(0), False), *([(c.told.play(), True)] if c.batched else [])):
        loop = loop_of(c.make(), playback, batched)
        play(loop)
        try:
            P = loop.guard.covariance()
        except EstimatorError as error:
            raise Bad(str(error)) from error
        assert P is not None
        if not np.isfinite(P).all() or np.abs(P - np.swapaxes(P, -1, -2)).max() > c.tolerance * np.abs(P).max():
            raise Bad("not finite, or not symmetric")
        least = np.linalg.eigvalsh(P).min()
        if least <= 0:
            raise Bad(f"not positive: its smallest eigenvalue is {least:.3g}{'' if c.errors > 3 else ' rad^2'}")
    return ""
