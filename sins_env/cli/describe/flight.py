"""The verb ``describe`` for a flight: its segments as a table and as a figure."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import fields
from pathlib import Path

import numpy as np
from rich.console import Console

from sins_env.cli.describe import figures
from sins_env.cli.output import save_figure
from sins_env.evaluation.show.rich_tables import titled
from sins_env.specs import GpsSpec, ImuSpec
from sins_env.trajectory.track import METRES, PLACES, TABLE_FILES, column_names, known_column
from sins_env.worlds.profiles import PROFILES, flight_profile, is_flight

IMU_COLUMNS = 6  #: columns of a recording that a track has not
_ALWAYS = ("vel_std_mps", "pos_std_m", "rate_hz")


def is_motion(name: str) -> bool:
    """Return whether this is a flight, or the table of a track: one with times and places, and no room for an IMU."""
    path = Path(name)
    if path.suffix.lower() not in TABLE_FILES:
        return is_flight(name)
    if not path.is_file() or path.with_suffix(".json").is_file():  # the mapping of a recording
        return False
    with suppress(ValueError):
        known = [known_column(one) for one in column_names(path)]
        needed = {"t", *(METRES if METRES[0] in known else PLACES)}
        return needed <= set(known) and known.count("") < IMU_COLUMNS
    return False


def describe_flight(name: str, console: Console) -> bool:
    """Print a flight profile, given by name, or the flight or the track of a file."""
    profile = flight_profile(name)
    plan = profile.plan
    table = titled(f"{Path(name).name}  {profile.what}")
    for column in ("#", "manoeuvre", "until, s", "speed, m/s", "heading, deg", "pitch, deg", "roll, deg"):
        table.add_column(column, justify="left" if column == "manoeuvre" else "right")
    table.add_row("", "start", "0", *(f"{x:.4g}" for x in (plan.speed_mps, plan.heading_deg, 0.0, 0.0)))
    for number, (manoeuvre, ends) in enumerate(plan.summary(), start=1):
        table.add_row(str(number), manoeuvre, *(f"{x:.4g}" for x in np.round(ends, 6) + 0.0))
    console.print(table)
    motion = f"stands still for {plan.rest_s:g} s at first" if plan.rest_s else "moves from the start"
    console.print(
        f"starts at {plan.latitude_deg:g}, {plan.longitude_deg:g} deg, {plan.height_m:g} m; {motion}\n"
        f"IMU {_given(profile.imu)}\nGPS {_given(profile.gps)}\n"
        f"told start: {', '.join(f'{x:g}' for x in profile.attitude_std_deg)} deg, {profile.velocity_std_mps:g} m/s, "
        f"{profile.position_std_m:g} m (1 sigma{', misalignment and biases + 1 sigma in every run' if profile.fixed else ''})",
        highlight=False,
    )
    return True


def _given(spec: ImuSpec | GpsSpec) -> str:
    """Return the fields that differ from their defaults, and those that are always shown."""
    default = type(spec)()
    given = [(f.name, getattr(spec, f.name)) for f in fields(spec)]
    shown = [(name, value) for name, value in given if name in _ALWAYS or value != getattr(default, name)]
    return ", ".join(f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}" for name, value in shown)


def draw_flight(name: str, path: str) -> None:
    """Draw a flight profile, or the flight of a file, and write the figure to ``path``."""
    title = f"{name}: {PROFILES[name].what}" if name in PROFILES else Path(name).name
    save_figure(figures.flight_figure(flight_profile(name).plan, title), path)
