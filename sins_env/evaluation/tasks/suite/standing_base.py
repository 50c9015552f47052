"""A base that stands still, and a parked car with people about it. docs/mathematics/simulation.md#parked-car."""

from __future__ import annotations

from sins_env.evaluation.tasks.task import EvaluationTask

#: Headings and scenes of the records in 000 section 6.1: ten at each of three headings. The first ten have doors, the next
#: two rocking, and the others people.
VEHICLE_HEADINGS_DEG = [*[149.4] * 10, *[-28.8] * 10, *[-26.3] * 10]
VEHICLE_SCENES = [*["doors"] * 10, *["rocking"] * 2, *["people"] * 18]

TASKS = (
    EvaluationTask(
        name="static8-v0",
        what="base that stands still at eight headings, laser-gyro IMU, velocity known to 0.03 m/s, 90 s coarse and 210 s fine",
        source="000 section 6.2.3",
        env_id="SINS/AlignStatic-v0",
        delta_azimuth_deg=0.3,
        delta_level_arcsec=90.0,
        kwargs={
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
    EvaluationTask(
        name="vehicle-v0",
        what="parked car with doors, rocking and people at three headings, ten records each, 90 s coarse and 210 s fine",
        source="000 ch. 6",
        env_id="SINS/AlignVehicle-v0",
        delta_azimuth_deg=0.3,
        delta_level_arcsec=90.0,
        kwargs={"heading_deg": VEHICLE_HEADINGS_DEG, "events": VEHICLE_SCENES, "coarse": 90.0, "duration": 300.0},
        records=30,
    ),
)

#: Their worlds; another digest is another task and needs a new version.
DIGESTS = {
    "static8-v0": "517bec60e1f27b00",
    "vehicle-v0": "0da1285c86438ffd",
}
