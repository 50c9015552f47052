"""The environments. Each names its id, its settings and its world, and its vector form names it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from sins_env.envs.base import EpisodeEnv, EpisodeVectorEnv
from sins_env.scenarios.scenario import Scenario
from sins_env.worlds.flight import FlightSettings, FlightWorld
from sins_env.worlds.replay import ReplayWorld
from sins_env.worlds.replay_settings import ReplaySettings
from sins_env.worlds.sway import AlignSettings, SwayWorld
from sins_env.worlds.vehicle import VehicleSettings, VehicleWorld
from sins_env.worlds.world import World

__all__ = [
    "AlignSettings",
    "AlignStaticEnv",
    "AlignSwayEnv",
    "AlignVehicleEnv",
    "FlightSettings",
    "NavFlightEnv",
    "ReplayEnv",
    "ReplaySettings",
    "ScenarioEnv",
    "ScenarioSettings",
    "VehicleSettings",
]


class AlignSwayEnv(EpisodeEnv):
    """The swaying base of 000 section 2.5.1."""

    env_id = "SINS/AlignSway-v0"
    settings = AlignSettings
    world = partial(SwayWorld, still=False)


class AlignSwayVectorEnv(EpisodeVectorEnv):
    """Swaying bases in lockstep."""

    single = AlignSwayEnv


class AlignStaticEnv(EpisodeEnv):
    """A base that stands still."""

    env_id = "SINS/AlignStatic-v0"
    settings = AlignSettings
    world = partial(SwayWorld, still=True)


class AlignStaticVectorEnv(EpisodeVectorEnv):
    """Still bases in lockstep."""

    single = AlignStaticEnv


class AlignVehicleEnv(EpisodeEnv):
    """A parked car: doors, people who get in and out, rocking by hand; fixes are zero-velocity updates."""

    env_id = "SINS/AlignVehicle-v0"
    settings = VehicleSettings
    world = VehicleWorld


class AlignVehicleVectorEnv(EpisodeVectorEnv):
    """Parked cars in lockstep."""

    single = AlignVehicleEnv


class NavFlightEnv(EpisodeEnv):
    """An INS and a GPS receiver in flight, from a told start with stated errors, or from rest."""

    env_id = "SINS/NavFlight-v0"
    settings = FlightSettings
    world = FlightWorld
    navigates = (True,)


class NavFlightVectorEnv(EpisodeVectorEnv):
    """Flights in lockstep."""

    single = NavFlightEnv


class ReplayEnv(EpisodeEnv):
    """A recording of an IMU, with its fixes, or zero-velocity updates where it has none."""

    env_id = "SINS/Replay-v0"
    settings = ReplaySettings
    world = ReplayWorld
    navigates = (False, True)


class ReplayVectorEnv(EpisodeVectorEnv):
    """Recordings in lockstep; all rows share one recording.

    The automatic reset after an episode has no options, like that of Gymnasium's own vector environments. Every row then
    draws its window, whichever ``reset(options={"window": ...})`` had picked.
    """

    single = ReplayEnv


@dataclass(frozen=True)
class ScenarioSettings:
    """Settings of ``SINS/Scenario-v0``: ``scenario`` is the path of a YAML or JSON file, or a dict as JSON can hold it.

    It names the kind of motion, and with it another environment, whose action and observation this one has. Its keys are those
    of docs/scenarios.md; what it leaves out is as in that environment.
    """

    scenario: Any = None


def scenario_world(env_id: str, settings: ScenarioSettings) -> World:
    """Return the world of a scenario, which is that of the environment for its kind of motion.

    Raises:
        ValueError: what is no scenario; the error of a file has the line.
        OSError: no such file, or one that cannot be read.
    """
    scenario = Scenario.of(settings.scenario)
    return ENVIRONMENTS[scenario.env_id].single.make_world(dict(scenario.kwargs))


class ScenarioEnv(EpisodeEnv):
    """Any of these environments from a scenario, which is a YAML or JSON file or a dict."""

    env_id = "SINS/Scenario-v0"
    settings = ScenarioSettings
    world = staticmethod(scenario_world)
    navigates = (False, True)


class ScenarioVectorEnv(EpisodeVectorEnv):
    """Runs of one scenario in lockstep."""

    single = ScenarioEnv


#: Every environment by its id, in its vector form, which names the single one.
ENVIRONMENTS: dict[str, type[EpisodeVectorEnv]] = {
    vector.single.env_id: vector for vector in EpisodeVectorEnv.__subclasses__()
}
