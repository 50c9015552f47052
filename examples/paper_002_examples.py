"""Examples 1 and 2 of Zhao et al. (2010), doc 002: does the adaptive filter find noise that it was told wrong?

The printed system explodes, so this is its bounded form (|x2 x3|). "as printed" is the recursion of the paper;
"safeguarded" takes the told noise for 20 fixes, damps what one fix may say, and bounds the estimate.
"""

import numpy as np
from matplotlib.figure import Figure

from solvers.filters import make_filter
from solvers.filters.aukf import LITERAL
from solvers.toy_models import Benchmark002, changing_R

RUNS, STEPS = 200, 300
COLOUR = {
    "as printed": "tab:red",
    "safeguarded": "tab:blue",
    "UKF, told wrong": "tab:grey",
    "UKF, told right": "tab:green",
}
k = np.arange(1, STEPS + 1)


def band(axes, values, label):
    """Median and 5-95 % of (steps, runs), and run 0 as a thin line."""
    low, middle, high = np.nanpercentile(values, [5, 50, 95], axis=1)
    axes.fill_between(k, low, high, color=COLOUR[label], alpha=0.15, lw=0)
    axes.plot(k, middle, color=COLOUR[label], lw=2, label=f"{label}: median, 5-95 % of {RUNS} runs")
    axes.plot(k, values[:, 0], color=COLOUR[label], lw=0.7, ls="--", label="one run")


def finish(figure, name):
    for axes in figure.axes:
        axes.grid(alpha=0.3)
        axes.set_xlim(0, STEPS)
        axes.set_xlabel("step")
        axes.legend(fontsize=8, loc="upper right")
    figure.savefig(name, dpi=120)


def compare(title, truth, filters, told):
    """Every filter on the same measurements; prints the accuracy and what went wrong."""
    tracks = {}
    print(title)
    for label, (flt, changes) in filters.items():
        tracks[label] = track = system.track(flt, truth.z, **{**told, **changes})
        rms = np.sqrt(np.mean((track.mean - truth.x) ** 2, axis=(0, 1)))
        lost, mended = track.health.failed_at >= 0, track.health.repairs > 0
        print(f"  {label:16} RMS x1 {rms[0]:6.3f}  x2 {rms[1]:6.3f}  x3 {rms[2]:6.3f}   "
              f"runs frozen {lost.mean():4.0%}, with an indefinite covariance {mended.mean():4.0%}")  # fmt: skip
    return tracks


exploded = Benchmark002("literal").simulate(np.random.default_rng(1), 1000, STEPS).ended
print(f"the system as printed: {np.mean(exploded > 0):.0%} of 1000 runs exceed 1e6 within {STEPS} steps, "
      f"half of those by step {np.median(exploded[exploded > 0]):.0f}\n")  # fmt: skip

system = Benchmark002("abs")
ukf, both = make_filter("ukf"), {"adapt": "qQ"}
one = system.simulate(np.random.default_rng(2), RUNS, STEPS)
first = compare(
    "example 1: told q = 0, Q = 0.2; true q = 0.2, Q = 0.4",
    one,
    {
        "as printed": (make_filter("aukf", **both, **LITERAL), {}),
        "safeguarded": (make_filter("aukf", **both), {}),
        "UKF, told wrong": (ukf, {}),
        "UKF, told right": (ukf, {"q": 0.2, "Q": 0.4}),
    },
    {"q": 0.0, "Q": 0.2, "r": 0.3, "R": 0.5},
)
two = system.simulate(np.random.default_rng(3), RUNS, STEPS, R=changing_R)
second = compare(
    "example 2: told R = 1; true R = 0.5, 0.9, 0.3, 0.7, 0.5; b = 0.95",
    two,
    {
        "as printed": (make_filter("aukf_fading", adapt="R", b=0.95, **LITERAL), {}),
        "safeguarded": (make_filter("aukf_fading", adapt="R", b=0.95), {}),
        "UKF, told wrong": (ukf, {}),
        "UKF, told right": (ukf, {"R": changing_R}),
    },
    {"q": 0.2, "Q": 0.4, "r": 0.3, "R": 1.0},
)

figure = Figure(figsize=(8, 4.5), layout="constrained")
axes = figure.add_subplot(title="Example 1: mean of the process noise", ylabel="estimate of q", ylim=(-0.2, 1.0))
axes.axhline(0.2, color="black", lw=1, label="truth")
for label in ("as printed", "safeguarded"):
    band(axes, first[label].noise["q"][..., 0], label)
finish(figure, "002_noise_mean.png")

figure = Figure(figsize=(12, 4.5), layout="constrained")
left, right = figure.subplots(1, 2)
left.set(title="Example 1: variance of the process noise", ylabel="estimate of Q", ylim=(-0.2, 1.8))
left.axhline(0.4, color="black", lw=1, label="truth")
right.set(title="Example 2: variance of the measurement noise", ylabel="estimate of R", ylim=(-0.5, 3.0))
right.step(k, [changing_R(i) for i in k], where="mid", color="black", lw=1, label="truth")
for axes in (left, right):
    axes.axhspan(-1, 0, color="black", alpha=0.08, lw=0)
for label in ("as printed", "safeguarded"):
    band(left, first[label].noise["Q"].reshape(STEPS, RUNS), label)
    band(right, second[label].noise["R"].reshape(STEPS, RUNS), label)
finish(figure, "002_noise_covariance.png")

figure = Figure(figsize=(13, 6.5), layout="constrained")
for column, (tracks, truth, state, title) in enumerate(
    (
        (first, one, 0, "Example 1: error of x1"),
        (first, one, 2, "Example 1: error of x3"),
        (second, two, 1, "Example 2: error of x2"),
    )
):
    above, below = figure.add_subplot(2, 3, 1 + column), figure.add_subplot(2, 3, 4 + column)
    for label in ("UKF, told wrong", "safeguarded", "UKF, told right"):
        error = (tracks[label].mean - truth.x)[..., state]
        if label != "UKF, told right":
            above.plot(k, error[:, 0], color=COLOUR[label], lw=0.8, label=f"{label}: one run")
        rms = np.sqrt(np.convolve(np.mean(error**2, axis=1), np.full(25, 1 / 25), mode="valid"))
        below.plot(k[12:-12], rms, color=COLOUR[label], lw=1.5, label=f"{label}: RMS of {RUNS} runs over 25 steps")
    above.set(title=title, ylabel="estimate - truth")
    above.set_ylim(top=1.5 * above.get_ylim()[1])
    below.set_ylabel("RMS of estimate - truth")
    below.set_ylim(top=below.get_ylim()[1] + 0.6 * np.diff(below.get_ylim())[0])
finish(figure, "002_state_error.png")
