"""Runs that the checked estimators are told: each is recorded once and played again for every check."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np

from sins_env import types
from sins_env.arrays import Array, Obs

RUNS, COARSE_S, SEED = 3, 6.0, 20110607
ALIGNMENT = {"id": "SINS/AlignSway-v0", "duration": 12.0, "start": "told"}
UNKNOWN_START = {**ALIGNMENT, "start": "unknown", "coarse": COARSE_S}
NAVIGATION = {"id": "SINS/NavFlight-v0", "duration": 5.0, "profile": "lu-gauss"}


class Playback:
    """Recorded runs in place of an environment; every action is followed by the recorded observation."""

    def __init__(self, task: types.Task, observations: Sequence[Obs]) -> None:
        self.task, self.observations, self.unwrapped = task, observations, self
        self.num_runs = len(observations[0]["t"])
        self._k = 0

    def step(self, action: Array) -> tuple[Obs, None, None, None, dict[str, Any]]:
        """Return the next observation; at the end this is the last one once more."""
        self._k = min(self._k + 1, len(self.observations) - 1)
        return self.observations[self._k], None, None, None, {}


class Told:
    """A few short runs of an environment with these settings, which are the same for every check."""

    def __init__(self, **settings: Any) -> None:
        env: Any = gymnasium.make_vec(num_envs=RUNS, **settings)
        obs, info = env.reset(seed=SEED)
        self.task: types.Task = env.unwrapped.task
        start = info["start"]
        action = start["q_nb"]
        if self.task.navigate:
            action = np.concatenate([action, start["vel"], start["pos"]], axis=1)
        self.observations: list[Obs] = []
        for _ in range(self.task.num_epochs):
            self.observations.append(obs)
            obs = env.step(action)[0]
        env.close()

    def play(self, rows: slice = slice(None)) -> Playback:
        """Return these runs as copies, which an estimator may change."""
        start = self.task.start and types.NavState(*(part[rows].copy() for part in self.task.start))
        copies = [{name: value[rows].copy() for name, value in obs.items()} for obs in self.observations]
        return Playback(replace(self.task, start=start), copies)

    def run(self, row: int) -> Playback:
        """Return one run as a copy."""
        return self.play(slice(row, row + 1))
