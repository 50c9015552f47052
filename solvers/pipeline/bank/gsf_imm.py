"""The recommended solver: a bank of inertial solutions over the heading, each with models of the noises it may meet.

Idea: every assumption of a task that may fail is a hypothesis with a small weight beside the told one. Headings are cut into
slices. Each has an INS of its own in closed loop, so that every tangent is taken at zero of the right-invariant errors. Models of
a smaller or larger noise of the IMU, and one with an offset of the fixes, interact inside a slice. The noise of a fix may be a
hundredth or a hundred times the told one, with a memory of some fixes. Slices that agree with the best one are merged into it, and
soon one is left. An unknown attitude starts with all headings at the first fix, at rest or in motion, without a coarse phase.

Source: Sorenson & Alspach (1971), doi:10.1016/0005-1098(71)90097-5 (Gaussian sums); Blom & Bar-Shalom (1988),
doi:10.1109/9.1299 (interacting models); Barrau & Bonnabel (2017), doi:10.1109/TAC.2016.2594085 (coordinates);
docs/mathematics/filters.md#bank-of-inertial-solutions.
Departures: the factors of the IMU's noise were chosen with a task in view that tells an angular random walk six times too small.
"""

from __future__ import annotations

import inspect
from typing import Any

from sins_env.arrays import Array
from sins_env.checks import build
from sins_env.types import Observation, Rng, Task
from solvers.filters.brief import changed
from solvers.pipeline.bank.episode import Episode
from solvers.pipeline.bank.settings import BankSettings
from solvers.registry import register
from solvers.types import Health


@register("gsf_imm")
class GSFIMM:
    """The recommended solver for alignment and navigation: a bank over the heading, the noises and the start. After Sorenson &
    Alspach (1971), Blom & Bar-Shalom (1988), and Barrau & Bonnabel (2017).

    It needs no setting. ``spacing_deg`` is the largest width of a slice of headings. ``imu_factors`` are pairs of factors of the
    told variances of gyros and accelerometers, of which the first is the likeliest by far. ``fix_factors`` are factors of the
    told variance of a fix, with 1 among them. ``fix_offsets``: whether the velocity of fixes may be off by a constant for some
    seconds. ``stillness``: whether a base that is seen to stand still has no velocity and no rate, which needs sensors that are
    as quiet as told. A base that is seen to be parked but rocked then has no lasting velocity. The coarse phase of a task is not
    used: its epochs align from the first fix on. With ``coarse``, a method of the coarse phase, its epochs are filtered twice, at
    less cost, and nothing is known before its end. ``bias_walk``: whether the biases wander as fast as told Gauss-Markov biases
    do; otherwise they are constants.

    Raises:
        ValueError: an unknown setting, or a value that is not allowed.
    """

    __signature__ = inspect.Signature(
        [p.replace(kind=p.KEYWORD_ONLY) for p in inspect.signature(BankSettings).parameters.values()]
    )
    batched = True

    def __init__(self, **settings: Any) -> None:
        self.settings = build(BankSettings, settings, "gsf_imm")
        self._episode: Episode | None = None

    def __repr__(self) -> str:
        return f"GSFIMM({', '.join(changed(BankSettings, vars(self.settings)))})"

    @property
    def episode(self) -> Episode:
        """The episode since the last ``reset``.

        Raises:
            RuntimeError: there has been none.
        """
        if self._episode is None:
            raise RuntimeError(f"{self!r} has no task yet; call reset(task, rng) first")
        return self._episode

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        """Begin an episode of ``task``; nothing is drawn from ``rng``."""
        self._episode = Episode(task, num_runs, self.settings)

    def step(self, obs: Observation) -> Array:
        """Return q_nb (..., 4) at the end of the epoch; in navigation with velocity and position, (..., 10)."""
        return self.episode.step(obs)

    def covariance(self) -> Array:
        """Return the covariance of the corrected errors, (..., 3, 3) or (..., 9, 9); before the first fix that of the start."""
        return self.episode.covariance()

    def health(self) -> Health:
        """Return which runs were lost, and when; their answer stays the last good one."""
        return self.episode.health()

    @property
    def labels(self) -> dict[str, list[str]]:
        """What the entries of the probabilities of models and regimes in ``diagnostics()`` are."""
        models = [f"gyros x {gyro:g}, accelerometers x {accel:g}" for gyro, accel in self.settings.imu_factors]
        offset = ["offset of the fixes"] * self.settings.fix_offsets
        regimes = [f"fixes x {factor:g}" for factor in self.settings.fix_factors]
        return {"model_probabilities": models + offset, "regime_probabilities": regimes}

    def diagnostics(self) -> dict[str, Array]:
        """Return the weights of slices, models and regimes by name, with the batch axes in front."""
        return self.episode.diagnostics()
