"""A base that sways or stands still: the keyword arguments of its environments, and its world."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from sins_env import checks, earth
from sins_env.arrays import Rngs
from sins_env.sensors.gps import Gps
from sins_env.trajectory import STILL, THESIS, Sway, SwayMotion
from sins_env.trajectory.oscillations import MOTIONS
from sins_env.types import NavState
from sins_env.worlds.settings import SimulationSettings
from sins_env.worlds.simulated import BaseWorld


@dataclass(frozen=True)
class AlignSettings(SimulationSettings):
    """Settings of ``SINS/AlignSway-v0`` and ``SINS/AlignStatic-v0``: these two, and those of all simulated bases.

    ``vibration`` adds the vibration of 000 (2.5.5). ``motion`` is "thesis", or "random" for amplitudes, periods and phases
    that each run draws. A dict is a motion of one's own. It has, for some of the axes roll, pitch, yaw, surge, sway and heave, a
    component or a list of them, such as {"roll": {"amplitude_deg": 4, "period_s": 9.5}}. Surge, sway and heave have
    ``amplitude_m``. A component without ``phase_deg`` has a phase that each run draws. ``spectrum`` in it is a sea, such as
    {"kind": "jonswap", "height_m": 1.2, "peak_period_s": 8, "roll": {"deg_per_m": 3}}.

    Raises:
        ValueError: any value out of its range, or values that do not fit together.
    """

    vibration: bool = False
    motion: Any = "thesis"

    def __post_init__(self) -> None:
        _ = self.sway
        checks.flag("vibration", self.vibration)
        super().__post_init__()

    @property
    def sway(self) -> SwayMotion:
        """The motion of a base that sways.

        Raises:
            ValueError: an unknown name, axis or setting, or a value out of its range.
        """
        if isinstance(self.motion, str):
            checks.choice("motion", self.motion, MOTIONS)
            return THESIS
        return SwayMotion.of(self.motion)


class SwayWorld(BaseWorld):
    """A base that sways or stands still."""

    gps: Gps

    def __init__(self, env_id: str, settings: AlignSettings, still: bool) -> None:
        super().__init__(env_id, settings)
        self.settings: AlignSettings = settings
        task = self.task
        self.trajectory: Sway = Sway(
            task.site,
            task.epoch_s,
            task.n_sub,
            STILL if still else settings.sway,
            heading_deg=None,  # drawn, unless the settings tell it at each reset
            vibration=settings.vibration,
            random=settings.motion == "random",
        )
        self.gps = Gps(settings.gps_true, task.epoch_s, task.duration_s, earth.get(task.site.earth))

    def _begin(self, rngs: Rngs, options: dict[str, Any]) -> NavState:
        return self.trajectory.reset(rngs, self.settings.headings(self._records(rngs, options), len(rngs)))
