"""The Gymnasium environments. Importing :mod:`sins_env` registers their ids."""

from __future__ import annotations

import gymnasium

_ENTRY_POINTS = {
    "SINS/AlignSway-v0": "sins_env.envs.environments:AlignSway",
    "SINS/AlignStatic-v0": "sins_env.envs.environments:AlignStatic",
    "SINS/AlignVehicle-v0": "sins_env.envs.environments:AlignVehicle",
    "SINS/NavFlight-v0": "sins_env.envs.environments:NavFlight",
    "SINS/Replay-v0": "sins_env.envs.environments:Replay",
}
ENV_IDS = tuple(_ENTRY_POINTS)


def register() -> None:
    """Register the ids; a second call changes nothing."""
    for env_id, entry in _ENTRY_POINTS.items():
        if env_id not in gymnasium.registry:
            gymnasium.register(env_id, entry_point=f"{entry}Env", vector_entry_point=f"{entry}VectorEnv")
