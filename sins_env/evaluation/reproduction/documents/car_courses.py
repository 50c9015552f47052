"""Figures 6.3 to 6.40 of 000: the fine alignment of each of the thirty records of a parked car, over time."""

from __future__ import annotations

from typing import Any

import numpy as np

from sins_env.evaluation.reproduction.documents.car_fine import AS_THESIS, CAR, FILTERS, RECORDING, RUNS
from sins_env.evaluation.reproduction.documents.car_interference import car
from sins_env.evaluation.reproduction.pictures.records import Played, Record, attitudes, headings
from sins_env.evaluation.reproduction.readings.car import settled_s
from sins_env.evaluation.reproduction.readings.common import percentage
from sins_env.evaluation.reproduction.tables import Group, Line, Source, Table
from sins_env.evaluation.reproduction.verdicts import Estimate, Said, median
from sins_env.evaluation.score import paired
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.tasks.task import EvaluationTask

#: Headings, deg, of the records 1 to 10 in each position as printed in tables 6.6 to 6.8, a row for each of FILTERS.
HEADINGS = (
    (
        (149.36955873, 149.36406412, 149.38612152, 149.31398353, 149.37675242, 149.36430388, 149.32007124, 149.37589253,
         149.38340618, 149.36934284),
        (149.36042898, 149.35948883, 149.35860820, 149.32693473, 149.37888500, 149.34532229, 149.34141195, 149.35917547,
         149.34082565, 149.32671397),
        (149.34822298, 149.38260294, 149.39607221, 149.30802591, 149.39131637, 149.37307524, 149.38193171, 149.38776510,
         149.38838764, 149.36896023),
        (149.37817236, 149.36526814, 149.38883067, 149.36026744, 149.41502718, 149.38491836, 149.36824796, 149.37704695,
         149.36180437, 149.36964097),
    ),
    (
        (-28.862609015, -28.824955099, -28.790584574, -28.848700793, -28.818397559, -28.806219313, -28.815183969,
         -28.801809605, -28.787738972, -28.824859964),
        (-28.845705455, -28.811837048, -28.795397129, -28.806271134, -28.783701159, -28.795590508, -28.816168541,
         -28.790369699, -28.807343932, -28.816693461),
        (-28.8654344885, -28.8321161599, -28.7569690446, -28.8732914065, -28.8241878211, -28.8450147990, -28.8394590191,
         -28.8027495615, -28.7323004921, -28.8067660835),
        (-28.847213108, -28.828845399, -28.810460775, -28.823982984, -28.784192738, -28.837472065, -28.826204467,
         -28.815836371, -28.843328684, -28.827510842),
    ),
    (
        (-26.444695058, -26.448554624, -26.397097729, -26.403187243, -26.424103345, -26.423017177, -26.346101335,
         -26.389141012, -26.422848344, -26.401943980),
        (-26.436242192, -26.425788819, -26.409228938, -26.407870652, -26.422564487, -26.421443988, -26.365859531,
         -26.406484459, -26.404699413, -26.396663934),
        (-26.441003643, -26.452575722, -26.403351594, -26.372759344, -26.424664664, -26.437331107, -26.329217079,
         -26.425334284, -26.348277022, -26.394301273),
        (-26.447499804, -26.427870856, -26.419485565, -26.409831608, -26.433551609, -26.431045514, -26.380463199,
         -26.406325975, -26.401109085, -26.400026022),
    ),
)  # fmt: skip
TEN, WINDOWS = 10, 7
WITHIN_DEG = 0.03  #: width within which a curve is at its end, as it may be seen by eye
LABELS = [label for label, *_ in FILTERS]
SOLVERS = {label: solver for label, solver, _ in FILTERS}


def records() -> list[Record]:
    """Return the panels: each record with the printed headings at its end, from the mean of the ten of their filter."""
    away = np.array(HEADINGS) - np.mean(HEADINGS, axis=2, keepdims=True)
    return [
        Record(
            f"{position + 1}.{i + 1}", TEN * position + i, dict(zip(LABELS, away[position, :, i].tolist(), strict=True))
        )
        for position in range(len(HEADINGS))
        for i in range(TEN)
    ]


def _filters(task: EvaluationTask) -> dict[str, Source]:
    return {label: Source(task, solver, AS_THESIS) for label, solver in SOLVERS.items()}


