"""The Gymnasium interface of all environments, single and vector.

Both forms wrap the same :class:`Episode`, so that their numbers are the same to the last bit.
See docs/tasks_and_scores.md#environment-contract.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from sins_env import checks
from sins_env.arrays import Array, Mask, Obs
from sins_env.envs.episode import Episode
from sins_env.envs.rendering import Renderer
from sins_env.envs.spaces import action_space, observation_space
from sins_env.types import Task
from sins_env.worlds.world import World

RENDER_MODES = ("rgb_array",)


def _check_render_mode(render_mode: str | None) -> str | None:
    return None if render_mode is None else checks.choice("render_mode", render_mode, RENDER_MODES)


def check_seeds(seed: Any, rows: int) -> list[int | None]:
    """Return one seed for each row. A whole number is that of row 0, and the other rows follow one by one."""

    def fits(value: Any) -> bool:
        return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and bool(value >= 0)

    if seed is None or fits(seed):
        return [None if seed is None else int(seed) + i for i in range(rows)]
    seeds = checks.items(seed)
    if seeds is None or not all(s is None or fits(s) for s in seeds):
        raise checks.refused("seed", seed, f"None, a whole number from 0 on, or a list of {rows} of them")
    if len(seeds) != rows:
        raise ValueError(f"{len(seeds)} seeds; allowed: one int, or {rows} seeds, one per row")
    return [None if s is None else int(s) for s in seeds]


def seeded(seeds: Sequence[int | None], old: Sequence[np.random.Generator] | None) -> list[np.random.Generator]:
    """Return a generator for each row: a new one for a seed, and that of the row before, if there is one, for None."""
    before: Sequence[Any] = old or [None] * len(seeds)
    return [
        rng if s is None and rng is not None else seeding.np_random(s)[0] for s, rng in zip(seeds, before, strict=True)
    ]


def _check_action(action: Any, space: gymnasium.Space[Any], navigate: bool) -> Array:
    """Return the action as float64, with the shape of the space."""
    try:
        array = np.asarray(action)
        if array.dtype.kind not in "biufO":
            raise TypeError("no real numbers")
        if array.dtype != np.float64:
            with np.errstate(over="ignore"):  # what is too large for float64 is inf, and a failed epoch
                array = array.astype(np.float64)
    except Exception as error:  # objects of others may raise anything
        what = "complex numbers, text or times" if isinstance(action, np.ndarray) else checks.shown(action)
        raise ValueError(f"action = {what}; allowed: numbers, {_wanted(space, navigate)}") from error
    if array.shape != space.shape:
        raise ValueError(f"action of shape {array.shape}; allowed: {_wanted(space, navigate)}")
    return array


def _wanted(space: gymnasium.Space[Any], navigate: bool) -> str:
    rest = ", then v_n E, N, U, latitude, longitude and height" if navigate else ""
    return f"{space.shape}, the quaternion q_nb, scalar first{rest}"


class EpisodeEnv(gymnasium.Env[Obs, Array]):
    """An environment with one episode at a time. A subclass names its id, its settings and its world.

    The keyword arguments are the fields of ``settings``, from which ``world`` makes the world. With ``reveal_truth`` the
    info holds the true states.

    Raises:
        ValueError: an unknown keyword, or a value that is not allowed.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": list(RENDER_MODES), "render_fps": 10}  # type: ignore[misc]
    env_id: ClassVar[str]
    settings: ClassVar[type]
    world: ClassVar[Callable[..., World]]  #: takes the id and the settings
    navigates: ClassVar[tuple[bool, ...]] = (
        False,
    )  #: whether an action holds velocity and position; both, if a setting decides

    @classmethod
    def make_world(cls, settings: dict[str, Any]) -> World:
        """Make the world of these keyword arguments.

        Raises:
            ValueError: an unknown keyword, with the nearest that exists, or a value that is not allowed.
        """
        return cls.world(cls.env_id, checks.build(cls.settings, settings, cls.env_id))

    def __init__(self, render_mode: str | None = None, *, reveal_truth: bool = False, **settings: Any) -> None:
        self.render_mode = _check_render_mode(render_mode)
        self.episode = Episode(self.make_world(settings), reveal_truth)
        self.observation_space = observation_space(self.task.n_sub, self.episode.world.fields)  # type: ignore[assignment]  # spaces are invariant
        self.action_space = action_space(self.task.navigate)  # type: ignore[assignment]
        self._renderer = Renderer(self.task) if render_mode else None

    @property
    def task(self) -> Task:
        """Everything that an estimator may know; each reset replaces it."""
        return self.episode.task

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Obs, dict[str, Any]]:
        """Begin an episode, and return observation 1 and the info with the start.

        Raises:
            ValueError: a seed that is no whole number from 0 on, or an option that the environment does not have.
        """
        (checked,) = check_seeds(seed, 1)
        super().reset(seed=checked)
        obs, info = self.episode.reset([self.np_random], options, squeeze=True)
        if self._renderer:
            self._renderer.reset(self.task)
        return _first(obs), _first(info)

    def step(self, action: Any) -> tuple[Obs, float, bool, bool, dict[str, Any]]:
        """Score an action, (4,) or (10,), and return the next observation, reward, two flags of the end, and the info.

        Raises:
            ValueError: an action of another shape.
            RuntimeError: a step before the reset or after the end.
        """
        action = _check_action(action, self.action_space, self.task.navigate)
        t = self.episode.k * self.task.epoch_s
        obs, reward, over, info = self.episode.step(action[None])
        row = _first(info)
        if self._renderer:
            self._renderer.add(t, action, row["errors"], row["failed"])
        return _first(obs), float(reward[0]), False, over, row

    def render(self) -> NDArray[np.uint8] | None:
        """Return the picture, RGB, (480, 960, 3); None without ``render_mode``."""
        return self._renderer.draw() if self._renderer else None


