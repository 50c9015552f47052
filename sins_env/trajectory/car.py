"""Disturbances of a parked car by people: doors, getting in and out, rocking by hand, as inputs to its suspension.

The figures are measured on the recording rlg_parked_car.npz by ``benchmarks/car_disturbances.py``, which prints them:

- The free oscillations of the car have these frequencies and damping ratios, with the IMU 0.7 to 0.9 m above the axes:

      mode         heading  pitch  roll  upper roll (about an axis near the IMU)  heave  surge
      frequency    3.0      2.55   2.2   5.2                                      2.5    2.0    Hz
      damping      0.06     0.12   0.06  0.03                                     0.13   0.1    of critical

- A seated person tilts the car by 1.2 to 4.3 mrad in roll and 1.2 to 2.5 mrad in pitch, and turns it by 0.1 of the roll
  in heading. While the person moves the tilt is larger. Peak rates are 13 (4 to 18) mrad/s in roll, 5 in pitch and 3 in
  yaw; peak velocities are 11, 7 and 7 mm/s.
- A door that opens or shuts tilts the car by 0.5 to 0.9 mrad in roll, with 2.6 mrad/s and 3 mm/s.
- In the 9 minutes with people at the car, a person gets in or out 6 times and a door moves 15 times. Other minutes have
  no event.

The recording has no rocking by hand. Its amplitude of 3 to 12 mrad is an assumption, set beside the steps of 0.05 to
0.3 deg of 000 chapter 6. See docs/mathematics/simulation.md#parked-car.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from sins_env import checks
from sins_env.arrays import Array
from sins_env.checks import build
from sins_env.trajectory.suspension import Input, Shape, blow, burst, step

#: The six modes of the suspension: four angles in rad, with the signs of attitude.from_euler, and two shifts in m.
MODES = ("heading", "pitch", "roll", "upper roll", "heave", "surge")
HZ = (3.0, 2.55, 2.2, 5.2, 2.5, 2.0)  #: undamped frequency of each mode
DAMPING = (0.06, 0.12, 0.06, 0.03, 0.13, 0.1)  #: damping of each mode, as a share of the critical one
LEVER_M = (0.2, -0.2, 0.9)  #: lever arm from the axis of the lower roll to the IMU, in the order Right, Forward, Up
UPPER_AXIS_M = 0.7  #: height of the axis of the upper roll above that of the lower one
GRID_S = 0.01  #: inputs begin and end at multiples of this, the edges of IMU samples at 100 Hz

#: Settled deflections of the modes under a person of 75 kg in the front right seat, and with a right door wide open.
PERSON = np.array([0.25e-3, -1.5e-3, 2.1e-3, 0.4e-3, -2.0e-3, 0.9e-3])
DOOR = np.array([0.05e-3, 0.0, 0.5e-3, 0.1e-3, 0.0, 0.0])
SILL = np.array([1.4, 0.5, 1.4, 1.4, 1.0, 1.0])  #: deflections while the person stands on the sill, over PERSON
#: Rates of the modes, rad/s and m/s, that a slammed door leaves, and a person who steps on the sill or drops into the seat.
SLAM = np.array([1.2e-3, 1.2e-3, -2.4e-3, -2.0e-3, -2.2e-3, 1.5e-3])
FOOT = np.array([1.2e-3, -2.5e-3, 2.5e-3, 3.0e-3, -4.0e-3, 3.0e-3])
SLAM_S, FOOT_S = 0.06, 0.1  #: durations of these two blows, s
ROCK_RAD = 5e-3  #: amplitude of the roll when it is rocked at its own frequency
#: Deflections of the modes in the rocking, over that of the roll; the heave in m per rad.
ROCK = np.array([0.0, 0.2, 1.0, 0.1, 0.03, 0.0])

SEATS = ("front-right", "front-left", "rear-right", "rear-left")
KINDS = ("door", "in", "out", "rock")
#: Scenes of 000 section 6.1 by name: the kinds of event and their shares.
SCENES: dict[str, dict[str, float]] = {
    "quiet": {},
    "doors": {"door": 1.0},
    "rocking": {"rock": 0.5, "door": 0.5},
    "people": {"person": 0.5, "door": 0.5},
    "mixed": {"person": 0.4, "door": 0.4, "rock": 0.2},
}
NUM_DRAWS = 10  #: random numbers that one event takes


@dataclass(frozen=True)
class Event:
    """One event of a script. A ``scale`` of 1 is a person of 75 kg, an ordinary slam, or 5 mrad of rocking.

    Raises:
        ValueError: an unknown kind or seat, a time or a scale out of range.
    """

    t: float  #: time from switch-on, s
    kind: str  #: one of KINDS
    seat: str = SEATS[0]  #: the person's seat, or the seat whose door is used
    scale: float = 1.0  #: size of the event over the ordinary one, up to 10

    def __post_init__(self) -> None:
        checks.keep(self, "t", checks.number, least=0.0)
        checks.choice("kind", self.kind, KINDS)
        checks.choice("seat", self.seat, SEATS)
        checks.keep(self, "scale", checks.number, above=0.0, most=10.0)

    @classmethod
    def of(cls, fields: Any) -> Event:
        """Make an event from a dict of its fields; an event is returned as it is.

        Raises:
            ValueError: no dict, a missing or unknown field, or a value out of range.
        """
        if isinstance(fields, cls):
            return fields
        if not isinstance(fields, Mapping) or not {"t", "kind"} <= set(fields):
            raise checks.refused("event", fields, "a dict with t (s) and kind, and perhaps seat and scale")
        return build(cls, dict(fields), "event")

    def inputs(self, draws: Array) -> list[Input]:
        """Return the inputs to the suspension; ``draws`` (NUM_DRAWS,), uniform in (0, 1), vary their course."""
        right = -1.0 if self.seat.endswith("left") else 1.0
        front = -1.0 if self.seat.startswith("rear") else 1.0
        side = np.array([right, 1.0, right, right, 1.0, 1.0])
        course = _Course(self.t)
        if self.kind == "rock":
            hz = HZ[2] * (0.9 + 0.2 * draws[0])
            size = 2 * DAMPING[2] * ROCK_RAD * self.scale * side * ROCK
            course.add(0.0, 6.0 + 9.0 * draws[2], lambda length: burst(length, hz), size)
            return course.inputs
        course.add(0.0, 0.8 + 0.7 * draws[0], step, side * DOOR)
        along = side * np.array([1.0, front, 1.0, 1.0, 1.0, front])
        person, foot = self.scale * along * PERSON, self.scale * along * FOOT
        on_sill, seated = SILL * person, (1.0 - SILL) * person
        slow, fast = 0.8 + 0.9 * draws[3], 0.4 + 0.6 * draws[5]
        if self.kind == "in":
            course.strike(1.0 + 2.0 * draws[2], FOOT_S, foot)
            course.add(-FOOT_S, fast, step, on_sill)
            course.add(0.5 + 2.0 * draws[4], slow, step, seated)
            course.strike(-FOOT_S, FOOT_S, foot)
        elif self.kind == "out":
            course.add(1.0 + 2.0 * draws[2], slow, step, -seated)
            course.add(0.5 + 2.0 * draws[4], fast, step, -on_sill)
            course.strike(-FOOT_S, FOOT_S, -foot)
        course.add(1.0 + 6.0 * draws[6], 0.4 + 0.4 * draws[7], step, -side * DOOR)
        course.strike(-0.5 * SLAM_S, SLAM_S, side * SLAM * (self.scale if self.kind == "door" else _spread(draws[1])))
        return course.inputs


class _Course:
    """The inputs of one event, one after the other, with times rounded to GRID_S."""

    def __init__(self, t: float) -> None:
        self.t, self.inputs = t, list[Input]()

    def add(self, pause: float, length: float, shape: Callable[[float], Shape], size: Array) -> None:
        """Add an input that begins ``pause`` s after the end of the last one, or before it if ``pause`` is negative."""
        begin, length = (GRID_S * max(round(x / GRID_S), least) for x, least in ((self.t + pause, 0), (length, 1)))
        self.t = begin + length
        self.inputs.append(Input(begin, length, shape(length), size))

    def strike(self, pause: float, length: float, rates: Array) -> None:
        """Add a blow that leaves these rates in the modes.

        A short blow of size a leaves the rate w^2 a times its integral, which is half its length.
        """
        self.add(pause, length, blow, 2 * rates / (length * (2 * np.pi * np.asarray(HZ)) ** 2))


def _spread(u: float) -> float:
    """Map a uniform number to a scale from 0.6 to 2.4 with median 1.2."""
    return float(0.6 * 4.0**u)


def _weight(u: float) -> float:
    """Map a uniform number to the weight of a person, 0.7 to 1.3 times 75 kg."""
    return 0.7 + 0.6 * u


def draw(scene: str, rate_per_min: float, duration_s: float, rng: np.random.Generator) -> list[Input]:
    """Draw the inputs of one run of a scene.

    Events are Poisson in time with ``rate_per_min``. A person gets into a free seat or leaves a taken one.
    """
    shares = SCENES[scene]
    count = int(rng.poisson(rate_per_min / 60.0 * duration_s)) if shares else 0
    seated = [_weight(u) if u < 0.5 else None for u in rng.random(len(SEATS))]  # half of the seats are taken at first
    times = np.sort(rng.uniform(0.0, duration_s, count))
    picks = rng.random((count, 3))
    draws = rng.random((count, NUM_DRAWS))
    edges = np.cumsum(list(shares.values()))
    out: list[Input] = []
    for t, (what, where, size), own in zip(times.tolist(), picks.tolist(), draws, strict=True):
        kind = list(shares)[min(int(np.searchsorted(edges, what, side="right")), len(edges) - 1)]
        seat, scale = int(len(SEATS) * where), _spread(size)
        if kind == "person":  # who leaves weighs what came in
            left = seated[seat]
            kind, scale = ("in", _weight(size)) if left is None else ("out", left)
            seated[seat] = scale if left is None else None
        out += Event(t, kind, SEATS[seat], scale).inputs(own)
    return out


def scripted(events: Sequence[Event], rng: np.random.Generator) -> list[Input]:
    """Return the inputs of one run of a script; durations and pauses, which a script leaves open, are drawn."""
    return [one for event in events for one in event.inputs(rng.random(NUM_DRAWS))]
