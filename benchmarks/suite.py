"""The default suite: which solvers play which tasks, and with how many runs.

``sway-white-v0`` is for all. Any other task is for ckf, for those that are made for what is wrong there, and for the
plainest filters; near-duplicates stay out (``ukf`` is ckf by default, ``hinf_uif`` is ``hinf_ukf``, a fifth-degree robust
filter is like its third-degree one), and so do particle filters, but for a few runs where they have something to show.
"""

from __future__ import annotations

from typing import NamedTuple

import zoo

from sins_env.evaluation.filling import Evaluation
from sins_env.evaluation.tasks import EvaluationTask, get_task

YARDSTICK = "ckf"


class Portion(NamedTuple):
    """Solvers that play a task with the same runs."""

    task: str
    runs: int
    solvers: tuple[str, ...]

    def evaluations(self, most: int | None = None) -> list[Evaluation]:
        """At ``most`` so many runs; a recording has its windows."""
        task = get_task(self.task)
        runs = min(self.runs, most or self.runs, task.max_runs or self.runs)
        return [Evaluation.of(task, solver, {}, range(runs), None) for solver in self.solvers]


FILTERPY = ("filterpy_kf", "filterpy_ekf", "filterpy_ukf")
PLAIN = ("ckf", "ekf", "inekf", "two_pass")
ADAPTIVE = ("aukf", "aukf_fading", "aukf_window", "augmented_aukf", "asmugsf", "imm_ekf")
HINFINITY = ("hinf_kf", "hinf_ukf", "mixed_hinf_ukf")
ROBUST = ("huber_ckf", "mcc_ckf", "student_t_ckf", "gm_ekf")
HEADING = ("iekf", "ckf5", "ddf2", "gsf_ekf")
COARSE = ("coarse_inertial", "coarse_oba")
AT_REST = ("coarse_analytic1", "coarse_analytic2", "coarse_analytic3")
CAR = ("ckf", "ekf", "imm_ekf", "aukf_window", "asmugsf", "mixed_hinf_ukf", "huber_ckf", "student_t_ckf", "mpf_ekf")

SUITE = (
    Portion("sway-white-v0", 100, tuple(name for name in zoo.names() if name not in FILTERPY)),
    Portion("sway-white-v0", 4, FILTERPY),  # one run at a time
    Portion("sway-told-wrong-v0", 100, (*PLAIN, *ADAPTIVE, *HINFINITY, *ROBUST, "mpf_ekf")),
    Portion("sway-anyheading-v0", 100, (*PLAIN, *HEADING, "imm_ekf", "hinf_ukf")),
    Portion("sway-anyheading-v0", 10, ("pf", "cgpf")),
    Portion("sway-jump-v0", 100, (*PLAIN, *ROBUST, "imm_ekf", "aukf", "aukf_window", "hinf_ukf", "asmugsf")),
    Portion("sway-heavytail-v0", 100, (*PLAIN, *ROBUST, "imm_ekf", "aukf_window", "hinf_ukf")),
    Portion("sway-heavytail-v0", 20, ("gpf", "cgpf")),
    Portion("sway-contaminated-v0", 100, (*PLAIN, *ROBUST, "imm_ekf")),
    Portion("sway-markov-v0", 40, (*PLAIN, "imm_ekf", "aukf_window", "hinf_ukf", "student_t_ckf")),
    Portion("sway-scratch-v0", 100, (*PLAIN, "gsf_ekf", *COARSE)),
    Portion("vehicle-v0", 30, (*CAR, *COARSE, *AT_REST)),
    Portion("static8-v0", 40, ("ckf", "ekf", "inekf", "imm_ekf", "aukf_window", "hinf_ukf", *COARSE, *AT_REST)),
    *(
        Portion(f"flight-hotstart{spread}-v0", 100, ("ckf", "ekf", *HEADING, "inekf", "imm_ekf"))
        for spread in (30, 60, 90)
    ),
    *(
        Portion(f"flight-lu-{noise}-v0", 40, ("ckf", "ekf", "inekf", *ROBUST, "imm_ekf", "aukf_window"))
        for noise in ("gauss", "mixture")
    ),
    Portion(
        "flight-zhao2010-v0",
        40,
        ("ckf", "ekf", "inekf", "aukf", "aukf_fading", "aukf_window", "imm_ekf", "hinf_ukf", "student_t_ckf"),
    ),
    *(
        Portion(f"flight-sun2012{kind}-v0", 40, ("ckf", "ekf", "inekf", "gsf_ekf"))
        for kind in ("", "-fixed", "-physical")
    ),
    Portion("rlg-car-v0", 7, (*CAR, "mpf", *COARSE, *AT_REST)),
    Portion("navgrade-car-v0", 1, ("ckf", "ekf", "inekf", "imm_ekf", "student_t_ckf")),
)

#: Where a step's cost is measured beside ckf's: for ten states, and for fifteen.
COSTED = ("sway-white-v0", "flight-hotstart60-v0")


def tasks() -> list[EvaluationTask]:
    """Those of the suite, in its order; a recording that is not there is left out."""
    found = [get_task(name) for name in dict.fromkeys(portion.task for portion in SUITE)]
    return [task for task in found if not task.windows or _there(task)]


def _there(task: EvaluationTask) -> bool:
    try:
        task.make(1).close()
    except FileNotFoundError:
        return False
    return True
