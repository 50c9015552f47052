"""The course of a batch of episodes: observations out, actions in, errors and rewards.

The single and the vector environment both wrap it. See docs/tasks_and_scores.md#environment-contract.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from sins_env import checks, earth
from sins_env.arrays import Array, Mask, Obs, Rngs
from sins_env.envs.reward import failed_epochs, score_attitude, score_navigation
from sins_env.types import NavState, Task
from sins_env.worlds.world import World


class Episode:
    """A batch of episodes of K steps. Observation k covers (t_{k-1}, t_k], and step k scores the action at t_k.

    Without a reference errors and rewards are zero, and ``info["scored"]`` is False. A failed epoch then shows in
    ``info["failed"]`` alone.

    Raises:
        ValueError: ``reveal_truth`` in a world without a reference, or no bool.
    """

    def __init__(self, world: World, reveal_truth: bool) -> None:
        checks.flag("reveal_truth", reveal_truth)
        if reveal_truth and not world.scored:
            raise ValueError("reveal_truth = True; allowed: False, this recording has no reference")
        self.world, self.reveal_truth = world, reveal_truth
        self.task: Task = world.task
        self.k, self.started = 0, False

    def reset(self, rngs: Rngs, options: dict[str, Any] | None, squeeze: bool = False) -> tuple[Obs, dict[str, Any]]:
        """Begin one run per generator, and return observation 1 and the info with the start.

        ``squeeze`` leaves out the run axis of the start in the public task, for the single environment.

        Raises:
            ValueError: a reset option that the world does not have, or no dict of them.
        """
        if not isinstance(options, dict | None):
            raise checks.refused("options", options, "None, or a dict of reset options")
        truth, told = self.world.reset(rngs, options or {})
        runs = len(rngs)
        known = told is not None
        if told is None:
            pos = np.broadcast_to(self.world.task.site.pos, (runs, 3)).copy()
            start = NavState(np.tile([1.0, 0.0, 0.0, 0.0], (runs, 1)), np.zeros((runs, 3)), pos)
        else:
            start = told
        public = NavState(*(part[0].copy() if squeeze else part.copy() for part in start)) if known else None
        self.task = dataclasses.replace(self.world.task, start=public)
        self.k, self.started = 1, True
        obs = self._observe()
        info: dict[str, Any] = {"start": {**start._asdict(), "known": np.full(runs, known)}}
        if self.reveal_truth:
            info["truth"] = {name: part.copy() for name, part in truth._asdict().items()}
        return obs, info

    def step(self, action: Array) -> tuple[Obs, Array, bool, dict[str, Any]]:
        """Score the actions (runs, 4 or 10) at t_k.

        Returns the next observation, rewards (runs,), whether the episode is over, and the info.

        Raises:
            RuntimeError: a step before the reset or after the end.
        """
        if not self.started:
            raise RuntimeError("step() before reset(): reset the environment first")
        if self.k > self.task.num_epochs:
            raise RuntimeError("step() after the end of the episode: reset the environment first")
        action = np.asarray(action, dtype=float)
        errors, reward, failed = self._score(action)
        info: dict[str, Any] = {"errors": errors, "failed": failed}
        if not self.world.scored:
            info["scored"] = np.zeros(len(failed), dtype=bool)
        if self.reveal_truth:
            info["truth"] = {name: part.copy() for name, part in self._truth._asdict().items()}
        self.k += 1
        over = self.k > self.task.num_epochs
        return (self._terminal() if over else self._observe()), reward, over, info

    def _score(self, action: Array) -> tuple[dict[str, Array], Array, Mask]:
        if not self.world.scored:
            kinds = ("phi", "vel", "pos") if self.task.navigate else ("phi",)
            nothing = {kind: np.zeros((len(action), 3)) for kind in kinds}
            return nothing, np.zeros(len(action)), failed_epochs(action)
        if self.task.navigate:
            return score_navigation(action, self._truth, earth.get(self.task.site.earth))
        phi, reward, failed = score_attitude(action, self._truth.q_nb)
        return {"phi": phi}, reward, failed

    def _observe(self) -> Obs:
        data = self.world.epoch(self.k)
        self._truth = data.truth
        runs = len(data.truth.vel)
        measured = {name: value.copy() for name, value in data.measured.items()}
        return {"t": np.full((runs, 1), self.k * self.task.epoch_s), **measured}

    def _terminal(self) -> Obs:
        """Return the observation after t_K, which is empty: zero increments and no fix."""
        data = self.world.epoch(self.task.num_epochs)
        nothing = {name: np.zeros_like(value) for name, value in data.measured.items()}
        return {"t": np.full((len(data.truth.vel), 1), self.task.num_epochs * self.task.epoch_s), **nothing}
