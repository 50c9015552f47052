"""My recording in five minutes
============================

From a foreign CSV to a track on a map, with what the solution says against itself.

A drive is simulated and written as an instrument might: two CSV files, milliseconds, deg/s and g, axes forward, right, down, and
velocities north, east, down. From there on it is a file of your own. A mapping says what the columns are, the file is checked
against itself, and the recommended solver navigates it. On the command line the same is::

    sins-env describe drive.json
    sins-env navigate drive.json --imu tactical --out drive.csv --out drive.kml --figure drive.png
"""

import argparse
import json

import gymnasium
import numpy as np

import sins_env
from sins_env import recordings

G = 9.80665
DRIVE = {
    "latitude_deg": 48.1,
    "longitude_deg": 11.6,
    "height_m": 520.0,
    "heading_deg": 40.0,
    # duration in s, acceleration in m/s^2, then rates of pitch, roll and heading in deg/s
    "segments": [
        [12],
        [8, 1.2],
        [10],
        [8, 0, 0, 0, 6],
        [12, 0.3],
        [10, 0, 0, 0, -7],
        [8, -0.8],
        [12, 0, 0, 0, 5],
        [10],
    ],
}
MAPPING = {
    "format": "csv",
    "file": "drive_imu.csv",
    "axes": "FRD",
    "time": {"column": "t_ms", "unit": "ms"},
    "gyro": {"columns": ["wx", "wy", "wz"], "unit": "deg/s"},
    "accel": {"columns": ["fx", "fy", "fz"], "unit": "g"},
    "gnss": {
        "file": "drive_gnss.csv",
        "time": {"column": "t_ms", "unit": "ms"},
        "position": {"columns": ["lat", "lon", "h"], "unit": "deg"},
        "velocity": {"columns": ["vn", "ve", "vd"], "frame": "NED"},
    },
}


def write_drive(seconds: float) -> None:
    """Write the two files of an instrument at 50 Hz, with fixes at 1 Hz, and the mapping beside them."""
    fixes_are = {"rate_hz": 1.0, "vel_std_mps": 0.05, "pos_std_m": 1.0}
    env = gymnasium.make("SINS/NavFlight-v0", profile=DRIVE, duration=seconds, n_sub=5, imu="tactical", gps=fixes_are)
    obs, _ = env.reset(seed=1)
    imu, fixes, rate, over = [], [], 50.0, False
    while not over:
        t = float(obs["t"][0])
        for i, (turn, push) in enumerate(zip(obs["dtheta"] * rate, obs["dvel"] * rate, strict=True)):
            right, forward, up = np.degrees(turn)
            f_right, f_forward, f_up = push / G
            stamp = 1000.0 * (t - 0.1 + (i + 1) / rate)
            imu.append([stamp, forward, right, -up, f_forward, f_right, -f_up])
        if obs["gps_valid"][0]:
            (east, north, up), (lat, lon, h) = obs["gps_vel"], obs["gps_pos"]
            fixes.append([1000.0 * t, np.degrees(lat), np.degrees(lon), h, north, east, -up])
        obs, _, _, over, _ = env.step(np.eye(10)[0])  # what is estimated meanwhile does not matter
    for name, columns, rows in (
        ("drive_imu.csv", "t_ms,wx,wy,wz,fx,fy,fz", imu),
        ("drive_gnss.csv", "t_ms,lat,lon,h,vn,ve,vd", fixes),
    ):
        np.savetxt(name, rows, fmt="%.12g", delimiter=",", header=columns, comments="")
    with open("drive.json", "w", encoding="utf-8") as file:
        json.dump(MAPPING, file, indent=2)


parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--seconds", type=float, default=90.0, help="length of the drive, at most 90")
write_drive(parser.parse_args().seconds)

drive = recordings.load("drive.json")
print(f"{drive.name}: {len(drive.dtheta)} samples at {drive.rate_hz:g} Hz, {len(drive.gnss.t_s)} fixes")
for found in recordings.findings(drive):
    print(f"found: {found}")

solution = sins_env.navigate(drive, imu="tactical", gps={"vel_std_mps": 0.05, "pos_std_m": 1.0})
solution.to_csv("drive.csv", rate_hz=10.0)
solution.to_kml("drive.kml")
solution.plot("drive.png")
print(solution)
for warning in solution.consistency.warnings:
    print(f"warning: {warning}")
print("written: drive.csv, drive.kml, drive.png")
