"""Points that fill space evenly
=============================

What such points are worth to a Gaussian particle filter, in two figures.

The first shows pseudo-random beside randomised quasi-random points, uniform and Gaussian, as figures 5.2 and 5.3 of the thesis
do. The second shows the error of one filter step against the exact result of the Kalman filter.
"""

import numpy as np
from matplotlib.figure import Figure
from scipy.special import ndtr

from solvers.filters import make_filter
from solvers.filters.particles.random_points import normals, run_keys
from solvers.types import Gaussian, Linear, Measurement, Transition

POINTS, RUNS, NUMBERS = 2048, 100, [64, 128, 256, 512, 1024, 2048, 4096]

# --- the points ---------------------------------------------------------------------------------------------------------
figure = Figure(figsize=(8.6, 8.6), layout="constrained")
axes = figure.subplots(2, 2)
key = run_keys(np.random.default_rng(1), ())
kinds = {"pseudo-random": "random", "Halton from a random start": "halton_start"}
for column, (title, kind) in zip(axes.T, kinds.items(), strict=True):
    N = normals(kind, key, 0, 0, POINTS, 2)
    for ax, x in zip(column, (ndtr(N), N), strict=True):
        ax.plot(*x.T, ".", markersize=2.2, color="C0" if kind == "random" else "C1")
        ax.set_aspect("equal")
    column[0].set(title=f"{title}, {POINTS} points", xlim=(0, 1), ylim=(0, 1), xlabel="$u_1$", ylabel="$u_2$")
    column[1].set(xlim=(-4, 4), ylim=(-4, 4), xlabel=r"$x_1 = \phi^{-1}(u_1)$", ylabel=r"$x_2 = \phi^{-1}(u_2)$")
    empty = np.mean(np.histogram2d(*ndtr(N).T, bins=32, range=[[0, 1]] * 2)[0] == 0)
    print(f"{title}: {100 * empty:.0f} % of the 1024 cells of a 32 x 32 grid are empty")
figure.savefig("points.png", dpi=120)

# --- the filter's error against the number of particles -----------------------------------------------------------------
dt = 0.1
F = np.array([[1, dt, 0, 0], [0, 1, 0, 0], [0, 0, 1, dt], [0, 0, 0, 1]])  # position and velocity, east and north
Q, H, R = np.diag([0.01, 0.04, 0.01, 0.04]), np.eye(4)[::2], np.eye(2)
prior, z = Gaussian(np.zeros((RUNS, 4)), np.diag([1.0, 4.0, 1.0, 4.0])), np.tile([1.2, -0.8], (RUNS, 1))


def step(name, **settings):
    """Return the estimates after one step, from RUNS independent draws of a particle filter or from an exact filter."""
    flt = make_filter(name, **settings)
    b = flt.init(prior, [np.random.default_rng(i) for i in range(RUNS)])
    b, _ = flt.step(b, Transition(lambda x: x @ F.T, Q), Measurement(z, Linear(H), R))
    return flt.estimate(b)


exact = step("ckf")
whiten = np.linalg.inv(np.linalg.cholesky(exact.cov[0]))
filters = {
    "gpf as published: plain draws, every state weighed": ("gpf", {"matching": "none", "marginal": False}),
    "gpf: mirrored and matched, weighs what the fix sees": ("gpf", {}),
    "rqmc_gpf, Halton from a random start": ("rqmc_gpf", {"points": "halton_start"}),
    "rqmc_gpf, scrambled Sobol": ("rqmc_gpf", {"points": "sobol"}),
}
figure = Figure(figsize=(7.6, 5.2), layout="constrained")
ax = figure.add_subplot()
for (label, (name, settings)), marker in zip(filters.items(), "osv^", strict=True):
    rms = [np.sqrt(np.mean(((step(name, particles=M, **settings).mean - exact.mean) @ whiten.T) ** 2)) for M in NUMBERS]
    slope = np.polyfit(np.log(NUMBERS), np.log(rms), 1)[0]
    ax.loglog(NUMBERS, rms, marker=marker, label=f"{label}: slope {slope:.2f}")
    print(f"{label}: {rms[0]:.4f} with {NUMBERS[0]} particles, {rms[-1]:.5f} with {NUMBERS[-1]}, slope {slope:.2f}")
guide = np.array(NUMBERS, dtype=float)
ax.loglog(guide, 0.16 * np.sqrt(guide[0] / guide), ":", color="0.5", label=r"$1/\sqrt{M}$")
ax.set_xticks(NUMBERS, [f"{M:,}" for M in NUMBERS])
ax.minorticks_off()
ax.set(xlabel="particles M", ylabel="RMS error of the mean, in posterior standard deviations")
ax.set_title(f"One step of a linear problem, {RUNS} draws: distance from the Kalman filter")
ax.grid(alpha=0.3)
ax.legend(fontsize=8.5, loc="lower left")
figure.savefig("particles.png", dpi=120)
