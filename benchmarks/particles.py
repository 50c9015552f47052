"""Cost of particles: one step of each particle filter as a multiple of a step of the UKF.

    python benchmarks/particles.py

The step is that of the 10-state alignment with the exact epoch map for large angles, for one run and for 64 runs at once. The
times are CPU times of one thread, the best of several. The thesis states 10 times its UKF for its CGPF with 10,000 particles,
in MATLAB.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from threadpoolctl import threadpool_limits

from sins_env import attitude, earth
from sins_env.evaluation.estimators.memory import keep_freed_memory
from solvers.filters import make_filter
from solvers.pipeline.errors.alignment import AlignmentErrors
from solvers.pipeline.strapdown import EpochMotion
from solvers.types import Gaussian, Linear, Measurement

LATITUDE = math.radians(39.96)
#: Prior, process noise and measurement noise of the ten states, in their units.
P0 = np.diag(np.square([0.2, 0.2, 0.017, 0.017, 0.26, 0.1, 0.1, 0.02, 0.02, 0.02]))
Q = np.diag([1e-10] * 2 + [1e-12] * 3 + [0.0] * 5)
R = 0.01 * np.eye(2)

#: Name of the filter, its settings, and its label in the table.
CASES = [
    *(
        (name, {"particles": M}, f"{name}, {M:,} particles")
        for M in (1000, 10_000)
        for name in ("gpf", "rqmc_gpf", "cgpf")
    ),
    ("gpf", {"particles": 10_000, "marginal": False}, "gpf, 10,000 particles, all states weighed"),
    ("cgpf", {"particles": 10_000, "marginal": False}, "cgpf, 10,000 particles, all states weighed"),
    ("gpf", {}, "gpf, 2,000 particles (default)"),
    ("pf", {}, "pf, 2,000 particles (default)"),
    ("upf", {}, "upf, 200 particles (default)"),
    ("hepf", {}, "hepf, 200 particles (default)"),
]


def an_epoch(runs: int) -> EpochMotion:
    """Return an epoch of a swaying INS, slightly different in each run; ``runs`` 0 gives one run without a run axis."""
    rng = np.random.default_rng(0)
    batch = (runs,) if runs else ()
    model = earth.get("wgs84")
    C = attitude.to_dcm(attitude.from_euler(0.5, *(0.1 * rng.standard_normal((2, *batch)))))
    vel = rng.standard_normal((*batch, 3))
    transport = earth.transport_matrix(model, LATITUDE)
    force = 0.1 * (np.array([0.02, 0.01, 9.8]) + 0.01 * rng.standard_normal((*batch, 3)))
    rate_en = np.matmul(transport, vel[..., None])[..., 0]
    slope = earth.gravity_slope(model, LATITUDE)
    return EpochMotion(0.1, C, force, vel, earth.rate_n(model, LATITUDE), rate_en, transport, slope)


def best(step: Callable[[], object], count: int, times: int = 7) -> float:
    """Return the CPU seconds of a call: the least, over ``times`` repetitions, of the mean of ``count`` calls."""
    step()
    seconds = []
    for _ in range(times):
        begin = time.process_time()
        for _ in range(count):
            step()
        seconds.append((time.process_time() - begin) / count)
    return min(seconds)


def a_step(name: str, runs: int, settings: dict) -> Callable[[], Gaussian]:
    """Return a function that takes the next step; with ``runs`` 0 there is one run and no run axis."""
    batch = (runs,) if runs else ()
    flt = make_filter(name, **settings)
    state = {"belief": flt.init(Gaussian(np.zeros((*batch, 10)), P0), np.random.default_rng(0))}
    motion, me = an_epoch(runs), Measurement(np.full((*batch, 2), 0.05), Linear(np.eye(2, 10)), R)

    def step() -> Gaussian:
        state["belief"], _ = flt.step(state["belief"], AlignmentErrors().transition(motion, Q), me)
        return flt.estimate(state["belief"])

    return step


def overhead_of_streams() -> str:
    """Compare the time to set one Philox object to a run's stream with that to make a generator for each run."""
    bits = np.random.Philox(0)
    state = bits.state
    seconds = []
    for act in (lambda: setattr(bits, "state", state), lambda: np.random.Generator(np.random.Philox(key=1, counter=2))):
        begin = time.process_time()
        for _ in range(2000):
            act()
        seconds.append((time.process_time() - begin) / 2000)
    return f"a run's stream: {seconds[0] * 1e6:.1f} us by setting a state, {seconds[1] * 1e6:.1f} us as a new generator"


def main() -> None:
    keep_freed_memory()
    with threadpool_limits(1):
        print(overhead_of_streams())
        print(f"{'':45s} {'1 run, ms':>10s} {'times ukf':>10s} {'64 runs, ms each':>17s} {'times ukf':>10s}")
        ukf = {runs: best(a_step("ukf", runs, {}), 100 if not runs else 20) / max(runs, 1) for runs in (0, 64)}
        print(f"{'ukf':45s} {ukf[0] * 1e3:10.3f} {1:10.1f} {ukf[64] * 1e3:17.4f} {1:10.1f}")
        for name, settings, label in CASES:
            one = best(a_step(name, 0, settings), 5, times=5)
            many = best(a_step(name, 64, settings), 1, times=3) / 64
            print(f"{label:45s} {one * 1e3:10.3f} {one / ukf[0]:10.1f} {many * 1e3:17.4f} {many / ukf[64]:10.1f}")


if __name__ == "__main__":
    main()
