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
#: Environments that play solvers, and so lie above the evaluation: the paths of both forms. They are imported when one is made.
PLAYING = {
    "SINS/TuneNoise-v0": (
        "sins_env.learning.tune_noise:TuneNoiseEnv",
        "sins_env.learning.tune_noise:TuneNoiseVectorEnv",
    )
}


def register() -> None:
    """Register every environment; a second call changes nothing."""
    paths = {env_id: (_path(vector.single), _path(vector)) for env_id, vector in ENVIRONMENTS.items()}
    for env_id, (single, together) in (paths | PLAYING).items():
        if env_id not in gymnasium.registry:
            gymnasium.register(env_id, entry_point=single, vector_entry_point=together)


def _path(cls: type) -> str:
    """Return the path ``module:name`` of a class, with which Gymnasium's specification can be written as JSON."""
    return f"{cls.__module__}:{cls.__qualname__}"


register()
