"""The EKF beside the CKF on the same 64 runs, in one batch of the vector environment: errors and a figure."""

import gymnasium
import numpy as np
from matplotlib.figure import Figure

import sins_env  # noqa: F401
import solvers

RUNS, DURATION = 64, 180.0


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
    axes.plot(0.1 * np.arange(1, len(rms) + 1), rms, label=name)
    print(f"{name}: azimuth RMS at 60, 120, 180 s: {rms[599]:.0f}, {rms[1199]:.0f}, {rms[-1]:.0f} arcsec")
axes.set(xlabel="time, s", ylabel="azimuth RMS, arcsec", yscale="log", title=f"{RUNS} common runs")
axes.grid(alpha=0.3)
axes.legend()
figure.savefig("ekf_and_ckf.png", dpi=120)
