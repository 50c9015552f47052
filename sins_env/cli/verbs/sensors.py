"""The options ``--imu``, ``--gps`` and ``--outage`` as settings of a replay."""

from __future__ import annotations

from argparse import Namespace
from typing import Any

from sins_env.reading.datasheets import told
from sins_env.specs import GPS_PRESETS, IMU_PRESETS, gps_spec, imu_spec


def sensor_settings(given: Namespace) -> dict[str, Any]:
    """Return the settings ``imu`` and ``gps`` that the command line tells, each a preset's name or a dict of fields.

    Raises:
        ValueError: an unknown preset or field, or a value out of range.
        FileNotFoundError: no such file.
    """
    settings: dict[str, Any] = {}
    if given.imu is not None:
        settings["imu"] = told(given.imu, IMU_PRESETS, "IMU preset")
        imu_spec(settings["imu"])
    if given.gps is not None:
        settings["gps"] = told(given.gps, GPS_PRESETS, "GPS preset")
        gps_spec(settings["gps"])
    if given.outage:
        gps = settings.get("gps", {})
        settings["gps"] = {**({"preset": gps} if isinstance(gps, str) else gps), "outages_s": given.outage}
    return settings
