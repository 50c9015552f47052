"""A data set of Minari: one episode a run, whose actions are the true answers.

Index k of the observations is epoch k + 1; the last is the empty one that an environment returns at the end. Index k of
the actions is the truth at the end of that epoch, and rewards are zero, those of the truth. ``infos`` has the true states
from t = 0 on, and the metadata of an episode its run, its split and its told start.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from sins_env.checks import refused
from sins_env.envs.spaces import action_space
from sins_env.learning.drawing import INCREMENTS, Batch, Drawing
from sins_env.learning.facts import about
from sins_env.learning.seeds import training_seed

ID = re.compile(r"([-\w]+/)*[-\w]+-v\d+")
MISSING = 'Minari is not installed; pip install "sins-env[minari]" brings it, and a file that ends in .npz needs none'


def _module(name: str) -> Any:
    """Import a module of Minari.

    Raises:
        ImportError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        raise ImportError(MISSING) from error


def write(
    dataset_id: str, drawing: Drawing, batches: Iterable[Batch], labels: NDArray[np.str_], parts: Sequence[int]
) -> int:
    """Write the local dataset of an id, whole or not at all, and return its size in bytes.

    Raises:
        ValueError: an id that Minari does not allow, or one that exists.
        OSError: a folder that cannot be written.
        ImportError: Minari is not installed.
    """
    local, storages = _module("minari.storage"), _module("minari.dataset.minari_storage")
    if not ID.fullmatch(dataset_id):
        raise refused(
            "out", f"minari:{dataset_id}", "minari:NAME-vN, with a namespace in front perhaps: minari:sins/sway-v0"
        )
    namespace, _, _ = _module("minari.dataset.minari_dataset").parse_dataset_id(dataset_id)
    final = Path(local.get_dataset_path(dataset_id))
    if final.exists():
        raise ValueError(f"out = minari:{dataset_id}, which exists at {final}; allowed: another name or version")
    minari = _module("minari")
    if namespace is not None and namespace not in minari.namespace.list_local_namespaces():
        minari.namespace.create_namespace(namespace)
    new = final.with_name(f".{final.name}.{os.getpid()}.part")
    try:
        new.mkdir(parents=True)
        env = gymnasium.make(drawing.task.env_id, **drawing.task.kwargs)
        storage = storages.MinariStorage.new(
            new / "data",
            observation_space=observed(drawing, env.observation_space),
            action_space=action_space(drawing.public.navigate),
            env_spec=env.spec,
        )
        env.close()
        storage.update_metadata(
            {
                "dataset_id": dataset_id,
                "minari_version": minari.__version__,
                "algorithm_name": "truth",
                "description": json.dumps(about(drawing, parts)),
            }
        )
        done = 0
        for batch in batches:
            storage.update_episodes(episodes(drawing, batch))
            places = range(done, done + len(batch.runs))
            storage.update_episode_metadata(_metadata(drawing, batch, labels[done:]), places)
            done += len(batch.runs)
        os.rename(new, final)
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return sum(path.stat().st_size for path in final.rglob("*") if path.is_file())


def observed(drawing: Drawing, space: Any) -> spaces.Dict:
    """Return the space of the observations, whose increments may be sums."""
    limits = {name: float(space[name].high.max()) for name in INCREMENTS}
    summed = {name: spaces.Box(-most, most, drawing.fields[name][0], np.float64) for name, most in limits.items()}
    return spaces.Dict({**space.spaces, **summed})


def episodes(drawing: Drawing, batch: Batch) -> Iterator[Any]:
    """Yield the episode of each run."""
    buffer, K = _module("minari.data_collector").EpisodeBuffer, drawing.public.num_epochs
    t = np.minimum(np.arange(1, K + 2), K)[:, None] * drawing.public.epoch_s
    last = np.arange(K) == K - 1
    for i in range(len(batch.runs)):
        observations = {
            name: np.concatenate([value[i], np.zeros_like(value[i, :1])]) for name, value in batch.measured.items()
        }
        states = {name: part[i] for name, part in batch.truth._asdict().items()}
        began = {name: part[i][None] for name, part in batch.began._asdict().items()}
        yield buffer(
            observations={"t": t, **observations},
            actions=np.concatenate(list(states.values()), axis=-1) if drawing.public.navigate else states["q_nb"],
            rewards=np.zeros(K),
            terminations=np.zeros(K, dtype=bool),
            truncations=last,
            infos={f"truth_{name}": np.concatenate([began[name], part]) for name, part in states.items()},
        )


def _metadata(drawing: Drawing, batch: Batch, labels: NDArray[np.str_]) -> Iterator[dict[str, Any]]:
    for i, run in enumerate(batch.runs):
        start = {f"start_{name}": part[i] for name, part in batch.start._asdict().items()}
        seed = f"{training_seed(drawing.task, run, drawing.seed):032x}"
        yield {"run": run, "split": str(labels[i]), "run_seed": seed, "start_known": bool(batch.known[i]), **start}
