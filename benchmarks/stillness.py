"""Rest that is seen: how parked cars are aligned, and how often the detector calls data still that are, and that are not.

    python benchmarks/stillness.py                  # simulated data, and the recordings in $SINS_ENV_DATA

The share is over all epochs of all runs, once the window of the detector is full. Fixes come at 1 Hz with 0.1 m/s, but for the
recordings, which have their own or those of a parked car.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from rich.console import Console
from rich.table import Table

import sins_env  # noqa: F401  registers the environments
import solvers
from sins_env.arrays import Mask
from sins_env.units import DEG
from solvers import zoo
from solvers.pipeline.aiding.stillness import WINDOW_S, Stillness

RUNS, SECONDS = 8, 60.0
GPS = {"vel_std_mps": 0.1, "pos_std_m": 3.0, "rate_hz": 1.0}
IMUS = ("tactical", "navigation", "mems")
STRAIGHT = {
    "latitude_deg": 48.0,
    "longitude_deg": 11.0,
    "speed_mps": 15.0,
    "heading_deg": 40.0,
    "segments": [[SECONDS]],
}
SLOW = {**STRAIGHT, "speed_mps": 0.5}
#: Simulated data: environment and settings.
SIMULATED: Mapping[str, tuple[str, dict[str, Any]]] = {
    "base that stands": ("SINS/AlignStatic-v0", {}),
    "parked car, nobody near": ("SINS/AlignVehicle-v0", {"events": "quiet", "coarse": 30.0}),
    "parked car with people": ("SINS/AlignVehicle-v0", {"events": "mixed", "coarse": 30.0}),
    "swaying base": ("SINS/AlignSway-v0", {}),
    "car in town": ("SINS/NavFlight-v0", {"profile": "car"}),
    "ship under way": ("SINS/NavFlight-v0", {"profile": "ship"}),
    "straight cruise at 15 m/s": ("SINS/NavFlight-v0", {"profile": STRAIGHT}),
    "straight creep at 0.5 m/s": ("SINS/NavFlight-v0", {"profile": SLOW}),
}
#: Parked cars with the sensors of navgrade_car_gps.npz and a fix a second; estimators begin at switch-on.
PARKED: dict[str, Any] = {
    "imu": "navgrade-car", "gps": {"preset": "dgps", "rate_hz": 1.0}, "n_sub": 10, "coarse": 0.0, "start": "unknown",
    "duration": 70.0,
}  # fmt: skip
AT_S, PARKED_RUNS, PARKED_SEED = (25.0, 40.0, 60.0, 68.0), 20, 7
FACTORS = (1.0, 30.0, 100.0)  #: what the told white noise is multiplied by, for the recordings
LASER, NAVGRADE = "rlg_parked_car.npz", "navgrade_car_gps.npz"
#: Windows of the recordings, start and length in s.
RECORDED: Mapping[str, tuple[str, tuple[float, float], dict[str, Any]]] = {
    "laser-gyro car, parked with people": (LASER, (0.0, 300.0), {}),
    "laser-gyro car, parked and quiet": (LASER, (680.0, 300.0), {}),
    "navigation-grade car, parked and rocked": (NAVGRADE, (0.0, 65.0), {"epoch": 0.05, "gps": "dgps"}),
    "navigation-grade car, driving": (NAVGRADE, (70.0, 66.3), {"epoch": 0.05, "gps": "dgps"}),
}


def stills(env: Any, runs: int, factor: float = 1.0) -> Mask:
    """Return what the detector says of all epochs after its first window, (epochs, runs), with told noise times a factor."""
    obs, _ = env.reset(seed=1)
    task = env.unwrapped.task
    white = {name: factor * getattr(task.prior, name) for name in ("arw_deg_sqrt_h", "vrw_ug_sqrt_hz")}
    task = replace(task, prior=replace(task.prior, **white))
    detector, found = Stillness(task, runs), []
    answer = np.zeros(env.action_space.shape)
    answer[..., 0] = 1.0
    for _ in range(task.num_epochs):
        found.append(detector.seen(obs if runs > 1 else {name: value[None] for name, value in obs.items()}))
        obs = env.step(answer)[0]
    return np.array(found[round(WINDOW_S / task.epoch_s) :])


def headings(scene: str, settings: Mapping[str, Any], runs: int, seed: int) -> list[str]:
    """Return RMS heading error, deg, median sigma, deg, and NEES of gsf_imm in parked cars, a cell for each of ``AT_S``."""
    env = gymnasium.make_vec("SINS/AlignVehicle-v0", num_envs=runs, events=scene, **PARKED)
    obs, _ = env.reset(seed=seed)
    task, solver, cells = env.unwrapped.task, solvers.make("gsf_imm", **settings), []  # type: ignore[attr-defined]
    solver.reset(task, np.random.default_rng(seed), runs)
    ends = [round(at / task.epoch_s) for at in AT_S]
    for k in range(1, ends[-1] + 1):
        obs, _, _, _, info = env.step(solver.step(obs))
        if k in ends:
            error, sigma = info["errors"]["phi"][:, 2] / DEG, np.sqrt(solver.covariance()[:, 2, 2]) / DEG
            rms, nees = np.sqrt(np.square(error).mean()), np.square(error / sigma).mean()
            cells.append(f"{rms:.2f}, {np.median(sigma):.2f}, {nees:.2f}")
    return cells


def parked() -> None:
    """Print how gsf_imm aligns parked cars that people rock, with its settings for recordings and with its defaults."""
    table = Table(title=f"heading of {PARKED_RUNS} parked cars: RMS error and median sigma, deg, and NEES")
    for name in ("scene", "settings", *(f"{at:g} s" for at in AT_S)):
        table.add_column(name)
    for scene in ("rocking", "people", "mixed"):
        for name, settings in (("for recordings", zoo.RECORDED), ("default", {})):
            table.add_row(scene, name, *headings(scene, settings, PARKED_RUNS, PARKED_SEED))
    Console(width=120).print(table)


def main() -> None:
    parked()
    table = Table(title="share of epochs that are called still")
    for name in ("data", *IMUS):
        table.add_column(name)
    for name, (env_id, settings) in SIMULATED.items():
        made = [
            gymnasium.make_vec(env_id, num_envs=RUNS, imu=imu, gps=GPS, n_sub=10, duration=SECONDS, **settings)
            for imu in IMUS
        ]
        table.add_row(name, *(f"{stills(env, RUNS).mean():.3f}" for env in made))
    console = Console()
    console.print(table)
    folder = Path(os.environ.get("SINS_ENV_DATA", "."))
    for name, (file, window, settings) in RECORDED.items():
        if not (folder / file).exists():
            console.print(f"{name}: skipped, {file} is not in {folder}")
            continue
        env = gymnasium.make("SINS/Replay-v0", recording=str(folder / file), window=window, coarse=30.0, **settings)
        shares = [f"{stills(env, 1, factor).mean():.3f} with {factor:g} times" for factor in FACTORS]
        console.print(f"{name}: {', '.join(shares)} the told noise")


if __name__ == "__main__":
    main()
