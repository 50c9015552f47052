"""Process noise that adaptive filters estimate
============================================

Adaptive filters on a task that tells a wrong noise, and the noise that they find.

The told variance of the velocity noise is a million times too large, that of the attitude noise 30 times too small. The told GPS
is ten times worse than the true one. With an R that is too large every innovation looks small, so the filter lowers all of Q to
its floor. That improves the azimuth, but it is not the true attitude noise.
"""

import argparse

import numpy as np
from matplotlib.figure import Figure

import solvers
from sins_env.evaluation.tasks.catalogue import get_task

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("--runs", type=int, default=16, help="default %(default)s")
parser.add_argument("--seconds", type=float, default=150.0, help="default %(default)s")
given = parser.parse_args()
RUNS, DURATION = given.runs, given.seconds
UNIT = {"velocity": (0, 1e3, "mm/s"), "attitude": (4, 180 / np.pi * 3600, "arcsec")}  # state, factor
TRUE = {"velocity": 5e-6 * 9.80665 * 0.1**0.5, "attitude": np.deg2rad(0.01) / 60 * 0.1**0.5}  # per epoch of 0.1 s
NAMES = ("ckf", "aukf", "aukf_fading", "aukf_window", "augmented_aukf")


def play(name):
    """Return azimuth errors in arcsec (epochs, runs) and deviations of the process noise (epochs, runs, states)."""
    task = get_task("sway-told-wrong-v0")
    env = task.make(RUNS, duration=DURATION)
    obs, _ = task.reset(env, range(RUNS))
    solver = solvers.make(name)
    solver.reset(env.unwrapped.task, [np.random.default_rng(i) for i in range(RUNS)], RUNS)
    errors, noise, done = [], [], False
    while not done:
        obs, _, _, truncated, info = env.step(solver.step(obs))
        errors.append(np.degrees(info["errors"]["phi"][:, 2]) * 3600)
        noise.append(np.sqrt(solver.diagnostics().get("Q", np.zeros((RUNS, 0)))))
        done = truncated[0]
    return np.array(errors), np.array(noise)


figure = Figure(figsize=(13, 4.3), layout="constrained")
axes = dict(zip((*UNIT, "azimuth"), figure.subplots(1, 3), strict=True))
for i, name in enumerate(NAMES):
    errors, noise = play(name)
    t = 0.1 * np.arange(1, len(errors) + 1)
    rms = np.sqrt(np.mean(errors**2, axis=1))
    thirds = [round(len(rms) * k / 3) - 1 for k in (1, 2, 3)]
    when, what = (f"{t[k]:.0f}" for k in thirds), (f"{rms[k]:6.0f}" for k in thirds)
    print(f"{name:15} azimuth RMS at {', '.join(when)} s: {' '.join(what)} arcsec")
    axes["azimuth"].plot(t, rms, color=f"C{i}", label=name)
    if not noise.shape[-1]:
        continue
    for part, (state, factor, unit) in UNIT.items():
        if i == 1:
            axes[part].axhline(factor * noise[0, 0, state], color="black", ls="--", lw=1, label="told")
            axes[part].axhline(factor * TRUE[part], color="black", lw=1, label="true")
            axes[part].set(title=f"{part} noise: median, 10-90 % of runs", ylabel=f"{unit} per epoch")
        low, middle, high = np.percentile(factor * noise[..., state], [10, 50, 90], axis=1)
        axes[part].fill_between(t, low, high, color=f"C{i}", alpha=0.15, lw=0)
        axes[part].plot(t, middle, color=f"C{i}", label=name)
axes["azimuth"].set(title=f"azimuth RMS of {RUNS} runs", ylabel="arcsec")
for one in axes.values():
    one.set(xlabel="time, s", yscale="log", xlim=(0, DURATION))
    one.grid(alpha=0.3)
    one.set_ylim(top=one.get_ylim()[1] * (1 if one is axes["azimuth"] else 20))
    one.legend(fontsize=8, loc="upper right", ncols=1 if one is axes["azimuth"] else 3)
figure.savefig("adaptive_noise.png", dpi=120)
