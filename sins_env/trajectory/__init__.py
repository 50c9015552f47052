"""Truth: what the base really does. A trajectory yields exact increments and the state at each epoch, in chunks."""

from sins_env.motion import Motion, Trajectory
from sins_env.trajectory.flight import Flight
from sins_env.trajectory.plan import FlightPlan
from sins_env.trajectory.segments import MANOEUVRES, Segment
from sins_env.trajectory.sway import STILL, THESIS, Oscillation, Sway, SwayMotion
from sins_env.trajectory.vehicle import Vehicle

__all__ = [
    "MANOEUVRES",
    "STILL",
    "THESIS",
    "Flight",
    "FlightPlan",
    "Motion",
    "Oscillation",
    "Segment",
    "Sway",
    "SwayMotion",
    "Trajectory",
    "Vehicle",
]
