"""The tasks as data: the fields of :class:`sins_env.evaluation.tasks.task.EvaluationTask`, by name. docs/tasks_and_scores.md#tasks.

Thresholds are three times the bound at the end of the task, rounded up: azimuth to 0.1 deg, level to 10 arcsec;
of rlg-car, vehicle and static8 by definition; of navgrade-car four sigmas of its reference's heading, and the tilt
that an accelerometer bias of 1000 ug makes.
"""

from __future__ import annotations

from typing import Any

Fields = dict[str, Any]


def _fields(
    env_id: str, name: str, what: str, source: str, azimuth_deg: float, level_arcsec: float, kwargs: Fields, **more: Any
) -> Fields:
    thresholds = {"delta_azimuth_deg": azimuth_deg, "delta_level_arcsec": level_arcsec}
    return {"name": name, "what": what, "source": source, "env_id": env_id, **thresholds, "kwargs": kwargs, **more}


def _sway(name: str, what: str, source: str, azimuth_deg: float, level_arcsec: float, **kwargs: Any) -> Fields:
    """The swaying base of the thesis, told start, white IMU errors and matched prior but for what ``kwargs`` says."""
    usual = {"imu": "thesis-white", "gps": "thesis", "start": "told", "prior": "matched"}
    return _fields("SINS/AlignSway-v0", name, what, source, azimuth_deg, level_arcsec, {**usual, **kwargs})


def _flight(
    name: str, what: str, source: str, azimuth_deg: float, level_arcsec: float, rank_by: str, **more: Any
) -> Fields:
    """The profile of this name, with its own sensors, fixes and start; ``more``: fields of the task."""
    kwargs = {"profile": name}
    ranked = {"rank_by": rank_by, **more}
    return _fields("SINS/NavFlight-v0", f"flight-{name}-v0", what, source, azimuth_deg, level_arcsec, kwargs, **ranked)


#: 000 section 6.1: three headings, ten records each; doors, then rocking (2 of 30) or people, then people.
VEHICLE_HEADINGS_DEG = [*[149.4] * 10, *[-28.8] * 10, *[-26.3] * 10]
VEHICLE_SCENES = [*["doors"] * 10, *["rocking"] * 2, *["people"] * 18]

