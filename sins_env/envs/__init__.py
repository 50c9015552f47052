"""The Gymnasium environments; importing this folder registers them.

Actions, which are estimates, come in; observations, rewards and the errors behind them go out. Read ``environments``,
which names each with its settings and its world, then ``base``, ``episode``, ``reward``, ``spaces``, ``rendering``.
"""

from __future__ import annotations

import gymnasium

from sins_env.envs.environments import ENVIRONMENTS

__all__ = ["ENV_IDS", "register"]

#: Ids of the environments, as ``gymnasium.make`` takes them.
ENV_IDS = tuple(ENVIRONMENTS)


def register() -> None:
    """Register every environment; a second call changes nothing."""
    for env_id, vector in ENVIRONMENTS.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(env_id, entry_point=_path(vector.single), vector_entry_point=_path(vector))


def _path(cls: type) -> str:
    """Return the path ``module:name`` of a class, with which Gymnasium's specification can be written as JSON."""
    return f"{cls.__module__}:{cls.__qualname__}"


register()
