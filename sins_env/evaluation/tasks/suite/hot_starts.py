"""Starts in flight with a told heading that is far off. docs/mathematics/simulation.md#flight-profiles."""

from __future__ import annotations

from sins_env.evaluation.tasks.task import EvaluationTask

#: Standard deviations E, N, U of the told attitude, deg; the last one is in the name of the task.
SPREADS_DEG = ((5, 5, 30), (10, 10, 60), (20, 20, 90))

TASKS = tuple(
    EvaluationTask(
        name=f"flight-hotstart{heading}-v0",
        what=f"300 s at 40 m/s with one turn, told attitude wrong by {east}/{north}/{heading} deg (1 sigma)",
        source="docs/mathematics/simulation.md#flight-profiles",
        env_id="SINS/NavFlight-v0",
        delta_azimuth_deg=0.4,
        delta_level_arcsec=190.0,
        kwargs={"profile": f"hotstart{heading}"},
        rank_by="failures",
        fail_azimuth_deg=5.0,
    )
    for east, north, heading in SPREADS_DEG
)

#: Their worlds; another digest is another task and needs a new version.
DIGESTS = {
    "flight-hotstart30-v0": "38541a52707bb829",
    "flight-hotstart60-v0": "b557708e841160d8",
    "flight-hotstart90-v0": "e6cb690f2c9b81fd",
}
