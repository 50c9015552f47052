"""Criteria by which runs of a task are scored: times, thresholds and limits. docs/tasks_and_scores.md#alignment-criterion."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import types
from sins_env.arrays import Array
from sins_env.envs.reward import WORST_PHI, WORST_POS, WORST_VEL
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.states import ERRORS, Block, answered

AXES = ("E", "N", "U")
#: Layout of the errors that are scored in navigation; alignment has ``phi`` alone. The last are errors of Euler angles.
SCORED = answered(navigate=True).plus(Block("euler", 3, "rad"))
PHI = SCORED["phi"]
AZIMUTH = PHI.start + AXES.index("U")  #: index of the azimuth error among the components
#: Names of the components of SCORED.
COMPONENTS = (
    "phi_e", "phi_n", "phi_u", "vel_e", "vel_n", "vel_u", "pos_e", "pos_n", "pos_u", "heading", "pitch", "roll",
)  # fmt: skip
COMPONENT_UNITS = tuple(block.unit for block in SCORED.blocks for _ in range(block.size))
WORST = SCORED.values({"phi": WORST_PHI, "dv": WORST_VEL, "dp": WORST_POS, "euler": np.pi})
NEES_AT = (0.25, 0.5, 0.75, 1.0)  #: times at which the NEES is taken, as parts of the fine phase
STEADY_LEAST_S, STEADY_PART = 60.0, 0.2  #: least length of the steady state, and its part of the duration
DIVERGED_SIGMAS = 10.0  #: limit of divergence over the standard deviation of the told start
DIVERGED_UNKNOWN = np.radians([10.0, 10.0, 90.0])  #: limits E, N, U after an unknown start, rad
MAX_HISTORY = 21_600  #: most samples of a history, which are 6 h at 1 Hz; longer episodes have a longer interval


@dataclass(frozen=True)
class Criteria:
    """Times, thresholds and limits by which a run is scored. Times are in s from switch-on."""

    epoch_s: float
    num_epochs: int
    coarse_epochs: int
    delta: Array  #: (3,) thresholds of convergence, rad
    limit: Array  #: limits of divergence, (3,) rad, or (9,) rad, m/s and m
    hold_s: float  #: least time that an error must stay within its threshold until the end
    known_start: bool = True  #: whether the start is told
    scored: bool = True  #: whether errors are scored; a recording without a reference has none
    lost_heading: bool = False  #: whether the start may have any heading; azimuth then has a limit in steady state only
    navigates: bool = False
    span_from: int = 1  #: first epoch over which the errors of a navigation task are averaged
    final_limit: float = math.inf  #: azimuth error at T above which a run has failed, rad

    @classmethod
    def of(cls, task: EvaluationTask, public: types.Task, scored: bool = True) -> Criteria:
        """Make the criteria of a task, with the times and the prior of its environment's public task."""
        known = public.start is not None
        limited = ERRORS.places(answered(public.navigate))
        limit = DIVERGED_SIGMAS * np.sqrt(np.diagonal(public.prior.P0))[limited]
        if not known:
            limit[PHI] = DIVERGED_UNKNOWN
        lost_heading = bool(limit[AZIMUTH] >= math.pi)
        if lost_heading:
            limit[AZIMUTH] = DIVERGED_UNKNOWN[AZIMUTH]
        return cls(
            epoch_s=public.epoch_s,
            num_epochs=public.num_epochs,
            coarse_epochs=round(public.coarse_s / public.epoch_s),
            delta=task.delta,
            limit=limit,
            hold_s=task.hold_s,
            known_start=known,
            scored=scored,
            lost_heading=lost_heading,
            navigates=public.navigate,
            span_from=max(round(task.score_from_s / public.epoch_s), round(public.coarse_s / public.epoch_s)) + 1,
            final_limit=math.inf if task.fail_azimuth_deg is None else math.radians(task.fail_azimuth_deg),
        )

    @property
    def limited_late(self) -> bool:
        """Whether all limits hold in the steady state only: the attitude is found while errors are scored."""
        return not self.known_start and self.coarse_epochs == 0

    @property
    def components(self) -> int:
        """Number of the components of an error that are scored, the first ones of COMPONENTS."""
        return (SCORED if self.navigates else answered(navigate=False)).size

    @property
    def worst(self) -> Array:
        """Errors (components,) of a failed epoch, or of an epoch after the end of a run that raised or was lost."""
        return WORST[: self.components]

    @property
    def span(self) -> NDArray[np.bool_]:
        """Mask (S,) of the samples of the history that belong to the scored span of navigation."""
        sampled: NDArray[np.bool_] = self.history_t >= (self.span_from - 0.5) * self.epoch_s
        return sampled

    @property
    def duration_s(self) -> float:
        """Duration of a run, s."""
        return self.num_epochs * self.epoch_s

    @property
    def coarse_s(self) -> float:
        """Duration of the coarse phase, s."""
        return self.coarse_epochs * self.epoch_s

    @property
    def horizon_s(self) -> float:
        """Latest time of convergence that can be observed, s from the start of fine alignment."""
        return max(self.duration_s - self.coarse_s - self.hold_s, 0.0)

    @property
    def steady_from(self) -> int:
        """First epoch of the steady state, which is the last max(60 s, 20 %), and at most the fine phase."""
        length = max(STEADY_LEAST_S, STEADY_PART * self.duration_s)
        return max(self.num_epochs - round(length / self.epoch_s), self.coarse_epochs) + 1

    @property
    def history_stride(self) -> int:
        """Number of epochs from one sample of the history to the next."""
        second = max(round(1.0 / self.epoch_s), 1)
        return second * max(math.ceil(self.num_epochs / second / MAX_HISTORY), 1)

    @property
    def history_t(self) -> NDArray[np.floating[Any]]:
        """Times of the history, s."""
        return np.arange(self.history_stride, self.num_epochs + 1, self.history_stride) * self.epoch_s

    @property
    def nees_epochs(self) -> tuple[int, ...]:
        """Epochs at which the NEES is taken; none after an unknown start, because no prior describes it."""
        fine = self.num_epochs - self.coarse_epochs
        return tuple(self.coarse_epochs + max(round(part * fine), 1) for part in NEES_AT) if self.known_start else ()
