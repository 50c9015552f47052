"""Flights of the papers, each with its own sensors, fixes and start. docs/mathematics/simulation.md#flight-profiles."""

from __future__ import annotations

from sins_env.evaluation.tasks.task import EvaluationTask

ENV = "SINS/NavFlight-v0"

TASKS = (
    EvaluationTask(
        name="flight-sun2012-v0",
        what="900 s at 2 m/s, told attitude wrong by 3/3/10 deg (1 sigma), GPS 1 Hz; heading is hardly observable",
        source="001",
        env_id=ENV,
        delta_azimuth_deg=2.3,
        delta_level_arcsec=110.0,
        kwargs={"profile": "sun2012"},
    ),
    EvaluationTask(
        name="flight-sun2012-fixed-v0",
        what="flight-sun2012 as printed: misalignment and biases are + 1 sigma in every run",
        source="001",
        env_id=ENV,
        delta_azimuth_deg=2.3,
        delta_level_arcsec=110.0,
        kwargs={"profile": "sun2012-fixed"},
    ),
    EvaluationTask(
        name="flight-sun2012-physical-v0",
        what="flight-sun2012 as an aircraft could fly it: 40 m/s, coordinated turns",
        source="001",
        env_id=ENV,
        delta_azimuth_deg=0.3,
        delta_level_arcsec=130.0,
        kwargs={"profile": "sun2012-physical"},
    ),
    EvaluationTask(
        name="flight-lu-gauss-v0",
        what="600 s at 110 m/s with orbits at 30 deg bank, GPS 10 Hz; scored from 100 s on",
        source="003",
        env_id=ENV,
        delta_azimuth_deg=0.1,
        delta_level_arcsec=20.0,
        kwargs={"profile": "lu-gauss"},
        score_from_s=100.0,
        rank_by="position",
    ),
    EvaluationTask(
        name="flight-lu-mixture-v0",
        what="flight-lu-gauss with a GPS of which 20 % of the fixes have 10 times the variance",
        source="003",
        env_id=ENV,
        delta_azimuth_deg=0.1,
        delta_level_arcsec=20.0,
        kwargs={"profile": "lu-mixture"},
        score_from_s=100.0,
        rank_by="position",
    ),
    EvaluationTask(
        name="flight-zhao2010-v0",
        what="500 s at 60 m/s, IMU noise that swells and fades and has a mean, told as constant; fixed start errors",
        source="002 ex. 3",
        env_id=ENV,
        delta_azimuth_deg=0.1,
        delta_level_arcsec=60.0,
        kwargs={"profile": "zhao2010"},
        rank_by="position",
    ),
)

#: Their worlds; another digest is another task and needs a new version.
DIGESTS = {
    "flight-sun2012-v0": "524b1b52ba5d8cd6",
    "flight-sun2012-fixed-v0": "bf9a58fab9da0acf",
    "flight-sun2012-physical-v0": "e67812be9982a921",
    "flight-lu-gauss-v0": "a165e82fcef2e32c",
    "flight-lu-mixture-v0": "5e73dd2b04804fb6",
    "flight-zhao2010-v0": "6192afc3f36589e5",
}
