"""The CKF step of the house against filterpy's UKF on the same 10-state alignment step, in one run.

    python benchmarks/filterpy_ukf.py

Both predict through the exact large-angle epoch map and correct with a fix of two velocities; the script first checks that
both come to the same answer. filterpy calls its process function once per point with one state. It is measured twice: with
the NumPy function of the house (what the solver ``filterpy_ukf`` does, and any user whose model is written with arrays), and
with a hand-written scalar version in plain floats, the fastest that one can give it. CPU time, one thread, best of several.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from threadpoolctl import threadpool_limits

from sins_env import attitude, earth
from sins_env.memory import keep_freed_memory
from solvers.filters import make_filter
from solvers.pipeline.epoch_map import ACCEL_UNIT, GYRO_UNIT
from solvers.pipeline.error_state import AlignmentErrors
from solvers.pipeline.strapdown import EpochMotion
from solvers.types import Gaussian, Linear, Measurement

LATITUDE = math.radians(39.96)


def an_epoch(runs: int) -> EpochMotion:
    """Epochs of a swaying INS, slightly different in each run; ``runs`` 0: one run, no run axis."""
    rng = np.random.default_rng(0)
    batch = (runs,) if runs else ()
    model = earth.get("wgs84")
    C = attitude.to_dcm(attitude.from_euler(0.5, *(0.1 * rng.standard_normal((2, *batch)))))
    vel = rng.standard_normal((*batch, 3))
    transport = earth.transport_matrix(model, LATITUDE)
    force = 0.1 * (np.array([0.02, 0.01, 9.8]) + 0.01 * rng.standard_normal((*batch, 3)))
    rate_en = np.matmul(transport, vel[..., None])[..., 0]
    return EpochMotion(0.1, C, force, vel, earth.rate_n(model, LATITUDE), rate_en, transport)


def scalar_map(m: EpochMotion) -> Callable[[np.ndarray, float], np.ndarray]:
    """The epoch map of one run in plain floats."""
    h = m.dt
    A, B = (h * ACCEL_UNIT * m.C).tolist(), (h * GYRO_UNIT * m.C).tolist()
    fE, fN, fU = m.dvel_n.tolist()
    wE, wN, wU = (h * (m.rate_ie + m.rate_en)).tolist()
    VE, VN, VU = m.vel.tolist()
    coriolis = h * float((2 * m.rate_ie + m.rate_en)[2])
    TN, TE, TU = h * float(m.transport[0, 1]), h * float(m.transport[1, 0]), h * float(m.transport[2, 0])

    def fx(x: np.ndarray, dt: float) -> np.ndarray:
        dE, dN, px, py, pz, ax, ay, ex, ey, ez = x.tolist()
        sx, cx, sy, cy, sz, cz = math.sin(px), math.cos(px), math.sin(py), math.cos(py), math.sin(pz), math.cos(pz)
        a, b, c = cy * cz - sy * sx * sz, cy * sz + sy * sx * cz, -sy * cx
        d, e, f = -cx * sz, cx * cz, sx
        g, i, j = sy * cz + cy * sx * sz, sy * sz - cy * sx * cz, cy * cx
        u0 = fE - A[0][0] * ax - A[0][1] * ay
        u1 = fN - A[1][0] * ax - A[1][1] * ay
        u2 = fU - A[2][0] * ax - A[2][1] * ay
        gE, gN = fE - (a * u0 + d * u1 + g * u2), fN - (b * u0 + e * u1 + i * u2)
        vE, vN = dE + 0.5 * gE, dN + 0.5 * gN
        tE, tN, tU = TN * vN, TE * vE, TU * vE
        w0, w1, w2 = wE - tE, wN - tN, wU - tU
        r0 = wE - (a * w0 + b * w1 + c * w2) - (B[0][0] * ex + B[0][1] * ey + B[0][2] * ez)
        r1 = wN - (d * w0 + e * w1 + f * w2) - (B[1][0] * ex + B[1][1] * ey + B[1][2] * ez)
        r2 = wU - (g * w0 + i * w1 + j * w2) - (B[2][0] * ex + B[2][1] * ey + B[2][2] * ez)
        k0, k1, k2 = r1 * u2 - r2 * u1, r2 * u0 - r0 * u2, r0 * u1 - r1 * u0
        gE -= 0.5 * (a * k0 + d * k1 + g * k2)
        gN -= 0.5 * (b * k0 + e * k1 + i * k2)
        k = (cy * r2 - sy * r0) / cx
        return np.array(
            [
                dE + gE + coriolis * vN - tN * VU + tU * (VN - vN),
                dN + gN - coriolis * vE - tU * (VE - vE) + tE * VU,
                px + cy * r0 + sy * r2,
                py + r1 - sx * k,
                pz + k,
                ax, ay, ex, ey, ez,
            ]
        )  # fmt: skip

    return fx


P0 = np.diag(np.square([0.2, 0.2, 0.017, 0.017, 0.26, 0.1, 0.1, 0.02, 0.02, 0.02]))
Q = np.diag([1e-10] * 2 + [1e-12] * 3 + [0.0] * 5)
R = 0.01 * np.eye(2)


def array_map(m: EpochMotion) -> Callable[[np.ndarray, float], np.ndarray]:
    f = AlignmentErrors().transition(m, Q).f
    return lambda x, dt: f(x)


def filterpy_ukf(m: EpochMotion, fx: Callable[[np.ndarray, float], np.ndarray]) -> UnscentedKalmanFilter:
    points = MerweScaledSigmaPoints(10, alpha=1.0, beta=0.0, kappa=0.0)
    ukf = UnscentedKalmanFilter(10, 2, m.dt, hx=lambda x: x[:2], fx=fx, points=points)
    ukf.P, ukf.Q, ukf.R = P0.copy(), Q, R
    return ukf


def ours(runs: int) -> Callable[[], Gaussian]:
    """A step of the CKF that goes on from the last."""
    m, batch = an_epoch(runs), (runs,) if runs else ()
    ckf = make_filter("ckf")
    state = {"belief": ckf.init(Gaussian(np.zeros((*batch, 10)), P0), None)}
    H, z = Linear(np.eye(2, 10)), np.full((*batch, 2), 0.05)

    def step() -> Gaussian:
        transition = AlignmentErrors().transition(m, Q)  # its construction belongs to the step
        state["belief"], _ = ckf.step(state["belief"], transition, Measurement(z, H, R))
        return ckf.estimate(state["belief"])

    return step


def best(step: Callable[[], object], repeat: int, times: int = 7) -> float:
    """Seconds of CPU per call, best of ``times`` rounds."""
    step()
    seconds = []
    for _ in range(times):
        begin = time.process_time()
        for _ in range(repeat):
            step()
        seconds.append((time.process_time() - begin) / repeat)
    return min(seconds)


def peer_step(fx: Callable[[np.ndarray, float], np.ndarray]) -> Callable[[], UnscentedKalmanFilter]:
    """A step of filterpy's UKF that goes on from the last."""
    ukf = filterpy_ukf(an_epoch(0), fx)

    def step() -> UnscentedKalmanFilter:
        ukf.predict()
        ukf.update(np.full(2, 0.05))
        return ukf

    return step


def main() -> None:
    keep_freed_memory()
    with threadpool_limits(1):
        m = an_epoch(0)
        arrays, scalars, mine = peer_step(array_map(m)), peer_step(scalar_map(m)), ours(0)
        for _ in range(20):
            estimate = mine()
            sigma = np.sqrt(np.diagonal(estimate.cov))
            for peer in (arrays(), scalars()):
                assert np.abs((peer.x - estimate.mean) / sigma).max() < 1e-6, "they do not compute the same thing"
        references = {"arrays": best(arrays, 100), "scalars": best(scalars, 200)}
        for name, seconds in references.items():
            print(f"filterpy UnscentedKalmanFilter, model in {name:7s}  {seconds * 1e6:8.1f} us per step")
        for runs in (0, 64, 256, 1024):
            seconds = best(ours(runs), 300 if runs == 0 else 20) / max(runs, 1)
            ratios = "  ".join(f"{value / seconds:6.1f} ({name})" for name, value in references.items())
            print(f"ckf, {max(runs, 1):5d} runs  {seconds * 1e6:8.2f} us per step and run; times filterpy: {ratios}")


if __name__ == "__main__":
    main()
