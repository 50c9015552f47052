"""The true motion of the base: swaying, standing, parked, flying, or through the places of a table.

The settings of a motion and random generators come in. Exact increments and the true state at the end of each epoch go
out, in chunks of epochs (:class:`sins_env.motion.Motion`). Read ``oscillations``,
``spectrum``, ``sway``; then ``segments``, ``plan``, ``flight``, ``track``; then ``suspension``, ``car``, ``vehicle``.
"""

from sins_env.motion import Motion, Trajectory
from sins_env.trajectory.flight import Flight
from sins_env.trajectory.oscillations import STILL, THESIS, Oscillation, SwayMotion
from sins_env.trajectory.plan import FlightPlan
from sins_env.trajectory.segments import MANOEUVRES, Segment
from sins_env.trajectory.sway import Sway
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
