"""A real recording of a parked car
================================

Laser gyros in a disturbed parked car, through the same interface: 90 s coarse, 210 s fine alignment.

The recording is not part of this repository. Set SINS_ENV_DATA to the folder of rlg_parked_car.npz.
"""

import gymnasium
import numpy as np

import sins_env  # noqa: F401
import solvers

try:
    env = gymnasium.make("SINS/Replay-v0", recording="rlg_parked_car.npz", window=(0.0, 300.0), coarse=90.0)
except FileNotFoundError as error:
    print(f"skipped: {error}")
else:
    obs, _ = env.reset(seed=0)
    solver = solvers.make("ckf")
    solver.reset(env.unwrapped.task, np.random.default_rng(0))
    truncated = False
    while not truncated:
        t = float(obs["t"][0])
        obs, _, _, truncated, info = env.step(solver.step(obs))
        if t % 30 < 0.05:
            level, azimuth = np.split(np.degrees(info["errors"]["phi"]), [2])
            print(
                f"t = {t:5.1f} s   heading off the reference by {azimuth[0]:+8.3f} deg, level by {abs(level).max():.4f} deg"
            )
