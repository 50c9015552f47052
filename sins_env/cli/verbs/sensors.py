"""The options ``--imu``, ``--gps``, ``--aid``, ``--fix-std`` and ``--outage`` as settings of a replay."""

from __future__ import annotations

import re
from argparse import Namespace
from typing import Any

from sins_env.reading.datasheets import told
from sins_env.sensors import aids
from sins_env.specs import GPS_PRESETS, IMU_PRESETS, gps_spec, imu_spec
from sins_env.worlds.receiver_std import ReceiverStd
from sins_env.worlds.recorded_aids import OFF


def sensor_settings(given: Namespace) -> dict[str, Any]:
    """Return the settings ``imu``, ``gps``, ``aids`` and ``fix_std`` that the command line tells, by preset or by field.

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
    if given.fix_std is not None:
        settings["fix_std"] = told(given.fix_std, (), "--fix-std")
        ReceiverStd.made(settings["fix_std"])
    for text in given.aid:
        name, *more = re.split("[:,]", text, maxsplit=1)
        spec = aids.sensor_of(name).specification
        of = told(more[0], (*spec.presets, OFF), name) if more else {}
        if of != OFF:
            spec.of(of)
        settings.setdefault("aids", {})[name] = of
    return settings
