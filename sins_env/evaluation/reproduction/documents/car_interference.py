"""The effect of one disturbance on the heading of a parked car, before and after a filter has converged. 000 section 6.2.

The thesis sorts its thirty records by the time of the disturbance and reads figures 6.3 to 6.40 by eye. It prints no
numbers. Here each run has an undisturbed twin, with the same car and the same sensors.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from sins_env.evaluation.reproduction.documents.car_fine import AS_THESIS, CAR
from sins_env.evaluation.reproduction.readings.car import excursion, left, recovery
from sins_env.evaluation.reproduction.readings.common import Reader
from sins_env.evaluation.reproduction.tables import Group, Line, Source, Table
from sins_env.evaluation.tasks.task import EvaluationTask

BEFORE_S, AFTER_S = 120.0, 230.0  #: 30 s and 140 s into the fine phase
HEADING_DEG = -26.3
BACK_DEG = 0.01
RUNS, QUICK = 20, 6
#: The four filters of the thesis, and one that bounds outliers.
SOLVERS = ("ukf", "asmugsf", "mixed_hinf_ukf", "cgpf", "huber_ckf")
KINDS = {"door": "a door slammed", "in": "a person in", "out": "a person out", "rock": "rocking by hand"}
_NAME = "car-interference"
WHEN = {"before": (BEFORE_S,), "after": (AFTER_S,), "both": (BEFORE_S, AFTER_S)}


def task(kind: str, when: str) -> EvaluationTask:
    """Return the task with a kind of disturbance before or after convergence; "both" is a person in, and out again."""
    kinds = ("in", "out") if when == "both" else (kind,)
    events: list[dict[str, Any]] = [{"t": t, "kind": one} for t, one in zip(WHEN[when], kinds, strict=True)]
    return car(f"{kind}-{when}", f"{' and '.join(KINDS[one] for one in kinds)}, {when} convergence", events)


def car(name: str, what: str, events: Any) -> EvaluationTask:
    kwargs = {**CAR.kwargs, "heading_deg": HEADING_DEG, "events": events}
    full, what = f"{_NAME}-{name}-v0", f"simulated parked car, {what}"
    return replace(CAR, name=full, what=what, kwargs=kwargs, records=0, seeds_of=_NAME)


UNDISTURBED = car("quiet", "undisturbed", [])


def _group(when: str, what: str, unit: str, read: Reader) -> Group:
    kinds = {"in": "a person in, and out"} if when == "both" else KINDS
    times = " and ".join(f"{t:g} s" for t in WHEN[when])
    lines = tuple(
        Line(
            f"{words}: {solver}",
            task(kind, when),
            solver,
            read,
            AS_THESIS,
            None,
            Source(UNDISTURBED, solver, AS_THESIS),
        )
        for kind, words in kinds.items()
        for solver in SOLVERS
    )
    title = "before and after" if when == "both" else when
    return Group(f"{title} convergence, at {times}: {what}", unit, lines, RUNS, QUICK)


LARGEST, LEFT = "largest effect on the azimuth", "what is left of it at 300 s"
TABLES = (
    Table(
        "6.interference",
        "one disturbance of a parked car, before and after convergence",
        "after 000 section 6.2",
        "Difference in azimuth from the same run without the disturbance, same car and same sensors, after 90 s of coarse "
        f"(inertial, SVD) alignment. Fine alignment begins at 90 s; the disturbances at {BEFORE_S:g} s, before it has converged, "
        f"and at {AFTER_S:g} s, after it. The thesis prints no figures of it, and says: what comes before convergence costs more, "
        "and what comes after it ASMUGSF and CGPF suppress better than the UKF, CGPF best.",
        (
            _group("before", LARGEST, "deg RMS", excursion(BEFORE_S)),
            _group("before", f"time until it stays below {BACK_DEG:g} deg", "s, median", recovery(BEFORE_S, BACK_DEG)),
            _group("before", LEFT, "deg RMS", left),
            _group("after", LARGEST, "deg RMS", excursion(AFTER_S)),
            _group("after", LEFT, "deg RMS", left),
            _group("both", LEFT, "deg RMS", left),
        ),
        beyond=True,
    ),
)
