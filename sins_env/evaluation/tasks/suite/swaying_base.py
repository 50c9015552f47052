"""Swaying base of the thesis, 000 section 2.5.1, with one disturbance at a time. docs/mathematics/simulation.md#sway."""

from __future__ import annotations

from sins_env.evaluation.tasks.task import EvaluationTask

ENV = "SINS/AlignSway-v0"
#: Usual settings: sensors and fixes of the thesis, with a told start and an assumed noise that equals the true one.
USUAL = {"imu": "thesis-white", "gps": "thesis", "start": "told", "prior": "matched", "duration": 360.0}

TASKS = (
    EvaluationTask(
        name="sway-white-v0",
        what="swaying base, told attitude wrong by 1/1/15 deg (1 sigma), white IMU errors, matched prior, 360 s",
        source="000 ch. 3, 5",
        env_id=ENV,
        delta_azimuth_deg=0.7,
        delta_level_arcsec=70.0,
        kwargs=USUAL,
    ),
    EvaluationTask(
        name="sway-markov-v0",
        what="swaying base, told attitude wrong by 1/1/15 deg (1 sigma), Gauss-Markov IMU errors, matched prior, 600 s",
        source="000 ch. 3-5",
        env_id=ENV,
        delta_azimuth_deg=1.6,
        delta_level_arcsec=70.0,
        kwargs=USUAL | {"imu": "thesis-markov", "duration": 600.0},
    ),
    EvaluationTask(
        name="sway-told-wrong-v0",
        what="swaying base, told the prior of 000 section 2.5.4 and R = (0.1 m/s)^2 while the GPS is 0.01 m/s, 360 s",
        source="000 section 2.5.4",
        env_id=ENV,
        delta_azimuth_deg=0.6,
        delta_level_arcsec=60.0,
        kwargs=USUAL | {"gps": {"vel_std_mps": 0.01, "rate_hz": 10}, "prior": "thesis"},
    ),
    EvaluationTask(
        name="sway-scratch-v0",
        what="swaying base, unknown attitude: 120 s coarse and 360 s fine alignment",
        source="000 fig. 2.6",
        env_id=ENV,
        delta_azimuth_deg=0.7,
        delta_level_arcsec=70.0,
        kwargs=USUAL | {"start": "unknown", "coarse": 120.0, "duration": 480.0},
    ),
    EvaluationTask(
        name="sway-contaminated-v0",
        what="sway-white with a GPS of which 20 % of the fixes have 10 times the variance",
        source="003",
        env_id=ENV,
        delta_azimuth_deg=0.7,
        delta_level_arcsec=70.0,
        kwargs=USUAL | {"gps": {"contamination": 0.2, "contamination_factor": 10.0}},
    ),
    EvaluationTask(
        name="sway-jump-v0",
        what="sway-white with a GPS velocity that is 1 m/s off for 5 s, at a time drawn per run and not told",
        source="docs/mathematics/simulation.md#fixes",
        env_id=ENV,
        delta_azimuth_deg=0.7,
        delta_level_arcsec=70.0,
        kwargs=USUAL | {"gps": {"jump_mps": 1.0, "jump_s": 5.0}},
    ),
    EvaluationTask(
        name="sway-heavytail-v0",
        what="sway-white with a GPS whose errors are Student-t with 3 degrees of freedom",
        source="docs/mathematics/simulation.md#fixes",
        env_id=ENV,
        delta_azimuth_deg=0.7,
        delta_level_arcsec=70.0,
        kwargs=USUAL | {"gps": {"heavy_tail_dof": 3.0}},
    ),
    EvaluationTask(
        name="sway-anyheading-v0",
        what="sway-white with a told heading that may be wrong by anything up to 180 deg",
        source="docs/mathematics/simulation.md#told-priors",
        env_id=ENV,
        delta_azimuth_deg=0.7,
        delta_level_arcsec=70.0,
        kwargs=USUAL | {"any_heading": True},
    ),
)

#: Their worlds; another digest is another task and needs a new version.
DIGESTS = {
    "sway-white-v0": "da7a66a7e428e9a1",
    "sway-markov-v0": "9e11c361f16f2a9b",
    "sway-told-wrong-v0": "70bfe20fab034d16",
    "sway-scratch-v0": "8cab0500775a3324",
    "sway-contaminated-v0": "0441138bca8260c3",
    "sway-jump-v0": "e28052c069259694",
    "sway-heavytail-v0": "967585caaf2efde1",
    "sway-anyheading-v0": "e069acc635ced5fd",
}
