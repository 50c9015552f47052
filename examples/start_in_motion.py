"""An INS that is switched on in motion
====================================

A car is under way: how soon do solvers know the heading, and do they know that they do? ::

    python examples/start_in_motion.py                      # ten drives, fixes once a second
    python examples/start_in_motion.py --profile ship       # a ship under way
    python examples/start_in_motion.py --straight           # nothing shows the heading, and the solvers say so

Nobody tells an attitude. ``ckf`` and ``inekf`` align in motion first, by the velocities of the fixes, and begin when the heading
is known to 5 deg. ``gsf_imm`` has inertial solutions for all headings from the first fix on. Shown are the RMS error of the
heading, and in brackets the standard deviation that the solver states.
"""

import argparse
import warnings

import gymnasium
import numpy as np
from rich.console import Console
from rich.table import Table

import sins_env  # noqa: F401  registers the environments
import solvers

LOOKS_S = (10, 20, 40, 60)
STRAIGHT = {"latitude_deg": 48.0, "longitude_deg": 11.0, "speed_mps": 15.0, "heading_deg": 40.0, "segments": [[60.0]]}


def headings(name: str, settings: dict, runs: int) -> list[str]:
    """Return error and stated standard deviation of the heading at the looks, deg."""
    env = gymnasium.make_vec(
        "SINS/NavFlight-v0", num_envs=runs, start="unknown", duration=float(LOOKS_S[-1]), **settings
    )
    obs, _ = env.reset(seed=1)
    solver, task, cells = solvers.make(name), env.unwrapped.task, []
    solver.reset(task, [np.random.default_rng(run) for run in range(runs)], runs)
    for k in range(1, task.num_epochs + 1):
        obs, _, _, _, info = env.step(solver.step(obs))
        if k * task.epoch_s in LOOKS_S:
            error = np.degrees(info["errors"]["phi"][:, 2])
            sigma = np.degrees(np.sqrt(solver.covariance()[:, 2, 2]))
            cells.append(f"{np.sqrt(np.mean(error**2)):.2f} ({sigma.mean():.2f})")
    return cells


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--profile", default="car", help="car, ship, or a flight (default car)")
    parser.add_argument("--straight", action="store_true", help="a drive without any manoeuvre")
    parser.add_argument("--imu", default="tactical", help="preset of inertial sensors (default tactical)")
    parser.add_argument("--runs", type=int, default=10, help="default 10")
    parser.add_argument("--solver", nargs="+", default=["ckf", "gsf_imm"], help="default ckf and gsf_imm")
    given = parser.parse_args()
    gps = {"vel_std_mps": 0.1, "pos_std_m": 3.0, "rate_hz": 1.0}
    settings = {"profile": STRAIGHT if given.straight else given.profile, "imu": given.imu, "gps": gps, "n_sub": 2}
    table = Table(title=f"heading error, deg RMS of {given.runs} runs (stated sigma)", title_justify="left")
    for name in ("solver", *(f"{t} s" for t in LOOKS_S)):
        table.add_column(name)
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        for name in given.solver:
            table.add_row(name, *headings(name, settings, given.runs))
    console = Console()
    console.print(table)
    for one in said:
        console.print(f"warning: {one.message}")


if __name__ == "__main__":
    main()
