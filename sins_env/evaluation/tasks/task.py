"""An evaluation task: environment, frozen keyword arguments, thresholds, suite seed. The name has the version.

Run seeds derive from the suite seed, the task's name and the run alone. They depend neither on the number of workers nor
on the solver, so every solver meets the same runs. docs/tasks_and_scores.md#seeds.
"""

from __future__ import annotations

import hashlib
import operator
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import VectorEnv

from sins_env.arrays import Array
from sins_env.units import ARCSEC, DEG


@dataclass(frozen=True)
class EvaluationTask:
    """Task of the evaluation. A change of anything but ``what`` and ``source`` needs a new version in the name."""

    name: str
    what: str
    source: str
    env_id: str
    delta_azimuth_deg: float
    delta_level_arcsec: float
    kwargs: Mapping[str, Any] = field(default_factory=dict)  #: settings of the environment, as JSON can hold them
    hold_s: float = 60.0  #: least time that an error must stay within its threshold until the end
    suite_seed: int = 0
    windows: int = 0  #: number of windows of a recording, and run i plays window i; 0 for a simulation
    records: int = 0  #: number of simulated records, and run i plays record i % records with its own noise; 0 for none
    score_from_s: float = 0.0  #: start of the time means of a navigation task, s from switch-on
    rank_by: str = "azimuth"  #: score that ranks a navigation task: "azimuth", "position", "velocity" or "failures"
    fail_azimuth_deg: float | None = None  #: azimuth error at the end above which a run has failed
    seeds_of: str = ""  #: name of a task whose run seeds it shares, so that only the settings differ; empty for none

    @property
    def delta(self) -> Array:
        """Thresholds of the errors E, N, U, (3,) rad."""
        level = self.delta_level_arcsec * ARCSEC
        return np.array([level, level, self.delta_azimuth_deg * DEG])

    @property
    def thresholds(self) -> str:
        """Thresholds in words."""
        level = f'{self.delta_level_arcsec:g}"'
        return f"azimuth within {self.delta_azimuth_deg:g} deg and level within {level}"

    @property
    def max_runs(self) -> int | None:
        """Number of windows of a recording; None for a simulation, which has any number of runs."""
        return self.windows or None

    def check_runs(self, runs: int) -> None:
        """Check that a recording has windows for so many runs.

        Raises:
            ValueError: more runs than windows.
        """
        if self.max_runs is not None and runs > self.max_runs:
            raise ValueError(
                f"runs = {runs} on {self.name}; allowed: up to {self.max_runs}, the windows of its recording"
            )

    def make(self, num_envs: int, **more: Any) -> VectorEnv[Any, Any, Any]:
        """Make the vector environment of ``num_envs`` runs; ``more`` are further settings of it.

        Raises:
            ValueError: settings that do not fit.
            FileNotFoundError: the recording is not there.
        """
        return gymnasium.make_vec(self.env_id, num_envs=num_envs, **{**self.kwargs, **more})

    def reset(
        self, env: VectorEnv[Any, Any, Any], runs: Sequence[int], suite_seed: int | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset ``env``, which has one row per run, to these runs of the suite; return observation 1 and the start's info.

        Raises:
            ValueError: a seed that is not a whole number, or is negative.
        """
        seeds: Any = [run_seed(self, run, suite_seed) for run in runs]
        return env.reset(seed=seeds, options=self.options(runs))

    def options(self, runs: Sequence[int]) -> dict[str, Any] | None:
        """Return the reset options with which an environment plays the windows or records of these runs."""
        if self.records:
            return {"record": [run % self.records for run in runs]}
        return {"window": list(runs)} if self.windows else None


def is_scored(env: VectorEnv[Any, Any, Any]) -> bool:
    """Return whether the environment knows the truth; a recording without a reference does not."""
    return bool(env.unwrapped.episode.world.scored)  # type: ignore[attr-defined]


def run_numbers(runs: int | Iterable[int]) -> list[int]:
    """Return the numbers of the requested runs, sorted and each once; a number ``runs`` means the first ones from 0 on.

    Raises:
        ValueError: anything but whole numbers, or a negative one.
    """
    allowed = "a whole number, at least 1, or the numbers of the runs wanted, from 0 on"
    try:
        if not isinstance(runs, Iterable):
            count = operator.index(runs)
            if count < 1:
                raise ValueError(f"runs = {count}; allowed: {allowed}")
            return list(range(count))
        found = sorted({operator.index(run) for run in runs})
    except TypeError as error:
        raise ValueError(f"runs = {runs!r}; allowed: {allowed}") from error
    if not found or found[0] < 0:
        raise ValueError(f"runs = {found}; allowed: {allowed}")
    return found


_SEEDS = "allowed: a whole number that is not negative"


def seed_sequence(task: EvaluationTask, suite_seed: int | None, *key: int) -> np.random.SeedSequence:
    """Return the seed sequence of a task in a suite, for numbers such as that of the run."""
    seed = _seed(task, suite_seed)
    return np.random.SeedSequence(seed, spawn_key=(zlib.crc32(seed_name(task).encode()), *key))


def seed_name(task: EvaluationTask) -> str:
    """Return the name of the task from which the run seeds follow."""
    return task.seeds_of or task.name


def _seed(task: EvaluationTask, suite_seed: int | None) -> int:
    """Return a seed that has been checked. An error does not repeat the given value, which may be nearly a secret."""
    try:
        seed = operator.index(task.suite_seed if suite_seed is None else suite_seed)
    except TypeError as error:
        raise ValueError(f"seed of type {type(suite_seed).__name__}; {_SEEDS}") from error
    if seed < 0:
        raise ValueError(f"seed below 0; {_SEEDS}")
    return seed


def run_seed(task: EvaluationTask, run: int, suite_seed: int | None = None) -> int:
    """Return the seed of the environment in one run, which is the same for every solver."""
    return int(seed_sequence(task, suite_seed, run).generate_state(1, np.uint64)[0])


def solver_rng(task: EvaluationTask, solver: str, run: int, suite_seed: int | None = None) -> np.random.Generator:
    """Return the random generator of one solver in one run.

    Its seed sequence, from which the solver may spawn, is a hash. With the suite seed itself a solver could compute the
    truth of its run.
    """
    source = seed_sequence(task, suite_seed, zlib.crc32(solver.encode()), run)
    hashed = hashlib.sha256(repr((source.entropy, source.spawn_key)).encode()).digest()
    bits = np.random.PCG64(np.random.SeedSequence(int.from_bytes(hashed)))
    bits.state = np.random.PCG64(source).state
    return np.random.Generator(bits)


def suite_hash(task: EvaluationTask, suite_seed: int | None = None) -> str:
    """Return the name of a suite in files, the first 16 digits of :func:`seed_hash`."""
    return seed_hash(_seed(task, suite_seed))[:16]


def seed_hash(seed: int) -> str:
    """Return the hash to publish before a secret suite seed is used: 64 hex digits of SHA-256."""
    return hashlib.sha256(f"sins-env suite {seed}".encode()).hexdigest()
