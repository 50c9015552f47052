"""Truth: what the base really does. A trajectory yields exact increments and the state at each epoch, in chunks."""

from sins_env.trajectory.base import Motion, Trajectory
from sins_env.trajectory.sway import STILL, THESIS, Oscillation, Sway, SwayMotion

__all__ = ["STILL", "THESIS", "Motion", "Oscillation", "Sway", "SwayMotion", "Trajectory"]
