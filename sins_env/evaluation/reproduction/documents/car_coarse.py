"""Tables 6.1 to 6.3 of 000: heading of a parked car after 90 s of coarse alignment, ten records in each of three headings."""

from __future__ import annotations

from typing import Any

from sins_env.evaluation.reproduction.readings.car import azimuth
from sins_env.evaluation.reproduction.tables import Group, Line, Table
from sins_env.evaluation.reproduction.verdicts import Printed
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask

RECORDS = 10  #: number of records behind each printed figure
CAP_DEG = 180.0  #: no angle is further off; the printed methods are off by tens of degrees
COARSE_S = 90.0
#: Headings and scenes of the thirty records.
HEADINGS_DEG, SCENES = (get_task("vehicle-v0").kwargs[name] for name in ("heading_deg", "events"))
_LAST = 0.1  #: length of the fine phase, whose epoch is read; these estimators go on through it


def _task(name: str, what: str, env_id: str, kwargs: dict[str, Any], **more: Any) -> EvaluationTask:
    settings = {"coarse": COARSE_S - _LAST, **kwargs}
    return EvaluationTask(name, what, "000 tables 6.1-6.3", env_id, 0.3, 90.0, settings, **more)


def _car(number: str, first: int) -> EvaluationTask:
    """Return the task with ten records of ``vehicle-v0``, from the record ``first`` on."""
    ten = slice(first, first + RECORDS)
    headings, scenes = HEADINGS_DEG[ten], SCENES[ten]
    what = f"simulated parked car, {said(ten)}, {COARSE_S:g} s"
    settings = {"heading_deg": headings, "events": scenes, "duration": COARSE_S}
    return _task(f"table-{number}-car-v0", what, "SINS/AlignVehicle-v0", settings, records=RECORDS)


def said(part: slice) -> str:
    """Describe the records of one position of ``vehicle-v0`` in words."""
    scenes = SCENES[part]
    counts = " and ".join(f"{scenes.count(name)} records of {name}" for name in dict.fromkeys(scenes))
    return f"{counts}, heading {HEADINGS_DEG[part][0]:g} deg"


RECORDING = _task(
    "table-6-rlg-car-v0",
    f"real laser-gyro recording of a disturbed parked car, thirteen windows of {COARSE_S:g} s",
    "SINS/Replay-v0",
    {"recording": "rlg_parked_car.npz", "window": [0.0, COARSE_S], "stride": COARSE_S},
    windows=13,
)


def _lines(task: EvaluationTask, inertial: float, *analytic: float) -> tuple[Line, ...]:
    """Return lines of the thesis' inertial method, of the analytic ones, and of methods that came later."""

    def line(label: str, solver: str, printed: float | None = None, **settings: Any) -> Line:
        figure = None if printed is None else Printed(printed, RECORDS, about_mean=True)
        return Line(label, task, solver, azimuth(cap_deg=CAP_DEG), settings, figure)

    return (
        line("inertial, two vectors", "coarse_inertial", inertial, method="two_vector"),
        *(line(f"analytic {i}", f"coarse_analytic{i}", printed) for i, printed in enumerate(analytic, start=1)),
        line("inertial, SVD", "coarse_inertial", method="svd"),
        line("OBA, velocity zero", "coarse_oba"),
    )


def _table(number: str, first: int, *printed: float) -> Table:
    car = _car(number, first)
    return Table(
        number,
        f"coarse heading of a parked car, {HEADINGS_DEG[first]:g} deg",
        "000",
        "Standard deviation of the heading over records after 90 s (the thesis' RMS, about the mean), simulated and on a recording "
        "of another car. The thesis has one inertial method, taken to be that of its section 2.4: two vectors.",
        (
            Group(
                car.what,
                "deg",
                _lines(car, *printed),
                why="How far the analytic methods are off is how much the car tilted within 90 s: the size and number of the "
                "disturbances, which the thesis does not give. The told angular random walk of 0.005 deg/sqrt(h) alone spreads "
                "a heading found within 90 s by at least 0.16 deg, whatever the method.",
            ),
            Group(
                RECORDING.what,
                "deg",
                _lines(RECORDING, *printed),
                why="Another car, other people and another laser-gyro unit than in the thesis.",
            ),
        ),
    )


TABLES = (
    _table("6.1", 0, 0.0876907098, 6.76135746, 6.74120811, 6.75025366),
    _table("6.2", 10, 0.197628949, 36.1586290, 36.2884465, 36.2735570),
    _table("6.3", 20, 0.127375472, 31.8640862, 31.9373905, 31.9067849),
)
