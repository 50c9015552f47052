"""What all wrappers share: a translation between an agent and an environment, which may be single or vector."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from typing import Any, ClassVar, TypeVar

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import VectorEnv, VectorWrapper
from gymnasium.vector.utils import batch_space

from sins_env.arrays import Array, Obs
from sins_env.envs.base import EpisodeEnv, EpisodeVectorEnv

E = TypeVar("E", gymnasium.Env[Any, Any], VectorEnv[Any, Any, Any])
Info = dict[str, Any]


class Translation:
    """A translation, which changes nothing until a subclass says what. Arrays have a run axis in the vector form.

    ``rank`` is its place from the inside out; two of one rank, or another order, are refused.
    """

    rank: ClassVar[int]

    def spaces(self, observed: spaces.Dict, action: spaces.Box) -> tuple[spaces.Dict, spaces.Box]:
        """Return the spaces of one run that the agent sees, from those of the environment inside."""
        return observed, action

    def begin(self, env: EpisodeEnv | EpisodeVectorEnv, obs: Obs, info: Info) -> None:
        """Begin an episode of ``env``, whose task is that of this episode."""

    def observed(self, obs: Obs) -> Obs:
        """Return what the agent sees of an observation."""
        return obs

    def told(self, info: Info) -> Info:
        """Return what the agent sees of an info."""
        return info

    def answer(self, action: Array) -> Array:
        """Return the action of the environment for that of the agent."""
        return action


class Translated(gymnasium.Wrapper[Any, Any, Any, Any], RecordConstructorArgs):
    """A single environment behind a translation."""

    def __init__(self, env: gymnasium.Env[Any, Any], translation: Translation) -> None:
        RecordConstructorArgs.__init__(self, translation=translation)
        super().__init__(env)
        self.translation = translation
        self.observation_space, self.action_space = translation.spaces(env.observation_space, env.action_space)  # type: ignore[arg-type]

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Obs, Info]:
        """Begin an episode."""
        obs, info = self.env.reset(seed=seed, options=options)
        self.translation.begin(own_env(self.env), obs, info)
        return self.translation.observed(obs), self.translation.told(info)

    def step(self, action: Any) -> tuple[Obs, Any, bool, bool, Info]:
        """Answer an epoch.

        Raises:
            ValueError: an action of another shape, or one that the translation refuses.
        """
        inner = self.translation.answer(_of_shape(action, self.action_space))
        obs, reward, terminated, truncated, info = self.env.step(inner)
        return self.translation.observed(obs), reward, terminated, truncated, self.translation.told(info)


class TranslatedVector(VectorWrapper[Any, Any, Any, Any, Any]):
    """A vector environment behind a translation. All rows end together, and the step after the end begins the next episode."""

    def __init__(self, env: VectorEnv[Any, Any, Any], translation: Translation) -> None:
        super().__init__(env)
        self.translation, self._over = translation, False
        single = translation.spaces(env.single_observation_space, env.single_action_space)  # type: ignore[arg-type]
        self.single_observation_space, self.single_action_space = single
        self.observation_space, self.action_space = (batch_space(space, env.num_envs) for space in single)

    def reset(self, *, seed: Any = None, options: dict[str, Any] | None = None) -> tuple[Obs, Info]:
        """Begin an episode in every row."""
        self._over = False
        return self._begin(*self.env.reset(seed=seed, options=options))

    def step(self, actions: Any) -> tuple[Obs, Any, Any, Any, Info]:
        """Answer an epoch in every row.

        Raises:
            ValueError: actions of another shape, or ones that the translation refuses.
        """
        if self._over:
            inner = np.zeros(self.env.action_space.shape or ())
        else:
            inner = self.translation.answer(_of_shape(actions, self.action_space))
        obs, reward, terminated, truncated, info = self.env.step(inner)
        if self._over:
            obs, info = self._begin(obs, info)
        else:
            obs, info = self.translation.observed(obs), self.translation.told(info)
        self._over = bool(np.any(truncated))
        return obs, reward, terminated, truncated, info

    def _begin(self, obs: Obs, info: Info) -> tuple[Obs, Info]:
        self.translation.begin(own_env(self.env), obs, info)
        return self.translation.observed(obs), self.translation.told(info)


def _of_shape(action: Any, space: spaces.Space[Any]) -> Array:
    """Return an action as an array, which must have the shape of its space: nothing is stretched to it."""
    array = np.asarray(action)
    if array.shape != space.shape:
        raise ValueError(f"action of shape {array.shape}; allowed: {space.shape}")
    return array


def own_env(env: Any) -> Any:
    """Return the environment of this package inside wrappers.

    Raises:
        ValueError: it is another one.
    """
    found = env.unwrapped
    if not isinstance(found, (EpisodeEnv, EpisodeVectorEnv)):
        raise ValueError(f"environment {found!r}; allowed: one of SINS/, whose action is an estimate")
    return found


def _translations(env: Any) -> Iterator[Translation]:
    """Yield the translations of an environment from the outside in."""
    while env is not env.unwrapped:
        if isinstance(env, (Translated, TranslatedVector)):
            yield env.translation
        env = env.env


def inside(env: Any, kind: type[Translation]) -> bool:
    """Return whether an environment has a translation of this kind."""
    return any(isinstance(one, kind) for one in _translations(env))


def translated(env: E, translation: Translation) -> E:
    """Return an environment behind a translation, in the form that it has.

    Raises:
        ValueError: another environment, or wrappers in another order.
    """
    own_env(env)
    for one in _translations(env):
        if one.rank >= translation.rank:
            names = type(translation).__name__, type(one).__name__
            raise ValueError(
                f"{names[0]} around {names[1]}; allowed, from the inside out and each once: corrections, north_east_down, scaled"
            )
    if isinstance(env, VectorEnv):
        return TranslatedVector(env, translation)
    return Translated(env, translation)


def world_of(env: Any) -> Any:
    """Return a copy of the world of an environment, which can be played without disturbing it."""
    return copy.deepcopy(own_env(env).episode.world)
