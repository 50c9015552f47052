"""The default suite: which solvers play which tasks, and with how many runs. The most informative runs come first.

All solvers play ``sway-white-v0``. Other tasks are for ckf, for the plainest filters, and for those made for what is wrong
there. Near-duplicates are left out: ``ukf`` is ckf by default, ``hinf_uif`` is ``hinf_ukf``, and a fifth-degree robust filter
is like its third-degree one. Particle filters take seconds to minutes a run and play only a few.
"""

from __future__ import annotations

from typing import NamedTuple

import zoo

from sins_env.evaluation.store.filling import Evaluation
from sins_env.evaluation.tasks.catalogue import TASKS, get_task
from sins_env.evaluation.tasks.task import EvaluationTask

YARDSTICK = "ckf"


class Portion(NamedTuple):
    """A task, and the solvers that play it with the same runs."""

    task: str
    runs: int
    solvers: tuple[str, ...]

    def evaluations(self, most: int | None = None) -> list[Evaluation]:
        """Return what is to be run, with ``most`` runs at most; a recording has no more than its windows."""
        task = get_task(self.task)
        runs = min(self.runs, most or self.runs, task.max_runs or self.runs)
        return [Evaluation.of(task, solver, {}, range(runs), None) for solver in self.solvers]


GAUSSIAN = ("ekf", "ckf", "ckf5", "ddf1", "ddf2")
FILTERPY = ("filterpy_kf", "filterpy_ekf", "filterpy_ukf")
ADAPTIVE = ("aukf", "aukf_fading", "aukf_window", "augmented_aukf", "asmugsf", "imm_ekf")
ROBUST = ("student_t_ckf", "huber_ckf", "mcc_ckf", "gm_ekf")
HEADING = ("inekf", "iekf", "gsf_ekf")
COARSE = ("coarse_inertial", "coarse_oba")
AT_REST = ("coarse_analytic1", "coarse_analytic2", "coarse_analytic3")
FIRST = (*GAUSSIAN, *ADAPTIVE[:-1], "gm_ekf", "gsf_ekf", "gpf", "cgpf", *COARSE, *AT_REST)
OTHERS = tuple(name for name in zoo.names() if name not in {*FIRST, *FILTERPY})

SUITE = (
    Portion("sway-white-v0", 100, FIRST),
    Portion("flight-hotstart60-v0", 60, ("ckf", "ekf", *HEADING)),
    Portion("sway-told-wrong-v0", 40, ("ckf", "ekf", "two_pass", *ADAPTIVE, "hinf_ukf", "mixed_hinf_ukf")),
    Portion("sway-anyheading-v0", 40, ("ckf", "ekf", "two_pass", *HEADING, "ckf5")),
    Portion("sway-jump-v0", 40, ("ckf", "ekf", *ROBUST, "imm_ekf", "aukf_window")),
    Portion("sway-heavytail-v0", 40, ("ckf", *ROBUST, "imm_ekf")),
    Portion("flight-lu-mixture-v0", 40, ("ckf", "ekf", "gm_ekf", "imm_ekf", "student_t_ckf")),
    Portion("sway-contaminated-v0", 40, ("ckf", "gm_ekf", "imm_ekf", "student_t_ckf")),
    Portion("rlg-car-v0", 7, ("ckf", "imm_ekf", "huber_ckf", "mixed_hinf_ukf", "mpf", *COARSE, *AT_REST)),
    Portion("navgrade-car-v0", 1, ("ckf", "ekf", "inekf", "student_t_ckf")),
    Portion("vehicle-v0", 30, ("ckf", "asmugsf", "mixed_hinf_ukf", "student_t_ckf", *COARSE)),
    Portion("sway-scratch-v0", 40, ("ckf", "gsf_ekf", *COARSE)),
    Portion("static8-v0", 40, ("ckf", "imm_ekf", *COARSE, *AT_REST)),
    Portion("flight-zhao2010-v0", 40, ("ckf", "ekf", "aukf_window", "imm_ekf", "student_t_ckf")),
    Portion("flight-hotstart90-v0", 40, ("ckf", "ekf", "inekf", "gsf_ekf")),
    Portion("flight-hotstart30-v0", 40, ("ckf", "ekf", "inekf", "gsf_ekf")),
    Portion("sway-markov-v0", 40, ("ckf", "ekf", "two_pass", "imm_ekf")),
    Portion("flight-sun2012-v0", 40, ("ckf", "ekf", "inekf")),
    Portion("flight-lu-gauss-v0", 40, ("ckf", "ekf", "gm_ekf", "imm_ekf")),
    Portion("flight-sun2012-physical-v0", 40, ("ckf", "ekf", "inekf")),
    Portion("flight-sun2012-fixed-v0", 40, ("ckf", "ekf", "inekf")),
    Portion("sway-white-v0", 100, OTHERS),
    Portion("sway-white-v0", 2, FILTERPY),  # one run at a time, for their cost
    Portion("sway-heavytail-v0", 10, ("gpf", "cgpf")),
    Portion("sway-anyheading-v0", 10, ("pf", "cgpf")),
    Portion("sway-told-wrong-v0", 40, ("hinf_kf", "mpf_ekf", "student_t_ckf", "gm_ekf", "inekf")),
    Portion("sway-anyheading-v0", 40, ("ddf2", "imm_ekf", "hinf_ukf")),
    Portion("flight-lu-mixture-v0", 40, ("huber_ckf", "mcc_ckf", "inekf", "aukf_window")),
    Portion("vehicle-v0", 30, ("ekf", "imm_ekf", "aukf_window", "huber_ckf", "mpf_ekf", *AT_REST)),
)

#: Tasks on which the cost of a step is measured beside that of ckf: one with ten states, one with fifteen.
COSTED = ("sway-white-v0", "flight-hotstart60-v0")


def tasks() -> list[EvaluationTask]:
    """Return the tasks of the suite in the catalogue's order; those of a missing recording are left out."""
    played = {portion.task for portion in SUITE}
    found = [task for name, task in TASKS.items() if name in played]
    return [task for task in found if not task.windows or _there(task)]


def _there(task: EvaluationTask) -> bool:
    try:
        task.make(1).close()
    except FileNotFoundError:
        return False
    return True