class EpisodeVectorEnv(VectorEnv[Obs, Array, NDArray[Any]]):
    """An environment with ``num_envs`` episodes in lockstep, computed as one batch.

    Row i equals the single environment with the seed of row i, bit for bit.
    """

    metadata: ClassVar[dict[str, Any]] = {  # type: ignore[misc]
        "render_modes": list(RENDER_MODES),
        "render_fps": 10,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    single: ClassVar[type[EpisodeEnv]]

    def __init__(
        self, num_envs: int = 1, render_mode: str | None = None, *, reveal_truth: bool = False, **settings: Any
    ) -> None:
        self.num_envs = checks.whole("num_envs", num_envs, "at least 1", least=1)
        self.render_mode = _check_render_mode(render_mode)
        self.episode = Episode(self.single.make_world(settings), reveal_truth)
        self.single_observation_space = observation_space(self.task.n_sub, self.episode.world.fields)
        self.single_action_space = action_space(self.task.navigate)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._rngs: list[np.random.Generator] | None = None
        self._over = False
        self._every = np.ones(self.num_envs, dtype=bool)
        self._renderer = Renderer(self.task) if render_mode else None

    @property
    def task(self) -> Task:
        """Everything that an estimator may know; its ``start`` has a run axis here."""
        return self.episode.task

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Obs, dict[str, Any]]:
        """Begin an episode in every row, and return observation 1 and the info with the start.

        A whole number as seed is that of row 0, and the other rows follow one by one; a list has a seed for each row.

        Raises:
            ValueError: seeds of another number, or an option that the environment does not have.
        """
        seeds = check_seeds(seed, self.num_envs)
        self._rngs = seeded(seeds, self._rngs)
        self._over = False
        obs, info = self.episode.reset(self._rngs, options)
        if self._renderer:
            self._renderer.reset(self.task)
        return obs, self._with_masks(info)

    def step(self, actions: Any) -> tuple[Obs, Array, Mask, Mask, dict[str, Any]]:
        """Score the actions, (rows, 4) or (rows, 10); the step after the end begins the next episode.

        Raises:
            ValueError: actions of another shape.
            RuntimeError: a step before the reset.
        """
        actions = _check_action(actions, self.action_space, self.task.navigate)
        no = ~self._every
        if self._over:  # NEXT_STEP: the step after the last one begins the next episode
            obs, info = self.reset()
            return obs, np.zeros(self.num_envs), no, ~self._every, info
        t = self.episode.k * self.task.epoch_s
        obs, reward, self._over, info = self.episode.step(actions)
        if self._renderer:
            self._renderer.add(t, actions[0], _first(info["errors"]), bool(info["failed"][0]))
        return obs, reward, no, self._every & self._over, self._with_masks(info)

    def render(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return the picture of row 0. The other rows are for scores, not to look at."""
        return (self._renderer.draw(),) if self._renderer else None

    def _with_masks(self, info: dict[str, Any]) -> dict[str, Any]:
        """Return the info in the layout of VectorEnv._add_info: every key, nested ones too, with its ``_key`` mask."""
        out: dict[str, Any] = {}
        for key, value in info.items():
            out[key] = self._with_masks(value) if isinstance(value, dict) else value
            out[f"_{key}"] = self._every.copy()
        return out


def _first(batch: Any) -> Any:
    """Return row 0 of nested arrays in the form of the single environment: fresh arrays and Python scalars."""
    if isinstance(batch, dict):
        return {key: _first(value) for key, value in batch.items()}
    row = batch[0]
    return row.copy() if isinstance(row, np.ndarray) else row.item()
