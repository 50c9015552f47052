"""Observations of order one: each field over its root mean square, places in metres from the start. docs/learning.md#scales."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import spaces

from sins_env import checks, earth
from sins_env.arrays import Array, Obs
from sins_env.envs.base import EpisodeEnv, EpisodeVectorEnv
from sins_env.learning.seeds import HIGHEST
from sins_env.recordings.axes import swap_ned
from sins_env.types import Task
from sins_env.wrappers.frames import MARK, NorthEastDown
from sins_env.wrappers.translated import E, Info, Translation, inside, translated, world_of

PLACE = "gps_pos"
RUNS = 4  #: number of runs from which scales are measured


class Scaled(Translation):
    """Fields over their ``scales``, in float32."""

    rank = 2

    def __init__(self, scales: Mapping[str, float], ned: bool) -> None:
        self.scales, self.ned = dict(scales), ned
        self._task: Task | None = None

    def spaces(self, observed: spaces.Dict, action: spaces.Box) -> tuple[spaces.Dict, spaces.Box]:
        """Return the space of the scaled fields; its limits are those of the sensors, scaled."""
        boxes: dict[str, Any] = {}
        for name, space in observed.items():
            low, high = space.low / self.scales[name], space.high / self.scales[name]  # type: ignore[attr-defined]
            if name == PLACE:
                high = np.full(3, 2.0 * np.pi * earth.get("wgs84").a) / self.scales[name]
                low = -high
            boxes[name] = spaces.Box(low.astype(np.float32), high.astype(np.float32), dtype=np.float32)
        return spaces.Dict(boxes), action

    def begin(self, env: EpisodeEnv | EpisodeVectorEnv, obs: Obs, info: Info) -> None:
        """Take the origin of the places from the task."""
        self._task = env.task

    def observed(self, obs: Obs) -> Obs:
        """Return the scaled fields."""
        assert self._task is not None
        found = dict(obs)
        if PLACE in found:
            metres = from_start(self._task, obs[PLACE], obs["gps_valid"])
            found[PLACE] = swap_ned(metres) if self.ned else metres
        return {name: (value / self.scales[name]).astype(np.float32) for name, value in found.items()}


def from_start(task: Task, places: Array, valid: Array) -> Array:
    """Return places (..., 3) in metres East, North, Up from the told start, or the site if there is none; zeros without a fix."""
    origin = task.site.pos if task.start is None else task.start.pos
    metres = earth.offset(earth.get(task.site.earth), np.broadcast_to(origin, places.shape), places)
    return np.where(valid == 1, metres, 0.0)


def measured(env: Any) -> dict[str, float]:
    """Return the root mean square of each field over some runs of the world of an environment, without readings that are missing.

    Times have the duration; marks, and fields that are always zero, have one.
    """
    world = world_of(env)
    _, told = world.reset([np.random.default_rng(s) for s in np.random.SeedSequence(HIGHEST).spawn(RUNS)], {})
    task = replace(world.task, start=told)
    squares, counts = dict[str, float](), dict[str, int]()
    for k in range(1, task.num_epochs + 1):
        seen = world.epoch(k).measured
        for name, value in seen.items():
            if name == PLACE:
                value = from_start(task, value, seen["gps_valid"])
            there = value != 0
            squares[name] = squares.get(name, 0.0) + float(np.sum(np.square(value, dtype=float)))
            counts[name] = counts.get(name, 0) + int(there.sum())
    found = {name: float(np.sqrt(squares[name] / max(counts[name], 1))) or 1.0 for name in squares}
    marks = {name: 1.0 for name in found if name.endswith(MARK)}
    return {**found, **marks, "t": task.duration_s}


def scaled(env: E, scales: Mapping[str, float] | None = None) -> E:
    """Return an environment whose observations are float32 of order one.

    Each field is divided by its root mean square, measured over four runs of the same world that no suite has. The time is
    divided by the duration. ``gps_pos`` becomes metres East, North, Up (or North, East, Down) from the told start, or from the
    site, before it is scaled. ``scales`` replaces scales by name, in the units of the fields.

    Raises:
        ValueError: another environment, wrappers in another order, or a scale that is not positive or has no field.
    """
    if not isinstance(scales, Mapping | None):
        raise checks.refused("scales", scales, "a dict of scales by name of the field")
    found = measured(env)
    for name, given in (scales or {}).items():
        checks.choice("scale", name, found)
        found[name] = checks.number(f"scale of {name}", given, above=0.0)
    return translated(env, Scaled(found, inside(env, NorthEastDown)))
