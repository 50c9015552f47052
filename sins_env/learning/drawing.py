"""Drawing of simulated runs with their truth, in batches whose memory is bounded."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env import checks, types
from sins_env.arrays import Array, Obs
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.learning.seeds import training_seed
from sins_env.types import NavState
from sins_env.worlds.world import World

BATCH_BYTES = 64_000_000  #: memory of the arrays of a batch; a run that is larger is a batch of its own
MOST_ROWS = 256  #: most runs of a batch
INCREMENTS = ("dtheta", "dvel")

Tell = Callable[[float], None]  #: function called with the run-epochs done so far


class Batch(NamedTuple):
    """Some runs from the first epoch to the last, in arrays with a run axis and an epoch axis in front."""

    runs: tuple[int, ...]
    measured: Obs  #: what the sensors say, (runs, K, ...) by name
    truth: NavState  #: true states at the ends of the epochs, (runs, K, ...)
    began: NavState  #: true states at t = 0, (runs, ...)
    start: NavState  #: told states at t = 0, (runs, ...)
    known: NDArray[np.bool_]  #: (runs,), whether the start is told


@dataclass(frozen=True)
class Drawing:
    """Runs of a simulated task, with the seeds of :mod:`.seeds`.

    ``samples`` is the number of increments of an epoch; each is the sum of neighbours. None leaves all that the task has.

    Raises:
        ValueError: a task that plays a recording, or ``samples`` that do not divide those of the task.
        FileNotFoundError: a file of the task is not there.
    """

    task: EvaluationTask
    seed: int = 0
    samples: int | None = None

    def __post_init__(self) -> None:
        if self.task.windows:
            raise ValueError(
                f"task {self.task.name} plays a recording, which cannot be drawn anew; allowed: a simulated task, "
                "as sins-env list tasks shows them"
            )
        n_sub = self.public.n_sub
        if self.samples is not None:
            given = checks.whole("samples", self.samples, least=1)
            if n_sub % given:
                divisors = ", ".join(str(n) for n in range(1, n_sub + 1) if n_sub % n == 0)
                raise checks.refused("samples", given, f"a divisor of the {n_sub} samples of an epoch: {divisors}")

    @cached_property
    def _world(self) -> World:
        env: Any = self.task.make(1)
        world: World = env.unwrapped.episode.world
        env.close()
        return world

    @property
    def public(self) -> types.Task:
        """What estimators are told, without the start of a run."""
        return self._world.task

    @property
    def meanings(self) -> dict[str, str]:
        """Unit and meaning of each field of the sensors beside the increments."""
        return {name: field.what for name, field in self._world.fields.items()}

    @property
    def n_sub(self) -> int:
        """Number of increments of an epoch."""
        return self.samples or self.public.n_sub

    @property
    def fields(self) -> Mapping[str, tuple[tuple[int, ...], np.dtype[Any]]]:
        """Shape and type of each field of an observation but the time."""
        increments = dict.fromkeys(INCREMENTS, ((self.n_sub, 3), np.dtype(float)))
        return increments | {name: (one.low.shape, one.low.dtype) for name, one in self._world.fields.items()}

    @property
    def run_bytes(self) -> int:
        """Bytes of the arrays of a run."""
        measured = sum(int(np.prod(shape)) * dtype.itemsize for shape, dtype in self.fields.values())
        return self.public.num_epochs * (measured + 10 * np.dtype(float).itemsize)

    def batches(self, runs: Sequence[int], rows: int | None = None, tell: Tell | None = None) -> Iterator[Batch]:
        """Yield the runs in batches of at most ``rows``, by default as many as fit into ``BATCH_BYTES``.

        The bits of a run depend on its seed alone, whatever the batch.
        """
        rows = rows or max(1, min(BATCH_BYTES // self.run_bytes, MOST_ROWS))
        env = self.task.make(min(rows, len(runs)), reveal_truth=True)
        for first in range(0, len(runs), rows):
            part = tuple(runs[first : first + rows])
            if len(part) < env.num_envs:  # the last ones
                env.close()
                env = self.task.make(len(part), reveal_truth=True)
            yield self._play(env, part, partial(_add, tell, first * self.public.num_epochs))
        env.close()

    def _play(self, env: Any, runs: tuple[int, ...], tell: Tell) -> Batch:
        """Play a batch from the first epoch to the last; the action is the told start, and nobody looks at its score."""
        K, shape = self.public.num_epochs, (len(runs), self.public.num_epochs)
        seeds = [training_seed(self.task, run, self.seed) for run in runs]
        obs, info = env.reset(seed=seeds, options=self.task.options(runs))
        start, began = _state(info["start"]), _state(info["truth"])
        measured: Obs = {name: np.empty((*shape, *one), dtype) for name, (one, dtype) in self.fields.items()}
        truth = NavState(*(np.empty((*shape, part.shape[-1])) for part in began))
        action = np.concatenate(start, axis=-1) if self.public.navigate else start.q_nb
        for k in range(K):
            for name, value in measured.items():
                value[:, k] = self._summed(obs[name]) if name in INCREMENTS else obs[name]
            obs, _, _, _, step = env.step(action)
            for part, now in zip(truth, _state(step["truth"]), strict=True):
                part[:, k] = now
            if k % 100 == 99 or k == K - 1:
                tell((k + 1) * len(runs))
        return Batch(runs, measured, truth, began, start, info["start"]["known"])

    def _summed(self, increments: Array) -> Array:
        """Return increments (runs, samples, 3) from those of the task (runs, n_sub, 3)."""
        runs, n_sub, axes = increments.shape
        if n_sub == self.n_sub:
            return increments
        summed: Array = increments.reshape(runs, self.n_sub, n_sub // self.n_sub, axes).sum(axis=2)
        return summed


def _state(parts: Mapping[str, Any]) -> NavState:
    return NavState(*(parts[name] for name in NavState._fields))


def _add(tell: Tell | None, before: float, done: float) -> None:
    if tell:
        tell(before + done)
