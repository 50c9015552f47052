"""The Gymnasium environments. Importing this folder registers their ids, as ``import sins_env`` does in the end.

Actions come in; observations, rewards and the errors behind them go out.
Read ``environments``, which names each with its settings and its world, then ``base``, ``episode``, ``reward``, ``spaces``
and ``rendering``.
"""

from __future__ import annotations

import gymnasium

from sins_env.envs.environments import ENVIRONMENTS

ENV_IDS = tuple(ENVIRONMENTS)


def register() -> None:
    """Register every environment; a second call changes nothing."""
    for env_id, vector in ENVIRONMENTS.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(env_id, entry_point=_path(vector.single), vector_entry_point=_path(vector))


def _path(cls: type) -> str:
    """The class as ``module:name``, so that a spec can be written as JSON."""
    return f"{cls.__module__}:{cls.__qualname__}"


register()
