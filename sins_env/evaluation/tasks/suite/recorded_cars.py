"""Real recordings of two cars, played window by window. docs/tasks_and_scores.md#recordings."""

from __future__ import annotations

from sins_env.evaluation.tasks.task import EvaluationTask

SOURCE = "docs/tasks_and_scores.md#recordings"

TASKS = (
    EvaluationTask(
        name="rlg-car-v0",
        what="real laser-gyro recording of a disturbed parked car, seven windows of 90 s coarse and 210 s fine",
        source=SOURCE,
        env_id="SINS/Replay-v0",
        delta_azimuth_deg=0.3,
        delta_level_arcsec=90.0,
        kwargs={"recording": "rlg_parked_car.npz", "window": [0.0, 300.0], "stride": 150.0, "coarse": 90.0},
        windows=7,
    ),
    EvaluationTask(
        name="navgrade-car-v0",
        what="real car recording with GPS: aligned for 68 s while parked and rocked, then navigated for 68 s of driving",
        source=SOURCE,
        env_id="SINS/Replay-v0",
        delta_azimuth_deg=0.5,
        delta_level_arcsec=210.0,
        kwargs={
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
)

#: Their worlds; another digest is another task and needs a new version.
DIGESTS = {
    "rlg-car-v0": "2d69dc1955b9ca4f",
    "navgrade-car-v0": "44f9874b76948d0a",
}
