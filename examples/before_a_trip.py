"""Before a trip
=============

How must an aircraft fly so that its sensors find the heading? The bound of two tracks answers before anybody takes off.
"""

import csv
import sys
import tempfile
from pathlib import Path

import numpy as np

import sins_env
from sins_env.evaluation import EvaluationTask
from sins_env.evaluation.planning import figure, tables

KNOTS_S = np.arange(0.0, 121.0, 2.0)


def table(path: Path, swing_deg: float) -> None:
    """Write a track at 25 m/s whose course swings by so many degrees, with a row every two seconds."""
    fine = np.linspace(0.0, KNOTS_S[-1], 12_001)
    course = np.radians(swing_deg) * np.sin(2 * np.pi * fine / 40.0)
    east, north = (np.interp(KNOTS_S, fine, np.cumsum(0.25 * part)) for part in (np.sin(course), np.cos(course)))
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["t", "east_m", "north_m", "up_m"])
        writer.writerows(zip(KNOTS_S, east, north, np.full(len(KNOTS_S), 300.0), strict=True))


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        for name, swing in (("straight line", 0.0), ("S-turn", 40.0)):
            path = Path(folder) / "track.csv"
            table(path, swing)
            task = EvaluationTask(
                name=name,
                what="two minutes of flight with MEMS",
                source="own",
                env_id="SINS/NavFlight-v0",
                delta_azimuth_deg=1.0,
                delta_level_arcsec=600.0,
                kwargs={"profile": str(path), "imu": "mems", "gps": {"rate_hz": 5}, "epoch": 0.2},
            )
            forecast = sins_env.bound(task, until=["0.5deg", "1m"])
            print(forecast)
            for one in forecast.reached:
                print("  ", tables.sentence(forecast, one))
            row = forecast.budget()[0]
            print(f"   heading is limited most by: {row['source']} ({100 * row['share']['azimuth']:.0f} %)")
            if len(sys.argv) > 1:
                figure.forecast_figure(forecast).savefig(sys.argv[1], dpi=110)


if __name__ == "__main__":
    main()
