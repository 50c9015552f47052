"""A parked car and what people do to it: doors, persons in and out, rocking by hand, as inputs to its suspension.

Measured on rlg_parked_car.npz by benchmarks/car_disturbances.py, which prints what is stated here:

- free oscillation: pitch 2.5 Hz, roll 2.2 Hz and 5.2 Hz (the upper one about an axis near the IMU), yaw 2.9 Hz, heave
  2.4 Hz, damping 0.15, 0.06, 0.03, 0.06 and 0.12 of critical; the IMU 0.9 m above the axis of the lower roll;
- a person tilts the car by 2.3 to 4.3 mrad in roll and 1.2 to 2.5 mrad in pitch, with -0.09 of the roll in yaw; stepping
  on the sill the roll is up to 1.7 times as large; roll rates reach 10 to 18 mrad/s, velocities 7 to 13 mm/s;
- a door that opens tilts it by 0.5 to 0.9 mrad in roll; shutting it gives 1 to 4 mrad/s and 1 to 4 mm/s;
- about two such events a minute while people are at the car (0 to 550 s), and none for minutes elsewhere.

The recording has no rocking by hand; its amplitude, 3 to 12 mrad, is an assumption beside
the steps of 000 chapter 6 (equations.md S.2: 0.05 to 0.3 deg).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import checks
from sins_env.errors import build
from sins_env.trajectory.suspension import Input, Shape, blow, burst, step

Array = NDArray[np.float64]

MODES = ("heading", "pitch", "roll", "upper roll", "heave")  #: rad, the last one m; as attitude.from_euler turns
HZ = (2.9, 2.5, 2.2, 5.2, 2.4)
DAMPING = (0.06, 0.15, 0.06, 0.03, 0.12)
LEVER_M = (0.2, -0.2, 0.9)  #: of the IMU from the axis of the lower roll, Right-Forward-Up
UPPER_AXIS_M = 0.7  #: height of the axis of the upper roll above that of the lower one
GRID_S = 0.01  #: inputs begin and end on it: edges of IMU samples at 100 Hz

#: Settled deflections under a person of 75 kg in the front right seat, and a door wide open on the right.
PERSON = np.array([0.27e-3, -1.6e-3, 2.6e-3, 0.4e-3, -1.8e-3])
DOOR = np.array([0.05e-3, 0.0, 0.5e-3, 0.1e-3, 0.0])
SILL = np.array([1.7, 0.5, 1.7, 1.7, 1.0])  #: of PERSON, while on the sill
SLAM = np.array([0.5e-3, 0.4e-3, -1.5e-3, -1.0e-3, -1.0e-3])  #: rates in rad/s and m/s that shutting it leaves
SLAM_S = 0.06
ROCK_RAD = 5e-3  #: amplitude of roll when rocked at its own frequency
ROCK = np.array([0.0, 0.2, 1.0, 0.1, 0.03])  #: shares of the modes in the rocking; m per rad in heave

SEATS = ("front-right", "front-left", "rear-right", "rear-left")
KINDS = ("door", "in", "out", "rock")
#: What is done how often, by the name of a record. 000 section 6.1: doors; rocking, doors; people, doors.
SCENES: dict[str, dict[str, float]] = {
    "quiet": {},
    "doors": {"door": 1.0},
    "rocking": {"rock": 0.5, "door": 0.5},
    "people": {"person": 0.5, "door": 0.5},
    "mixed": {"person": 0.4, "door": 0.4, "rock": 0.2},
}
NUM_DRAWS = 10  #: of one event


@dataclass(frozen=True)
class Event:
    """One line of a script. ``scale`` 1 is a person of 75 kg, an ordinary slam, 5 mrad of rocking.

    Raises:
        ValueError: an unknown kind or seat, a time or a scale out of range.
    """

    t: float  #: s from switch-on
    kind: str
    seat: str = SEATS[0]  #: of the person, or whose door
    scale: float = 1.0

    def __post_init__(self) -> None:
        checks.keep(self, "t", checks.number, least=0.0)
        checks.choice("kind", self.kind, KINDS)
        checks.choice("seat", self.seat, SEATS)
        checks.keep(self, "scale", checks.number, above=0.0, most=10.0)

    @classmethod
    def of(cls, fields: Any) -> Event:
        """From a dict of the fields."""
        if isinstance(fields, cls):
            return fields
        if not isinstance(fields, Mapping) or not {"t", "kind"} <= set(fields):
            raise checks.refused("event", fields, "a dict with t (s) and kind, and perhaps seat and scale")
        return build(cls, dict(fields), "event")

    def inputs(self, draws: Array) -> list[Input]:
        """What it does to the car; ``draws`` (NUM_DRAWS,) uniform in (0, 1) vary its course."""
        right = -1.0 if self.seat.endswith("left") else 1.0
        rear = -1.0 if self.seat.startswith("rear") else 1.0
        side = np.array([right, 1.0, right, right, 1.0])
        at = _Course(self.t)
        if self.kind == "rock":
            hz = HZ[2] * (0.9 + 0.2 * draws[0])
            size = 2 * DAMPING[2] * ROCK_RAD * self.scale * side * ROCK
            return [at.add(0.0, 6.0 + 9.0 * draws[2], lambda length: burst(length, hz), size)]
        slam = side * SLAM * (self.scale if self.kind == "door" else _spread(draws[1]))
        person = self.scale * side * np.array([1.0, rear, 1.0, 1.0, 1.0]) * PERSON
        on_sill, seated = SILL * person, (1.0 - SILL) * person
        out = [at.add(0.0, 0.8 + 0.7 * draws[0], step, side * DOOR)]
        if self.kind == "in":
            out.append(at.add(1.0 + 2.0 * draws[2], 0.3 + 0.4 * draws[3], step, on_sill))
            out.append(at.add(0.5 + 2.0 * draws[4], 0.6 + 0.9 * draws[5], step, seated))
        elif self.kind == "out":
            out.append(at.add(1.0 + 2.0 * draws[2], 0.6 + 0.9 * draws[3], step, -seated))
            out.append(at.add(0.5 + 2.0 * draws[4], 0.3 + 0.4 * draws[5], step, -on_sill))
        out.append(at.add(1.0 + 6.0 * draws[6], 0.4 + 0.4 * draws[7], step, -side * DOOR))
        height = 2 * slam / (SLAM_S * (2 * np.pi * np.asarray(HZ)) ** 2)  # rate = w^2 a T / 2
        out.append(at.add(-0.5 * SLAM_S, SLAM_S, blow, height))
        return out


class _Course:
    """One input after the other, on the grid."""

    def __init__(self, t: float) -> None:
        self.t = t

    def add(self, pause: float, length: float, shape: Any, size: Array) -> Input:
        begin, length = (GRID_S * max(round(x / GRID_S), least) for x, least in ((self.t + pause, 0), (length, 1)))
        made: Shape = shape(length)
        self.t = begin + length
        return Input(begin, length, made, size)


def _spread(u: float) -> float:
    """0.6 to 2.4, as often below 1.2 as above."""
    return float(0.6 * 4.0**u)


def draw(scene: str, rate_per_min: float, duration_s: float, rng: np.random.Generator) -> list[Input]:
    """The inputs of one run: events Poisson in time, each seat taken or left in turn."""
    shares = SCENES[scene]
    count = int(rng.poisson(rate_per_min / 60.0 * duration_s)) if shares else 0
    taken = rng.random(len(SEATS)) < 0.5
    times = np.sort(rng.uniform(0.0, duration_s, count))
    picks = rng.random((count, 3))
    draws = rng.random((count, NUM_DRAWS))
    edges = np.cumsum(list(shares.values()))
    out: list[Input] = []
    for t, pick, own in zip(times.tolist(), picks, draws, strict=True):
        kind = list(shares)[min(int(np.searchsorted(edges, pick[0], side="right")), len(edges) - 1)]
        seat = int(len(SEATS) * pick[1])
        if kind == "person":
            kind = "out" if taken[seat] else "in"
            taken[seat] = not taken[seat]
        scale = 0.7 + 0.6 * pick[2] if kind in ("in", "out") else _spread(pick[2])
        out += Event(t, kind, SEATS[seat], scale).inputs(own)
    return out


def scripted(events: Sequence[Event], rng: np.random.Generator) -> list[Input]:
    """The inputs of one run of a script; what the script leaves open is drawn."""
    return [one for event in events for one in event.inputs(rng.random(NUM_DRAWS))]
