"""kalman-py: its Kalman, extended and unscented filters, on NumPy and on JAX.

On JAX it filters whole records: its constructor turns a traced mean into NumPy, so that no compiled call can take one step.
Its f has the arguments x and dt. The number of the epoch takes the place of dt, the only argument that changes at each step.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from kalman_py import ExtendedKalmanFilter, KalmanFilter, UnscentedKalmanFilter

from peers.contest import UKF, Block, Entry, looped
from peers.plain_map import advance
from peers.problem import OneRun, Problem
from solvers.types import Gaussian

DISTRIBUTION = "kalman-py"


def kf(problem: Problem, run: OneRun) -> Gaussian:
    """Filter one run with KalmanFilter."""
    o = KalmanFilter(run.F[0], problem.H, problem.Q, problem.R, problem.mean, problem.P0)
    for F, z in zip(run.F, run.z, strict=True):
        o.predict(F=F)
        o.update(z)
    return Gaussian(o.x, o.P)


def ekf(problem: Problem, run: OneRun) -> Gaussian:
    """Filter one run with ExtendedKalmanFilter on NumPy."""
    o = ExtendedKalmanFilter(
        lambda x, k: run.plain[int(k)](x),
        lambda x: x[:2],
        *(problem.Q, problem.R, problem.mean, problem.P0),
        jac_f=lambda x, k: run.slope(int(k), x)[1],
        jac_h=lambda x: problem.H,
    )
    return last(o.filter(run.z, np.arange(problem.steps)))


def ukf(problem: Problem, run: OneRun) -> Gaussian:
    """Filter one run with UnscentedKalmanFilter on NumPy."""
    o = UnscentedKalmanFilter(
        lambda x, k: run.arrays[int(k)](x),
        lambda x: x[..., :2],
        *(problem.Q, problem.R, problem.mean, problem.P0),
        **UKF,
        vectorized=True,
    )
    return last(o.filter(run.z, np.arange(problem.steps)))


def last(result: Any) -> Gaussian:
    """Return the estimate at the end."""
    return Gaussian(result.means[-1], result.covs[-1])


def traced(epochs: jax.Array) -> Callable[[jax.Array, jax.Array], jax.Array]:
    """Return f(x, number of the epoch) for JAX."""
    return lambda x, k: jnp.stack(advance(x, epochs[k.astype(int)], jnp))


def seen(x: jax.Array) -> jax.Array:
    """Return h(x), the two velocities."""
    return x[:2]


def ekf_jax(problem: Problem, runs: int) -> Block:
    """Make the block of ExtendedKalmanFilter on JAX, with ``jax.vmap`` over the runs and JAX's derivatives."""

    def one(epochs: jax.Array, z: jax.Array) -> Gaussian:
        o = ExtendedKalmanFilter(traced(epochs), seen, problem.Q, problem.R, problem.mean, problem.P0)
        return last(o.filter(z, np.arange(problem.steps), backend="jax"))

    if runs == 1:
        alone = jax.jit(one)
        epochs, z = jnp.asarray(problem.epochs[:, 0]), jnp.asarray(problem.z[:, 0])
        return lambda: with_run_axis(alone(epochs, z))
    many = jax.jit(jax.vmap(one, in_axes=1))
    epochs, z = jnp.asarray(problem.epochs[:, :runs]), jnp.asarray(problem.z[:, :runs])
    return lambda: ready(many(epochs, z))


def ukf_jax(problem: Problem, runs: int) -> Block:
    """Make the block of UnscentedKalmanFilter on JAX, one run after another.

    Its check of the covariances at the end cannot be traced, so neither jit nor vmap accepts it. It compiles for each function,
    so the f of each run is made once.
    """
    filters = [
        UnscentedKalmanFilter(
            traced(jnp.asarray(problem.epochs[:, i])), seen, problem.Q, problem.R, problem.mean, problem.P0, **UKF
        )
        for i in range(runs)
    ]

    def block() -> Gaussian:
        ends = [last(o.filter(problem.z[:, i], np.arange(problem.steps), backend="jax")) for i, o in enumerate(filters)]
        return Gaussian(np.stack([end.mean for end in ends]), np.stack([end.cov for end in ends]))

    return block


def with_run_axis(end: Gaussian) -> Gaussian:
    """Return an estimate of one run as NumPy arrays with a run axis."""
    return Gaussian(np.asarray(end.mean)[None], np.asarray(end.cov)[None])


def ready(end: Gaussian) -> Gaussian:
    """Return an estimate as NumPy arrays, which waits for JAX to finish."""
    return Gaussian(np.asarray(end.mean), np.asarray(end.cov))


def entries() -> list[Entry]:
    """Return the filters of the package."""
    return [
        Entry("KF", "NumPy", "F given", looped(kf)),
        Entry("EKF", "NumPy", "f and Jacobian in NumPy", looped(ekf)),
        Entry("UKF", "NumPy", "all points at once", looped(ukf)),
        Entry("EKF", "JAX", "a scan, vmap over runs", ekf_jax, batched=True, compiled=True, stepped=False),
        Entry("UKF", "JAX", "a scan", ukf_jax, compiled=True, stepped=False),
    ]
