"""The environment ``SINS/TuneNoise-v0``, single and vector: actions scale the noise that a filter assumes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from sins_env import checks
from sins_env.arrays import Array, Mask
from sins_env.envs.base import check_seeds, seeded
from sins_env.learning.tuning import MOST_SEEN, Seen, TuneNoiseSettings, Tuning

__all__ = ["TuneNoiseEnv", "TuneNoiseSettings", "TuneNoiseVectorEnv"]


def _spaces(core: Tuning) -> tuple[Any, Any]:
    """Return the spaces of observation and action."""
    return (
        spaces.Box(-MOST_SEEN, MOST_SEEN, (core.size,), np.float32),
        spaces.Box(-1.0, 1.0, (core.actions,), np.float32),
    )


def _make(settings: dict[str, Any], rows: int) -> Tuning:
    return Tuning(checks.build(TuneNoiseSettings, settings, TuneNoiseEnv.env_id), rows)


def _no_options(options: dict[str, Any] | None) -> None:
    if options:
        raise checks.refused("reset options", options, "none in this environment")


class TuneNoiseEnv(gymnasium.Env[Seen, Array]):
    """A filter of the zoo whose assumed noise is tuned: Q and R are scaled for the next interval, innovations are seen.

    The keyword arguments are the fields of :class:`TuneNoiseSettings`. The seed of a run can be none of any suite's.

    Raises:
        ValueError: an unknown keyword, or a value that is not allowed.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}  # type: ignore[misc]
    env_id: ClassVar[str] = "SINS/TuneNoise-v0"
    settings: ClassVar[type] = TuneNoiseSettings

    def __init__(self, **settings: Any) -> None:
        self.core = _make(settings, 1)
        self.observation_space, self.action_space = _spaces(self.core)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Seen, dict[str, Any]]:
        """Begin a run, and return the first observation.

        Raises:
            ValueError: a seed that is no whole number from 0 on, or any option.
        """
        (checked,) = check_seeds(seed, 1)
        _no_options(options)
        super().reset(seed=checked)
        return self.core.reset([self.np_random])[0], {}

    def step(self, action: Any) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Run an interval with an action; return observation, reward, two flags of the end, and the info.

        Raises:
            ValueError: an action of another shape, or that is not finite.
            RuntimeError: a step before the reset or after the end.
        """
        obs, reward, over, info = self.core.step(np.asarray(action)[None])
        return obs[0], float(reward[0]), False, over, {name: value[0] for name, value in info.items()}

    def close(self) -> None:
        """Close the world."""
        self.core.env.close()


class TuneNoiseVectorEnv(VectorEnv[Seen, Array, NDArray[Any]]):
    """Runs of such filters in lockstep, computed as one batch. Row i has the run of the single environment with its seed."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # type: ignore[misc]
    single: ClassVar[type[TuneNoiseEnv]] = TuneNoiseEnv

    def __init__(self, num_envs: int = 1, **settings: Any) -> None:
        self.num_envs = checks.whole("num_envs", num_envs, "at least 1", least=1)
        self.core = _make(settings, self.num_envs)
        self.single_observation_space, self.single_action_space = _spaces(self.core)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._rngs: list[np.random.Generator] | None = None
        self._over = False

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Begin a run in every row. A whole number as seed is that of row 0, and the other rows follow one by one.

        Raises:
            ValueError: seeds of another number, or any option.
        """
        seeds = check_seeds(seed, self.num_envs)
        _no_options(options)
        self._rngs = seeded(seeds, self._rngs)
        self._over = False
        return self.core.reset(self._rngs), {}

    def step(self, actions: Any) -> tuple[Seen, Array, Mask, Mask, dict[str, Any]]:
        """Run an interval in every row; the step after the end begins the next runs.

        Raises:
            ValueError: actions of another shape, or that are not finite.
            RuntimeError: a step before the reset.
        """
        every = np.ones(self.num_envs, dtype=bool)
        if self._over:
            obs, info = self.reset()
            return obs, np.zeros(self.num_envs), ~every, ~every, info
        obs, reward, self._over, info = self.core.step(actions)
        return obs, reward, ~every, every & self._over, info | {f"_{name}": every.copy() for name in info}

    def close_extras(self, **kwargs: Any) -> None:
        """Close the world."""
        self.core.env.close()
