"""Random problems for the filters, made of plain arrays."""

import math
from types import SimpleNamespace

import numpy as np


def spd(rng, *shape):
    """Positive definite matrices (*batch, n, n), condition number below about 100 n."""
    *batch, n = shape
    A = rng.standard_normal((*batch, n, n))
    return A @ np.swapaxes(A, -1, -2) / n + 0.1 * np.eye(n)


def linear(seed, n, m, batch=(), steps=50, missing=0.3):
    """A stable random system with different data in every run; some epochs have no fix."""
    rng = np.random.default_rng(seed)
    F = rng.standard_normal((*batch, n, n)) / math.sqrt(n) * 0.9
    fix = rng.random(steps) > missing
    return SimpleNamespace(
        batch=batch,
        x=rng.standard_normal((*batch, n)),
        P=spd(rng, *batch, n),
        F=F,
        c=0.1 * rng.standard_normal((*batch, n)),
        Q=0.3 * spd(rng, *batch, n),
        H=rng.standard_normal((*batch, m, n)),
        d=rng.standard_normal((*batch, m)),
        R=spd(rng, *batch, m),
        z=[3.0 * rng.standard_normal((*batch, m)) if f else None for f in fix],
    )


def run_of(p, i):
    """The arrays of run ``i`` of a batched problem, in the order that ``kalman`` takes."""
    z = [None if z is None else z[i] for z in p.z]
    return (*(a[i] for a in (p.x, p.P, p.F, p.c, p.Q, p.H, p.d, p.R)), z)


def swing(x):
    """A smooth nonlinear map (..., n) -> (..., n), n >= 3: a pendulum's time step and slow neighbours."""
    y = 0.98 * x
    y[..., 0] += 0.1 * x[..., 1]
    y[..., 1] -= 0.3 * np.sin(x[..., 0]) + 0.05 * x[..., 2] ** 2
    y[..., 2] += 0.1 * np.cos(x[..., 0]) * x[..., 1]
    return y


def swing_jacobian(x):
    """(..., n, n), by hand."""
    n = x.shape[-1]
    J = np.zeros((*x.shape, n))
    J[..., range(n), range(n)] = 0.98
    J[..., 0, 1] += 0.1
    J[..., 1, 0] -= 0.3 * np.cos(x[..., 0])
    J[..., 1, 2] -= 0.1 * x[..., 2]
    J[..., 2, 0] -= 0.1 * np.sin(x[..., 0]) * x[..., 1]
    J[..., 2, 1] += 0.1 * np.cos(x[..., 0])
    return J


def look(x):
    """A smooth nonlinear measurement (..., n) -> (..., 2)."""
    return np.stack([np.sin(x[..., 0]) + x[..., 2], x[..., 1] + 0.2 * x[..., 0] ** 2], axis=-1)
