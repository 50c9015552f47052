"""The EKF beside the CKF on the same runs
=======================================

Both filters take 64 runs in one batch of the vector environment: errors and a figure.
"""

import argparse

import gymnasium
import numpy as np
from matplotlib.figure import Figure

import sins_env  # noqa: F401
import solvers

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--runs", type=int, default=64, help="default %(default)s")
parser.add_argument("--seconds", type=float, default=180.0, help="default %(default)s")
given = parser.parse_args()
RUNS, DURATION = given.runs, given.seconds


def azimuth_errors(name):
    """Return azimuth errors in arcsec, (epochs, runs). With the same seed every filter gets the same motion and noise."""
    env = gymnasium.make_vec("SINS/AlignSway-v0", num_envs=RUNS, duration=DURATION)
    obs, _ = env.reset(seed=0)
    solver = solvers.make(name)
    solver.reset(env.unwrapped.task, [np.random.default_rng(i) for i in range(RUNS)], RUNS)
    errors, done = [], False
    while not done:
        obs, _, _, truncated, info = env.step(solver.step(obs))
        errors.append(np.degrees(info["errors"]["phi"][:, 2]) * 3600)
        done = truncated[0]
    return np.array(errors)


figure = Figure(figsize=(7, 4), layout="constrained")
axes = figure.add_subplot()
for name in ("ekf", "ckf"):
    errors = azimuth_errors(name)
    rms = np.sqrt(np.mean(errors**2, axis=1))
    t = 0.1 * np.arange(1, len(rms) + 1)
    axes.plot(t, rms, label=name)
    thirds = [round(len(rms) * k / 3) - 1 for k in (1, 2, 3)]
    when, what = (f"{t[k]:.0f}" for k in thirds), (f"{rms[k]:.0f}" for k in thirds)
    print(f"{name}: azimuth RMS at {', '.join(when)} s: {', '.join(what)} arcsec")
axes.set(xlabel="time, s", ylabel="azimuth RMS, arcsec", yscale="log", title=f"{RUNS} common runs")
axes.grid(alpha=0.3)
axes.legend()
figure.savefig("ekf_and_ckf.png", dpi=120)