DEFINITIONS: tuple[Fields, ...] = (
    _sway(
        "sway-white-v0",
        "swaying base, told attitude wrong by 1/1/15 deg (1 sigma), white IMU errors, matched prior, 360 s",
        "000 ch. 3, 5",
        0.7,
        70.0,
        duration=360.0,
    ),
    _sway(
        "sway-markov-v0",
        "swaying base, told attitude wrong by 1/1/15 deg (1 sigma), Gauss-Markov IMU errors, matched prior, 600 s",
        "000 ch. 3-5",
        1.6,
        70.0,
        imu="thesis-markov",
        duration=600.0,
    ),
    _sway(
        "sway-told-wrong-v0",
        "swaying base, told the prior of 000 section 2.5.4 and R = (0.1 m/s)^2 while the GPS is 0.01 m/s, 360 s",
        "000 section 2.5.4",
        0.6,
        60.0,
        gps={"vel_std_mps": 0.01, "rate_hz": 10},
        prior="thesis",
        duration=360.0,
    ),
    _sway(
        "sway-scratch-v0",
        "swaying base, unknown attitude: 120 s coarse and 360 s fine alignment",
        "000 fig. 2.6",
        0.7,
        70.0,
        start="unknown",
        coarse=120.0,
        duration=480.0,
    ),
    _sway(
        "sway-contaminated-v0",
        "sway-white with a GPS of which 20 % of the fixes have 10 times the variance",
        "003",
        0.7,
        70.0,
        gps={"contamination": 0.2, "contamination_factor": 10.0},
        duration=360.0,
    ),
    _sway(
        "sway-jump-v0",
        "sway-white with a GPS velocity that is 1 m/s off for 5 s, at a time drawn per run and not told",
        "robust filters",
        0.7,
        70.0,
        gps={"jump_mps": 1.0, "jump_s": 5.0},
        duration=360.0,
    ),
    _sway(
        "sway-heavytail-v0",
        "sway-white with a GPS whose errors are Student-t with 3 degrees of freedom",
        "robust filters",
        0.7,
        70.0,
        gps={"heavy_tail_dof": 3.0},
        duration=360.0,
    ),
    _sway(
        "sway-anyheading-v0",
        "sway-white with a told heading that may be wrong by anything up to 180 deg",
        "particle and bank filters",
        0.7,
        70.0,
        any_heading=True,
        duration=360.0,
    ),
    _fields(
        "SINS/Replay-v0",
        "rlg-car-v0",
        "real laser-gyro recording of a disturbed parked car, seven windows of 90 s coarse and 210 s fine",
        "../shared/data",
        0.3,
        90.0,
        {"recording": "rlg_parked_car.npz", "window": [0.0, 300.0], "stride": 150.0, "coarse": 90.0},
        windows=7,
    ),
    _fields(
        "SINS/AlignVehicle-v0",
        "vehicle-v0",
        "parked car with doors, rocking and people at three headings, ten records each, 90 s coarse and 210 s fine",
        "000 ch. 6",
        0.3,
        90.0,
        {"heading_deg": VEHICLE_HEADINGS_DEG, "events": VEHICLE_SCENES, "coarse": 90.0, "duration": 300.0},
        records=30,
    ),
    _fields(
        "SINS/AlignStatic-v0",
        "static8-v0",
        "base that stands still at eight headings, laser-gyro IMU, velocity known to 0.03 m/s, 90 s coarse and 210 s fine",
        "000 section 6.2.3",
        0.3,
        90.0,
        {
            "heading_deg": [45.0 * i for i in range(8)],
            "start": "unknown",
            "imu": "rlg-car",
            "n_sub": 10,
            "gps": {"vel_std_mps": 0.03, "pos_std_m": 1.0, "rate_hz": 10},
            "coarse": 90.0,
            "duration": 300.0,
        },
        records=8,
    ),
    _fields(
        "SINS/Replay-v0",
        "navgrade-car-v0",
        "real car recording with GPS: aligned for 68 s while parked and rocked, then navigated for 68 s of driving",
        "../shared/data",
        0.5,
        210.0,
        {
            "recording": "navgrade_car_gps.npz",
            "mode": "navigate",
            "window": [0.0, 136.35],
            "epoch": 0.05,
            "coarse": 68.0,
            "imu": "navgrade-car",
            "gps": "dgps",
        },
        hold_s=30.0,
        windows=1,
        score_from_s=68.0,
        rank_by="position",
    ),
    _flight(
        "sun2012",
        "900 s at 2 m/s, told attitude wrong by 3/3/10 deg (1 sigma), GPS 1 Hz; heading is hardly observable",
        "001",
        2.3,
        110.0,
        "azimuth",
    ),
    _flight(
        "sun2012-fixed",
        "flight-sun2012 as printed: misalignment and biases are + 1 sigma in every run",
        "001",
        2.3,
        110.0,
        "azimuth",
    ),
    _flight(
        "sun2012-physical",
        "flight-sun2012 as an aircraft could fly it: 40 m/s, coordinated turns",
        "001",
        0.3,
        130.0,
        "azimuth",
    ),
    _flight(
        "lu-gauss",
        "600 s at 110 m/s with orbits at 30 deg bank, GPS 10 Hz; scored from 100 s on",
        "003",
        0.1,
        20.0,
        "position",
        score_from_s=100.0,
    ),
    _flight(
        "lu-mixture",
        "flight-lu-gauss with a GPS of which 20 % of the fixes have 10 times the variance",
        "003",
        0.1,
        20.0,
        "position",
        score_from_s=100.0,
    ),
    _flight(
        "zhao2010",
        "500 s at 60 m/s, IMU noise that swells and fades and has a mean, told as constant; fixed start errors",
        "002 ex. 3",
        0.1,
        60.0,
        "position",
    ),
    *(
        _flight(
            f"hotstart{spread[2]}",
            f"300 s at 40 m/s with one turn, told attitude wrong by {'/'.join(map(str, spread))} deg (1 sigma)",
            "docs/mathematics/simulation.md#flight-profiles",
            0.4,
            190.0,
            "failures",
            fail_azimuth_deg=5.0,
        )
        for spread in ((5, 5, 30), (10, 10, 60), (20, 20, 90))
    ),
)
