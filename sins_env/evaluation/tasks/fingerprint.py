"""Fingerprint of what a task delivers to an estimator, which shows any change of its world."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.evaluation.tasks.task import EvaluationTask

DIGEST_EPOCHS = 20  #: number of first epochs in the digest
DIGEST_EVERY_S = 10.0  #: period of later epochs of a flight, which changes its course long after its first epochs, s


def digest(task: EvaluationTask) -> str:
    """Return 16 hex digits that change when the world of a task changes.

    The digest covers the starts and first epochs of runs 0 and 1, and for a flight an epoch every 10 s. The errors in it
    are those of an estimator that keeps the told start.

    Each field enters as two weighted sums, rounded to a ten-millionth of their size. The values themselves could not be
    rounded safely. An increment is a small difference, and the last bit of another CPU would change the rounding of one
    value among thousands.
    """
    lines = []
    for name, parts in _digested(task).items():
        values = np.concatenate([np.asarray(part, dtype=np.float64).ravel() for part in parts])
        weights = np.random.default_rng(0).uniform(-1.0, 1.0, (2, len(values)))
        size = float(np.sqrt(np.sum(values**2)))
        unit = 10.0 ** (math.ceil(math.log10(size)) - 7) if size else 1.0
        lines.append(f"{name} {unit:.0e} " + " ".join(str(round(s / unit)) for s in weights @ values))
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def _digested(task: EvaluationTask) -> dict[str, list[NDArray[Any]]]:
    runs = (0, 1)[: task.max_runs]
    env: Any = task.make(len(runs))
    obs, info = task.reset(env, runs)
    fields = {name: [info["start"][name]] for name in ("q_nb", "vel", "pos")}
    action, errors = info["start"]["q_nb"], {"phi": "phi"}
    travels = env.unwrapped.task.navigate
    if travels:
        action = np.concatenate([part for (part,) in fields.values()], axis=-1)
        errors |= {"vel": "velocity error", "pos": "position error"}
    fields |= {name: [] for name in (*sorted(obs), *errors.values())}
    for _ in range(DIGEST_EPOCHS):
        for name, value in obs.items():
            fields[name].append(value)
        obs, _, _, _, step = env.step(action)
        for name, label in errors.items():
            fields[label].append(step["errors"][name])
    if travels:
        for epoch in _later_epochs(env):
            for name in obs.keys() - {"t"}:
                fields[name].append(epoch.measured[name])
        for name in ("pos", "gps_pos"):  # metres would hide radians
            fields[f"{name}, height"] = [part[..., 2:] for part in fields[name]]
            fields[name] = [part[..., :2] for part in fields[name]]
    env.close()
    return fields


def _later_epochs(env: Any) -> Iterator[Any]:
    public, world = env.unwrapped.task, env.unwrapped.episode.world
    every = max(round(DIGEST_EVERY_S / public.epoch_s), 1)
    for k in range(DIGEST_EPOCHS + 2, public.num_epochs + 1):
        epoch = world.epoch(k)
        if k % every == 0:
            yield epoch
