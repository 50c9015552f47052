"""How often the judgement of a solution without a reference is wrong: false alarms on good recordings, and power against faults.

    python benchmarks/consistency.py --records 100            # good recordings: drives of 75 s with sensors that are told
    python benchmarks/consistency.py --records 6 --faults     # the same with one fault each

A drive stands for 5 to 20 s and then turns, brakes and goes on at random. Its IMU is of navigation grade, tactical or MEMS, its
fixes come at 1, 2 or 5 Hz with a noise that is drawn, too. docs/recordings.md has the figures.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import gymnasium
import numpy as np

import sins_env
from sins_env.arrays import Array
from sins_env.recordings import Gnss, Recording
from sins_env.recordings.axes import swap_ned
from sins_env.types import Site

IMUS = ("navigation", "tactical", "mems")
MOVES = 28.0  #: time at which every drive is under way, s
Told = dict[str, Any]
Fault = tuple[Callable[[Recording], Recording], Callable[[Told], Told]]


def drive(i: int) -> tuple[Recording, Told]:
    """Return record ``i`` without a reference, and what a solver is to be told."""
    rng = np.random.default_rng(1000 + i)
    segments: list[list[float]] = [[float(rng.integers(5, 20))], [8, 1.5]]
    for _ in range(5):
        turn, push, rest = [8, 0, 0, 0, rng.uniform(-9, 9)], [8, rng.uniform(-0.5, 0.5)], [float(rng.integers(5, 12))]
        segments.append([turn, push, rest][rng.integers(3)])
    segments += [[8, rng.uniform(-1, 1)], [8, 0, 0, 0, 6.0]]
    place = {"latitude_deg": 48.1, "longitude_deg": 11.6, "height_m": 520.0, "heading_deg": rng.uniform(0, 360)}
    noise = {
        "vel_std_mps": rng.uniform(0.03, 0.2),
        "pos_std_m": rng.uniform(0.5, 5),
        "rate_hz": rng.choice([1.0, 2.0, 5.0]),
    }
    gps, imu = {name: float(value) for name, value in noise.items()}, IMUS[i % 3]
    env = gymnasium.make("SINS/NavFlight-v0", profile={**place, "segments": segments}, n_sub=5, imu=imu, gps=gps)
    obs, _ = env.reset(seed=i)
    seen, over = [], False
    while not over:
        seen.append(obs)
        obs, _, _, over, _ = env.step(np.eye(10)[0])
    every: dict[str, Array] = {name: np.stack([one[name] for one in seen]) for name in obs}
    fix = every["gps_valid"][:, 0] == 1
    gnss = Gnss(every["t"][fix, 0], every["gps_vel"][fix], every["gps_pos"][fix])
    dtheta, dvel = (every[name].reshape(-1, 3) for name in ("dtheta", "dvel"))
    return Recording(f"drive {i}", 50.0, 0.0, dtheta, dvel, Site(*gnss.pos[0]), gnss), {"imu": imu, "gps": gps}


def noisier(factor: float) -> Callable[[Told], Told]:
    """Return a function that multiplies the told standard deviations of the fixes."""

    def change(told: Told) -> Told:
        gps = told["gps"]
        return {
            **told,
            "gps": {**gps, "vel_std_mps": factor * gps["vel_std_mps"], "pos_std_m": factor * gps["pos_std_m"]},
        }

    return change


def later(one: Recording, shift: float) -> Recording:
    """Return a recording whose fixes are stamped late by ``shift`` s."""
    assert one.gnss is not None
    return replace(one, gnss=one.gnss._replace(t_s=one.gnss.t_s + shift))


def moving(one: Recording) -> Recording:
    """Return the part of a recording that begins in motion."""
    assert one.gnss is not None
    n, keep = round(MOVES * one.rate_hz), one.gnss.t_s > MOVES
    gnss = one.gnss._replace(**{name: getattr(one.gnss, name)[keep] for name in ("t_s", "vel", "pos")})
    return replace(one, t0=MOVES, dtheta=one.dtheta[n:], dvel=one.dvel[n:], gnss=gnss)


def same(value: Any) -> Any:
    return value


FAULTS: dict[str, Fault] = {
    "sigma of the fixes told 10 times too small": (same, noisier(0.1)),
    "variance of the fixes told 10 times too small": (same, noisier(0.1**0.5)),
    "sigma of the fixes told 3 times too large": (same, noisier(3.0)),
    "IMU told as of navigation grade": (same, lambda told: {**told, "imu": "navigation"}),
    "gyro up with the wrong sign": (lambda one: replace(one, dtheta=one.dtheta * [1, 1, -1]), same),
    "all gyros with the wrong sign": (lambda one: replace(one, dtheta=-one.dtheta), same),
    "axes turned over, as another mounting": (
        lambda one: replace(one, dtheta=swap_ned(one.dtheta), dvel=swap_ned(one.dvel)),
        same,
    ),
    "fixes 1 s late": (lambda one: later(one, 1.0), same),
    "fixes 0.2 s late": (lambda one: later(one, 0.2), same),
    "inekf, 10 s of coarse alignment in motion, which is right": (
        moving,
        lambda told: {**told, "solver": "inekf", "coarse": 10.0},
    ),
    "gsf_imm, start in motion, which is right": (moving, same),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--records", type=int, default=100)
    parser.add_argument("--faults", action="store_true", help="with each fault instead of none")
    given = parser.parse_args()
    for name, (change, tell) in (FAULTS if given.faults else {"no fault": (same, same)}).items():
        warned: list[str] = []
        for i in range(given.records):
            one, told = drive(i)
            found = sins_env.navigate(change(one), **tell(told)).consistency.warnings
            warned += [f"{i}: " + ", ".join(f"{w.name} {w.value:.2g}" for w in found)] if found else []
        print(f"{name}: {len(warned)} of {given.records} are not consistent  {'; '.join(warned)}", flush=True)


if __name__ == "__main__":
    main()
