"""Tables 6.4 to 6.8 of 000: fine alignment of a parked car, ten records in each of three headings, and the whole zoo on it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from sins_env.evaluation.reproduction.documents.car_coarse import RECORDS, said
from sins_env.evaluation.reproduction.readings.car import azimuth, level, of_records, whole
from sins_env.evaluation.reproduction.readings.common import Reader
from sins_env.evaluation.reproduction.tables import Group, Line, Table
from sins_env.evaluation.reproduction.verdicts import Printed
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask

RUNS, QUICK = 120, 12  #: numbers of runs of all three positions together
LAST_POINTS = 20  #: points whose mean is the result of the mixed filter; here they are 1 s apart
AS_THESIS = {"coarse": "svd"}  #: the coarse method before the filters

Part = Callable[[Reader], Reader]  #: function that turns a reader of all runs into one of some of them

#: Label, solver, and number of points whose mean is the result.
FILTERS = (
    ("UKF", "ukf", 0),
    ("ASMUGSF", "asmugsf", 0),
    ("UKF/H-infinity UKF", "mixed_hinf_ukf", LAST_POINTS),
    ("CGPF", "cgpf", 0),
)
#: Printed RMS, deg, of each filter (column) in each position (row).
PITCH = (
    (0.0058566843, 0.0059092767, 0.0055123054, 0.0058865073),
    (0.0479673846, 0.0479333266, 0.0479105728, 0.0479141924),
    (0.0378283240, 0.0377844390, 0.0379088980, 0.0377679910),
)
ROLL = (
    (0.0690612442, 0.0690534111, 0.0690493167, 0.0691085960),
    (0.0631112215, 0.0631124899, 0.0635301082, 0.0631167500),
    (0.0748030980, 0.0747751107, 0.0751401779, 0.0748167496),
)
AZIMUTH = (
    (0.02501934, 0.01648231, 0.026552107, 0.01642939),
    (0.02381447, 0.01758884, 0.04492300, 0.01815560),
    (0.02985057, 0.01942962, 0.041469539, 0.01986163),
)

CAR = get_task("vehicle-v0")  #: the records of the three positions, in this order
QUIET = replace(
    CAR,
    name="vehicle-quiet-v0",
    what=f"{CAR.what}; one unit without constant errors, 0.001 deg/sqrt(h)",
    kwargs={
        **CAR.kwargs,
        "imu": {"preset": "rlg-car", "arw_deg_sqrt_h": 0.001, "gyro_bias_deg_h": 0.0, "accel_bias_ug": 0.0},
    },
)
RECORDING = get_task("rlg-car-v0")
WINDOWS = "real recording rlg_parked_car.npz, seven windows of 300 s, each half in the next"
ANOTHER = "Another car, other people and another laser-gyro unit than in the thesis."


def _line(
    label: str, task: EvaluationTask, solver: str, read: Reader, printed: float | None = None, **settings: Any
) -> Line:
    figure = None if printed is None else Printed(printed, RECORDS, about_mean=True)
    quick = solver not in PARTICLES and not settings  # a first look shows what the thesis has and is not slow
    return Line(label, task, solver, read, {**AS_THESIS, **settings}, figure, quick=quick)


def _azimuth_lines(task: EvaluationTask, printed: tuple[float, ...], of: Part) -> tuple[Line, ...]:
    pairs = zip(FILTERS, printed, strict=True)
    return (
        *(_line(label, task, solver, of(azimuth(points)), figure) for (label, solver, points), figure in pairs),
        _line("UKF/H-infinity UKF, last point", task, "mixed_hinf_ukf", of(azimuth())),
        _line("UKF after the aligner's own coarse method", task, "ukf", of(azimuth()), coarse="aided"),
    )


def _position(position: int) -> tuple[str, Part]:
    """Return the description of a position, and what makes a reader of its records alone."""
    ten = slice(RECORDS * (position - 1), RECORDS * position)
    return said(ten), partial(of_records, ten)


def _azimuth_table(position: int) -> Table:
    words, of = _position(position)
    printed = AZIMUTH[position - 1]
    return Table(
        f"6.{5 + position}",
        f"fine heading of a parked car, position {position}",
        "000",
        "Standard deviation of the heading error over records after 90 s of coarse (inertial, SVD) and 210 s of fine alignment, "
        "simulated and on a recording of another car. As in the thesis the mixed filter's result is the mean of its last 20 "
        "points, which are seconds here. The second group is not the stated unit but one whose random walk the printed figures "
        "leave room for, without constant errors, which repeat: here differences between the filters would show. The windows of "
        "the recording are the same beside each of the printed positions.",
        (
            Group(
                f"simulated car, {words}; the unit as stated, another in each record",
                "deg",
                _azimuth_lines(CAR, printed, of),
                RUNS,
                QUICK,
                "The stated random walk of 0.005 deg/sqrt(h) alone spreads a heading found within 300 s by 0.08 deg, and a "
                "constant bias of 0.01 deg/h adds 0.045 deg from unit to unit: no filter gets below.",
            ),
            Group(
                f"simulated car, {words}; one unit with 0.001 deg/sqrt(h)",
                "deg",
                _azimuth_lines(QUIET, printed, of),
                RUNS,
                QUICK,
            ),
            Group(WINDOWS, "deg", _azimuth_lines(RECORDING, printed, whole), RUNS, QUICK, ANOTHER),
        ),
    )


def _level_lines(name: str, task: EvaluationTask, printed: tuple[float, ...] | None, of: Part) -> tuple[Line, ...]:
    figures = printed or (None,) * len(FILTERS)
    found = [
        _line(label, task, solver, of(level(name, "found", points)), figure)
        for (label, solver, points), figure in zip(FILTERS, figures, strict=True)
    ]
    errors = [
        _line(f"{label}, its error alone", task, solver, of(level(name, "error", points)))
        for label, solver, points in FILTERS
    ]
    return (*found, _line("the car itself", task, "ukf", of(level(name, "true"))), *errors)


def _level_table(number: str, name: str, printed: tuple[tuple[float, ...], ...]) -> Table:
    positions = [_position(i) for i in (1, 2, 3)]
    groups = [
        Group(
            f"simulated car, {words}",
            "deg",
            _level_lines(name, CAR, figures, of),
            RUNS,
            QUICK,
            "How far the car tilts is how many people get in and out and where they sit, which the thesis does not give.",
        )
        for (words, of), figures in zip(positions, printed, strict=True)
    ]
    return Table(
        number,
        f"{name} of a parked car",
        "000",
        f"Standard deviation of the {name} over records after 90 s + 210 s. What is printed is no error: the filters "
        "agree within 0.0005 deg, for it is how the car itself stood when each record ended, with the people then in it. A "
        "simulated car counts from its place; the errors on the recording are against a smoother on the same sensors.",
        (*groups, Group(WINDOWS, "deg", _level_lines(name, RECORDING, None, whole), RUNS, QUICK)),
    )


#: The filters in the report, without the adapters of filterpy, whose mathematics is that of kf, ekf and ukf.
# fmt: off
ZOO = (
    "kf", "ekf", "iekf", "inekf", "gm_ekf", "ukf", "ckf", "ckf5", "ddf1", "ddf2", "aukf", "aukf_fading", "aukf_window",
    "augmented_aukf", "asmugsf", "gsf_ekf", "hinf_kf", "hinf_ukf", "hinf_uif", "mixed_hinf_ukf", "huber_ckf",
    "huber_ckf5", "mcc_ckf", "mcc_ckf5", "student_t_ckf", "imm_ekf", "imm_ukf", "mpf", "mpf_ekf",
)
# fmt: on
PARTICLES = ("cgpf", "ugpf", "gpf", "rqmc_gpf", "upf", "hepf", "pf")


#: Solvers without a filter, whose coarse phase goes on to the end.
COARSE: dict[str, dict[str, Any]] = {"coarse_inertial": {"method": "svd"}, "coarse_oba": {}}


def _zoo(task: EvaluationTask, solvers: tuple[str, ...], read: Reader) -> tuple[Line, ...]:
    unbroken = [Line(f"{solver}, unbroken", task, solver, read, settings) for solver, settings in COARSE.items()]
    return (*unbroken, *(_line(solver, task, solver, read) for solver in solvers))


def _zoo_table() -> Table:
    spread, rms = azimuth(), azimuth(about_mean=False)
    car = "simulated car, all three positions, one unit with 0.001 deg/sqrt(h)"
    return Table(
        "6.zoo",
        "fine heading of a parked car, every filter",
        "after 000 ch. 6",
        "Heading error after 90 s of coarse (inertial, SVD) and 210 s of fine alignment: standard deviation over records or "
        "windows, and RMS against the recording's reference, which is a smoother's on the same data. None of it is printed. The "
        "first two lines have no fine phase and use all 300 s; the filters are told that 90 s left 2 deg, and lose them.",
        (
            Group(f"{WINDOWS}: spread", "deg", _zoo(RECORDING, ZOO + PARTICLES, spread), RUNS, QUICK),
            Group(f"{WINDOWS}: RMS", "deg", _zoo(RECORDING, ZOO + PARTICLES, rms), RUNS, QUICK),
            Group(f"{car}: spread", "deg", _zoo(QUIET, ZOO, spread), 30, 6),
            Group(f"{car}: spread, particles", "deg", _zoo(QUIET, PARTICLES, spread), 30, 6),
        ),
        beyond=True,
    )


TABLES = (
    _level_table("6.4", "pitch", PITCH),
    _level_table("6.5", "roll", ROLL),
    *(_azimuth_table(position) for position in (1, 2, 3)),
    _zoo_table(),
)
