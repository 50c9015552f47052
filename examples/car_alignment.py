"""People disturb a parked car
===========================

The effect on the heading while it is aligned, beside the same car left alone.

A person gets in before the filters have converged, and out after that. Both cars of a pair have the same sensors and the same
noise, so only the disturbance makes them differ. The table 6.interference of ``sins-env reproduce`` has more kinds of
disturbance.
"""

import gymnasium
import numpy as np
from matplotlib.figure import Figure

import solvers
from sins_env import attitude

RUNS, COARSE_S, DURATION_S, EPOCH_S = 8, 90.0, 300.0, 0.2
EVENTS = [{"t": 120.0, "kind": "in"}, {"t": 230.0, "kind": "out"}]
FILTERS = ("ukf", "mixed_hinf_ukf")

usual = {
    "heading_deg": -26.3,
    "coarse": COARSE_S,
    "duration": DURATION_S,
    "epoch": EPOCH_S,
    "n_sub": 20,
    "reveal_truth": True,
}
cars = [gymnasium.make_vec("SINS/AlignVehicle-v0", RUNS, events=events, **usual) for events in ([], EVENTS)]
estimators = [solvers.make(name, coarse="svd") for name in FILTERS]
for estimator in estimators:  # all pairs are one batch: RUNS cars left alone, then RUNS disturbed ones
    estimator.reset(cars[0].unwrapped.task, [np.random.default_rng(i) for i in range(2 * RUNS)], 2 * RUNS)

observations = [car.reset(seed=1)[0] for car in cars]
steps = cars[0].unwrapped.task.num_epochs
azimuth = np.empty((len(FILTERS), 2, RUNS, steps))  # errors, deg
for k in range(steps):
    both = {key: np.concatenate([obs[key] for obs in observations]) for key in observations[0]}
    answers = [estimator.step(both).reshape(2, RUNS, 4) for estimator in estimators]
    for which, car in enumerate(cars):
        observations[which], *_, info = car.step(answers[0][which])
        phi = [attitude.misalignment(answer[which], info["truth"]["q_nb"]) for answer in answers]
        azimuth[:, which, :, k] = np.degrees(phi)[..., 2]

t = EPOCH_S * (1 + np.arange(steps))
quiet, disturbed = azimuth[:, 0], azimuth[:, 1]
effect = np.abs(disturbed - quiet)
for name, found in zip(FILTERS, effect, strict=True):
    first, last = (found[:, (t > event["t"]) & (t <= event["t"] + 60)].max(axis=1) for event in EVENTS)
    print(
        f"{name:>15}: at most {np.median(first):.3f} deg before convergence, {np.median(last):.4f} deg after it, "
        f"{np.median(found[:, -1]):.4f} deg left at the end (median of {RUNS} pairs)"
    )

figure = Figure(figsize=(8.6, 7.0), layout="constrained")
top, bottom = figure.subplots(2, 1, sharex=True)
fine = t > COARSE_S
for i, (name, color) in enumerate(zip(FILTERS, ("C0", "C1"), strict=True)):
    top.plot(t, np.sqrt(np.mean(disturbed[i] ** 2, axis=0)), color=color, label=f"{name}, disturbed")
    top.plot(t, np.sqrt(np.mean(quiet[i] ** 2, axis=0)), ":", color=color, label=f"{name}, left alone")
    bottom.fill_between(t[fine], *np.percentile(effect[i][:, fine], (10, 90), axis=0), color=color, alpha=0.2, lw=0)
    bottom.semilogy(t[fine], np.median(effect[i][:, fine], axis=0), color=color, label=name)
top.set(
    ylim=(0, 0.6),
    ylabel="azimuth error, deg RMS",
    title=f"A parked car, {RUNS} runs: fine alignment from {COARSE_S:g} s on",
)
bottom.set(ylim=(1e-5, 1), xlim=(0, DURATION_S), xlabel="time, s", ylabel="|difference|, deg: median, 10 to 90 %")
for ax, where in ((top, "lower left"), (bottom, "upper left")):
    for event in EVENTS:
        ax.axvline(event["t"], color="0.5", lw=0.8)
        ax.annotate(f" person {event['kind']}", (event["t"], 0.93), xycoords=("data", "axes fraction"), fontsize=8.5)
    ax.grid(alpha=0.3)
    ax.legend(fontsize=8.5, loc=where, ncols=2)
figure.savefig("car_alignment.png", dpi=120)
