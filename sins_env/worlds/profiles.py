"""Flight profiles: the flights of the source documents, with their sensors, fixes and errors of the told start.

See docs/mathematics/simulation.md#flight-profiles.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from sins_env.checks import unknown
from sins_env.reading.documents import MOST_BYTES, YAML_ENDINGS, read_document
from sins_env.reading.files import beginning
from sins_env.sensors.imu import Script, Wave
from sins_env.specs import GpsSpec, ImuSpec
from sins_env.trajectory.plan import FLIGHT_FILES, FlightPlan
from sins_env.trajectory.segments import Segment
from sins_env.trajectory.track import TABLE_FILES, plan_of
from sins_env.trajectory.under_way import Signal, UnderWay


@dataclass(frozen=True)
class Profile:
    """A flight with its true sensors and the 1-sigma errors of its told start."""

    what: str  #: description in one line
    plan: FlightPlan
    imu: ImuSpec
    gps: GpsSpec
    attitude_std_deg: tuple[float, ...]
    velocity_std_mps: float
    position_std_m: float = 10.0
    fixed: bool = False  #: whether misalignment and biases are + 1 sigma in every run; velocity and position are drawn
    script: Script | None = None  #: departures of the true noise from the assumed one


def _rows(*rows: tuple[float, ...]) -> tuple[Segment, ...]:
    return tuple(Segment.of(row) for row in rows)


#: A row holds duration in s, acceleration in m/s^2, then rates of pitch, roll and heading (start, end) in deg/s.
_SUN2012 = FlightPlan(
    34.2,
    108.9,
    height_m=380.0,
    segments=_rows(
        (100,), (10, 0.2), (100, 0, 0, 0.5), (100, 0, 0, 0, -0.9), (100, 0, 0, -0.5), (100, 0, 0, 0, 0.9),
        (100,), (10, 0, 1), (100,), (10, 0, -1), (100,), (10, -0.2), (60,),
    ),
)  # fmt: skip
_PHYSICAL = replace(
    _SUN2012,
    segments=_rows(
        (100,), (20, 2), (90,), (10, 0, 0, -0.367, 0, -0.9), (100, 0, 0, 0, -0.9), (10, 0, 0, 0.367, -0.9, 0),
        (80,), (10, 0, 0, 0.367, 0, 0.9), (100, 0, 0, 0, 0.9), (10, 0, 0, -0.367, 0.9, 0), (70,), (10, 0, 1),
        (90,), (10, 0, -1), (90,), (20, -2), (80,),
    ),
)  # fmt: skip
_HOT_START = replace(
    _SUN2012,
    segments=_rows((20, 2), (40,), (10, 0, 0, 0.367, 0, 0.9), (100, 0, 0, 0, 0.9), (10, 0, 0, -0.367, 0.9, 0), (120,)),
)
_W3, _W2 = 2.9462, 3.4082  # deg/s, of banks of 30 deg at 110 m/s and 20 deg at 60 m/s
_LU = FlightPlan(
    34.0,
    108.0,
    height_m=300.0,
    speed_mps=10.0,
    segments=_rows(
        (50, 2), (40,), (10, 0, 0, 3, 0, _W3), (110, 0, 0, 0, _W3), (20, 0, 0, -3, _W3, -_W3), (110, 0, 0, 0, -_W3),
        (10, 0, 0, 3, -_W3, 0), (40,), (10, 0, 1), (50,), (10, 0, -1), (20,), (10, 0, -1), (50,), (10, 0, 1), (40, -2), (10,),
    ),
)  # fmt: skip
_ZHAO = FlightPlan(
    45.0,
    126.0,
    height_m=500.0,
    segments=_rows(
        (50,), (50, 1.2), (50,), (10, 0, 0, 2, 0, _W2), (40, 0, 0, 0, _W2), (20, 0, 0, -2, _W2, -_W2), (40, 0, 0, 0, -_W2),
        (10, 0, 0, 2, -_W2, 0), (50,), (10, 0, 1), (40,), (10, 0, -1), (120,),
    ),
)  # fmt: skip

#: A car in town at 6 to 16 m/s with seven turns.
_CAR = UnderWay(
    34.0,
    109.0,
    segments=_rows((300,)),
    height_m=100.0,
    speed_mps=11.0,
    heading_deg=34.0,
    speed=Signal(11.0, ((3.5, 47.0, 0.3), (1.5, 19.0, 1.0))),
    course=Signal(34.0, ((2.0, 31.0, 0.0),), (
        (90, 15, 2.2), (-90, 45, 2.5), (85, 80, 2.5), (90, 115, 2.2), (-95, 160, 2.6), (-90, 200, 2.4), (90, 250, 2.3),
    )),
    pitch=Signal(0.0, ((1.0, 9.0, 0.0), (0.4, 2.3, 1.0))),
    roll=Signal(0.0, ((1.2, 7.0, 0.4), (0.5, 1.7, 0.1))),
    climbs=True,
)  # fmt: skip
#: A ship under way at 6 m/s that rolls by 6 deg.
_SHIP = UnderWay(
    34.0,
    109.0,
    segments=_rows((300,)),
    speed_mps=6.0,
    heading_deg=34.0,
    speed=Signal(6.0, ((0.25, 11.0, 0.2), (0.5, 90.0, 0.0))),
    course=Signal(34.0, ((25.0, 180.0, 0.0),)),
    pitch=Signal(0.5, ((2.0, 6.7, 0.2),)),
    roll=Signal(0.0, ((6.0, 8.9, 1.0),)),
    yaw=Signal(0.0, ((1.5, 10.3, 0.4),)),
    across=Signal(0.0, ((0.3, 9.5, 0.0),)),
    heave=Signal(0.0, ((0.4, 7.3, 1.2),)),
)

_TACTICAL = ImuSpec(gyro_bias_deg_h=1.0, arw_deg_sqrt_h=0.1, accel_bias_ug=1000.0, vrw_ug_sqrt_hz=100.0)
_BETTER = ImuSpec(gyro_bias_deg_h=0.1, arw_deg_sqrt_h=0.01, accel_bias_ug=100.0, vrw_ug_sqrt_hz=50.0)
_GPS = GpsSpec(vel_std_mps=0.1, pos_std_m=10.0, rate_hz=1.0)
_GPS_LU = GpsSpec(vel_std_mps=0.1, pos_std_m=(10.0, 10.0, 3.0), rate_hz=10.0)

# 0.05 deg/h and 10 mg are standard deviations of a sample at 100 Hz: densities of a tenth of that per sqrt(Hz).
_SAMPLE_S = 0.01
_NOISY = ImuSpec(
    gyro_bias_deg_h=0.1,
    arw_deg_sqrt_h=0.05 / 60.0 * math.sqrt(_SAMPLE_S),
    accel_bias_ug=10_000.0,
    vrw_ug_sqrt_hz=10_000.0 * math.sqrt(_SAMPLE_S),
)
#: Noise of 002 example 3: 0.05 cos(0.1 t) deg/h about 0.01 deg/h, and 10 sin(0.1 t) mg about 1 mg.
#: See docs/mathematics/simulation.md#flight-profiles.
_TIDES = Script(
    gyro_mean_deg_h=0.01,
    accel_mean_ug=1000.0,
    gyro_wave=Wave(0.1),
    accel_wave=Wave(0.1, -math.pi / 2),
)

_SUN = Profile(
    "001: 15 min at 2 m/s, banked turns of a quarter circle, heading hardly observable",
    _SUN2012,
    _TACTICAL,
    _GPS,
    attitude_std_deg=(3.0, 3.0, 10.0),
    velocity_std_mps=0.1,
)
_LU_GAUSS = Profile(
    "003: 10 min at 110 m/s, orbits at 30 deg bank, GPS at 10 Hz",
    _LU,
    _BETTER,
    _GPS_LU,
    attitude_std_deg=(1.0, 1.0, 1.0),
    velocity_std_mps=0.5,
)

_WAY = Profile(
    "car in town, 5 min at 6 to 16 m/s with seven turns, under way from the first sample on",
    _CAR,
    _TACTICAL,
    replace(_GPS, pos_std_m=3.0),
    attitude_std_deg=(0.5, 0.5, 1.0),
    velocity_std_mps=0.1,
    position_std_m=3.0,
)

PROFILES: dict[str, Profile] = {
    "sun2012": _SUN,
    "sun2012-fixed": replace(
        _SUN, what="001 as printed: the same misalignment and biases in every run, + 1 sigma", fixed=True
    ),
    "sun2012-physical": replace(
        _SUN, what="001 as an aircraft could fly it: 40 m/s, coordinated turns", plan=_PHYSICAL
    ),
    "lu-gauss": _LU_GAUSS,
    "lu-mixture": replace(
        _LU_GAUSS,
        what="003 with contaminated fixes: one in five has ten times the variance",
        gps=replace(_GPS_LU, contamination=0.2, contamination_factor=10.0),
    ),
    "zhao2010": Profile(
        "002 example 3: sensor noise that swells and fades, with a mean, told as constant",
        _ZHAO,
        _NOISY,
        _GPS,
        attitude_std_deg=(2.0, 2.0, 2.0),
        velocity_std_mps=0.5,
        fixed=True,
        script=_TIDES,
    ),
    **{
        f"hotstart{name}": replace(
            _SUN,
            what=f"5 min at 40 m/s with one turn, told heading wrong by {spread[2]:g} deg (1 sigma)",
            plan=_HOT_START,
            attitude_std_deg=spread,
        )
        for name, spread in {"30": (5.0, 5.0, 30.0), "60": (10.0, 10.0, 60.0), "90": (20.0, 20.0, 90.0)}.items()
    },
    "car": _WAY,
    "ship": replace(_WAY, what="ship under way, 5 min at 6 m/s on a winding course, rolling by 6 deg", plan=_SHIP),
}


def flight_profile(given: Any) -> Profile:
    """Return a profile by name, or a flight or track of one's own (a dict, a file, a plan) with the sensors of ``sun2012``.

    Raises:
        ValueError: an unknown name, or an impossible flight.
        FileNotFoundError: no such file.
    """
    if isinstance(given, str) and given in PROFILES:
        return PROFILES[given]
    is_file = isinstance(given, (str, os.PathLike)) and Path(given).suffix.lower() in (*FLIGHT_FILES, *TABLE_FILES)
    if not is_file and not isinstance(given, (Mapping, FlightPlan)):
        raise unknown("profile", given, [*PROFILES, "a dict of a flight", "a YAML or JSON file", "a table of a track"])
    return replace(_SUN, what="a flight of one's own, with the sensors of sun2012", plan=plan_of(given))


def is_flight(name: str) -> bool:
    """Return whether this names a profile or a file with a flight, which has one of its fields at the top.

    Raises:
        ValueError: a YAML file that is none, or beyond the limits.
    """
    path = Path(name)
    if name in PROFILES:
        return True
    if path.suffix.lower() == ".json":
        return path.is_file() and b'"segments"' in (text := beginning(path, MOST_BYTES)) and b'"motion"' not in text
    if path.suffix.lower() not in YAML_ENDINGS or not path.is_file():
        return False
    found = read_document(path)
    return isinstance(found, dict) and not found.keys().isdisjoint(field.name for field in fields(FlightPlan))
