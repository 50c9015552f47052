"""A car without GPS, with aiding sensors
======================================

What an odometer, its non-holonomic constraint and a barometer are worth while there is no GPS::

    python examples/aids_of_a_car.py                # 100 s with GPS, then 60 s without
    python examples/aids_of_a_car.py --outage 120 --solver gsf_imm

The setting ``aids`` of an environment names sensors, each with a preset or a dict of fields. Their readings are in the
observation, their assumed errors in the task, and every solver takes them. Printed are the position errors at the end, RMS
over the runs, and what the solver has learnt of the odometer.
"""

import argparse

import gymnasium
import numpy as np

import sins_env  # noqa: F401  registers the environments
import solvers

AIDS = {
    "nothing": {},
    "barometer": {"height": "bmp388"},
    "odometer": {"odometer": {"nhc": False}},
    "odometer and constraint": {"odometer": {"scale_ppm": 3000, "mounting_mrad": 5.0}},
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--begin", type=float, default=100.0, help="time with GPS, s (default 100)")
    parser.add_argument("--outage", type=float, default=60.0, help="time without, s (default 60)")
    parser.add_argument("--runs", type=int, default=10, help="default 10")
    parser.add_argument("--solver", default="ekf", help="default ekf")
    given = parser.parse_args()
    end = given.begin + given.outage
    gps = {"vel_std_mps": 0.1, "pos_std_m": 3.0, "rate_hz": 1.0, "outages_s": [[given.begin, end]]}
    for label, aids in AIDS.items():
        env = gymnasium.make_vec(
            "SINS/NavFlight-v0", num_envs=given.runs, profile="car", gps=gps, aids=aids, duration=end
        )
        obs, _ = env.reset(seed=1)
        solver, task = solvers.make(given.solver), env.unwrapped.task
        solver.reset(task, [np.random.default_rng(run) for run in range(given.runs)], given.runs)
        for _ in range(task.num_epochs):
            obs, _, _, _, info = env.step(solver.step(obs))
        east, north, up = np.sqrt(np.mean(info["errors"]["pos"] ** 2, axis=0))
        print(f"{label:24} {np.hypot(east, north):7.2f} m across, {up:6.2f} m up")
        env.close()
    learnt = solver.diagnostics()
    print(f"scale of the odometer known to {1e6 * learnt['odometer.scale_sigma'].mean():.0f} ppm")


if __name__ == "__main__":
    main()
