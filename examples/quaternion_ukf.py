"""An unscented Kalman filter of a unit quaternion
===============================================

Attitude and gyro bias, in the filter's own text for vectors.

The state has seven numbers and six degrees of freedom. A chart says how a tangent vector of six leads from one state to another,
and `OnManifold` lets any filter of the zoo work in these tangents. The fixes are the directions of gravity and of the magnetic
field in body axes. At the start the attitude is known to 20 deg about each axis. The extended filter on the same chart is held
against a small-angle error filter written by hand. The NEES per degree of freedom holds each against the truth. It is 1 for a
filter that knows what it knows. The tangents of 20 deg claim too much, and the points do not.
"""

import numpy as np

from sins_env.attitude import conjugate, from_rotvec, multiply, skew, to_dcm
from solvers.filters import make_filter
from solvers.filters.charts import OnManifold
from solvers.types import Chart, Gaussian, Measurement, Transition

RUNS, EPOCHS, DT = 100, 40, 0.5
FIELDS = np.array([[0.0, 0.0, 1.0], [0.0, 0.5, -0.866]])  # unit vectors in n: against gravity, along the magnetic field
NOISE = 0.05  # of each component of a measured direction
P0 = np.diag([np.deg2rad(20.0) ** 2] * 3 + [np.deg2rad(1.0) ** 2] * 3)
Q = np.diag([np.deg2rad(0.3) ** 2 * DT] * 3 + [1e-10] * 3)
R = NOISE**2 * np.eye(6)


# --- the manifold: unit quaternions q_nb beside gyro biases ---------------------------------------------------------------
def rotation_vector(q):
    """Return the shortest rotation vector (..., 3), rad, of a unit quaternion (..., 4)."""
    q = np.where(q[..., :1] < 0.0, -q, q)
    sine = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    return q[..., 1:] * np.where(sine > 1e-12, 2.0 * np.arctan2(sine, q[..., :1]) / np.maximum(sine, 1e-12), 2.0)


def plus(x, d):
    return np.concatenate([multiply(x[..., :4], from_rotvec(d[..., :3])), x[..., 4:] + d[..., 3:]], axis=-1)


def minus(y, x):
    turned = rotation_vector(multiply(conjugate(x[..., :4]), y[..., :4]))
    return np.concatenate([turned, y[..., 4:] - x[..., 4:]], axis=-1)


CHART = Chart(plus, minus)


# --- the model: functions of states with seven numbers ---------------------------------------------------------------------
def turned_by(rate):
    """Return f, which turns the attitude by the measured rate (runs, 3) less the bias, for one epoch."""

    def f(x):
        w = rate.reshape(*rate.shape[:1], *(1,) * (x.ndim - 2), 3)  # runs, and points of runs
        return np.concatenate([multiply(x[..., :4], from_rotvec((w - x[..., 4:]) * DT)), x[..., 4:]], axis=-1)

    return f


def directions(x):
    """Return the fields (..., 6) in body axes."""
    body = FIELDS @ to_dcm(x[..., :4])  # rows C_nb' v
    return body.reshape(*x.shape[:-1], 6)


# --- a run of truth and measurements, and the filters ----------------------------------------------------------------------
rng = np.random.default_rng(3)
guess = np.concatenate([from_rotvec(rng.normal(0.0, 1.0, (RUNS, 3))), np.zeros((RUNS, 3))], axis=-1)
truth = [plus(guess, rng.multivariate_normal(np.zeros(6), P0, RUNS))]
rates, fixes = [], []
for k in range(EPOCHS):
    rate = 0.3 * np.sin(0.2 * k * DT + np.arange(3.0)) + np.zeros((RUNS, 3))
    w = np.sqrt(np.diag(Q)) * rng.standard_normal((RUNS, 6))
    rates.append(rate + truth[-1][:, 4:])
    truth.append(plus(turned_by(rates[-1])(truth[-1]), w))
    fixes.append(directions(truth[-1]) + NOISE * rng.standard_normal((RUNS, 6)))


def on_chart(name):
    """Return the estimates of a filter of the zoo on the chart, after each epoch."""
    flt = OnManifold(make_filter(name), CHART)
    b, found = flt.init(Gaussian(guess, P0)), []
    for rate, z in zip(rates, fixes, strict=True):
        b, _ = flt.step(b, Transition(turned_by(rate), Q, dt=DT), Measurement(z, directions, R))
        found.append(flt.estimate(b))
    return found


def by_hand():
    """Return the estimates of the multiplicative extended Kalman filter of the textbooks, which has small angles as errors."""
    x, P, found = guess, np.broadcast_to(P0, (RUNS, 6, 6)), []
    for rate, z in zip(rates, fixes, strict=True):
        F = np.broadcast_to(np.eye(6), P.shape).copy()
        F[:, :3, :3] = to_dcm(from_rotvec((x[:, 4:] - rate) * DT))
        F[:, :3, 3:] = -DT * np.eye(3)
        x, P = turned_by(rate)(x), F @ P @ F.mT + Q
        y = directions(x)
        H = np.zeros((RUNS, 6, 6))
        H[:, :3, :3], H[:, 3:, :3] = skew(y[:, :3]), skew(y[:, 3:])
        S = H @ P @ H.mT + R
        K = np.linalg.solve(S, H @ P).mT
        x, P = plus(x, (K @ (z - y)[..., None])[..., 0]), P - K @ S @ K.mT
        found.append(Gaussian(x, P))
    return found


def told(label, found):
    """Print what is left of the attitude's error, and the NEES per degree of freedom with its standard error."""
    e = np.array([minus(x, one.mean) for x, one in zip(truth[1:], found, strict=True)])
    nees = np.einsum("kri,krij,krj->kr", e, np.linalg.inv([one.cov for one in found]), e) / 6.0
    angle = np.degrees(np.sqrt((e[..., :3] ** 2).sum(axis=-1)))
    first, last = (np.sqrt((angle[k] ** 2).mean()) for k in (0, -1))
    spread = nees.mean(axis=0).std() / np.sqrt(RUNS)
    print(
        f"{label:32} attitude RMS {first:6.2f} deg after a fix, {last:5.3f} deg at the end;"
        f" median NEES {np.median(nees):.2f}, mean {nees.mean():.2f} +- {spread:.2f}"
    )


for name in ("ukf", "ekf"):
    told(f"{name} on the chart", on_chart(name))
told("small-angle filter by hand", by_hand())