def _played(record: int, words: str, *events: tuple[float, str]) -> Played:
    """Return a row of the car of position 3, on which these events happen at these times."""
    script: list[dict[str, Any]] = [{"t": t, "kind": kind} for t, kind in events]
    return Played(words, _filters(car(f"record-3-{record}", f"record {record} of position 3", script)))


#: The two records that the text describes. It times the first two events of record 7 alone: 55 s and 90 s into the fine phase.
TYPICAL = (
    _played(6, "record 3.6, in, out and a door", (130.0, "in"), (190.0, "out"), (250.0, "door")),
    _played(
        7,
        "record 3.7, out, in and doors",
        (145.0, "out"),
        (180.0, "in"),
        (210.0, "door"),
        (235.0, "door"),
        (260.0, "door"),
    ),
)


def settling(results: Results) -> Estimate:
    """Read the time into the fine phase at which the azimuth settles, s, median over runs."""
    return median(settled_s(results, WITHIN_DEG))


def earlier(one: Results, other: Results) -> Estimate:
    """Read the share, %, of the runs in which the azimuths of two filters settle at two times and the first one is earlier."""
    mine, its = paired.common(one.records, other.records)
    a, b = (settled_s(r, WITHIN_DEG)[rows] for r, rows in ((one, mine), (other, its)))
    return percentage((a < b)[(a < b) | (a > b)])


def _earlier(one: str, other: str, said: str) -> Line:
    at = Source(CAR, SOLVERS[other], AS_THESIS)
    return Line(f"{one} before {other}", CAR, SOLVERS[one], earlier, AS_THESIS, Said(said, low=50.0), at)


TABLES = (
    Table(
        "6.figures",
        "fine alignment of a parked car over time, thirty records",
        "000",
        f"Azimuth over time, after 90 s of coarse alignment. It has settled from when on it stays within {WITHIN_DEG:g} deg "
        "of where it ends. The print shows curves without numbers; its headings at the end are those of tables 6.6 to 6.8. The "
        "records are ours: a simulated car with the stated unit, and a recording of another car. An estimator in alignment "
        "answers the attitude alone, so that the velocities of figures 6.3, 6.4, 6.8 and 6.9 are not on record.",
        (
            Group(
                "simulated car, when the azimuth settles",
                "s, median",
                tuple(Line(label, CAR, solver, settling, AS_THESIS) for label, solver in SOLVERS.items()),
                RUNS,
                0,
            ),
            Group(
                "simulated car, which filter settles first",
                "% of runs",
                (
                    _earlier("CGPF", "ASMUGSF", "in 21 of 30 records"),
                    _earlier("ASMUGSF", "UKF", "clearly"),
                    _earlier("CGPF", "UKF", "clearly"),
                    _earlier("UKF/H-infinity UKF", "UKF", "converges fastest"),
                ),
                RUNS,
                0,
                "The filters are told one prior and see one gyro: near the end they have nearly one error. Which of them comes "
                "within the limit first is decided by the first seconds.",
            ),
        ),
        name="figures 6.3 to 6.40",
        pictures=(
            attitudes(
                "figure-6-5",
                "Heading, pitch and roll over time on two simulated records with the events that the text of records 6 and 7 of "
                "position 3 names, one run; after figures 6.5 to 6.7 and 6.10 to 6.12. Black: the car itself.",
                TYPICAL,
                quick=0,
            ),
            headings(
                "figure-6-13",
                "Azimuth error over time on thirty simulated records, position.record, with the stated unit, another in each "
                "record; after figures 6.7, 6.12 and 6.13 to 6.40. Dots: the printed headings, from their mean over the ten "
                "records of the filter.",
                _filters(CAR),
                records(),
                TEN,
                0.6,
                runs=30,
                quick=0,
            ),
            headings(
                "figure-6-recording",
                "Azimuth error over time in the seven windows of a laser-gyro recording of another parked car, against a "
                "smoother on the same data; after figures 6.13 to 6.40.",
                _filters(RECORDING),
                [Record(f"window {i + 1}", i) for i in range(WINDOWS)],
                WINDOWS,
                0.3,
                runs=WINDOWS,
                quick=0,
            ),
        ),
    ),
)
