"""The posterior of a whole navigation in one piece: Gauss-Newton over the states of all epochs, dense, for one run.

The unknowns are 15 errors of each state: misalignment, velocity, position, gyro and accelerometer bias, in SI units. What they
grow by is the difference of two strapdown runs, so no error model, filter or smoother is used. Derivatives are differences.
"""

import numpy as np
from scipy import linalg

from sins_env import attitude, earth
from sins_env.types import NavState
from solvers.pipeline.strapdown import Strapdown, StrapdownState, end_rate

SCALE = np.repeat([1e-3, 1e-2, 1.0, 1e-6, 1e-4], 3)  #: steps of the differences are STEP of these
STEP = 1e-2


def apart(model, a, b):
    """Errors (..., 9) of state a against b: C_a = C(phi) C_b in the convention of the package."""
    position = earth.offset(model, b.pos, a.pos)
    return np.concatenate([attitude.misalignment(a.q_nb, b.q_nb), a.vel - b.vel, position], axis=-1)


def without(model, nav, bias, e):
    """The state and the biases (6,) whose estimate is ``nav`` and ``bias``, if the errors of this are e (..., 15)."""
    C = np.swapaxes(attitude.misalignment_dcm(e[..., :3]), -1, -2) @ attitude.to_dcm(nav.q_nb)
    pos = earth.displace(model, nav.pos, -e[..., 6:9])
    return NavState(attitude.from_dcm(C), nav.vel - e[..., 3:6], pos), bias + e[..., 9:]


class Posterior:
    """States at 0 ... T with the covariance of their errors, from increments and fixes (v, p, or NaN where parts are missing)."""

    def __init__(self, task, start, dtheta, dvel, fixes, Q, iterations=6):
        self.task, self.model = task, earth.get(task.site.earth)
        self.strapdown = Strapdown(self.model, task.epoch_s, task.n_sub, task.site.pos, hold_position=False)
        self.start, self.dtheta, self.dvel, self.fixes = start, dtheta, dvel, fixes
        self.P0 = np.linalg.inv(np.linalg.cholesky(task.prior.P0))
        self.Q = np.linalg.inv(np.linalg.cholesky(Q))
        self.R = 1.0 / np.sqrt(np.diagonal(task.prior.R))
        self.navs, self.bias = [start], np.zeros((len(dtheta) + 1, 6))
        for k in range(len(dtheta)):
            self.navs.append(self.after(k, self.navs[-1], self.bias[k]))
        for _ in range(iterations):
            self.improve()

    def after(self, k, nav, bias):
        h = self.task.epoch_s / self.task.n_sub
        w, f = self.dtheta[k] - h * bias[..., None, :3], self.dvel[k] - h * bias[..., None, 3:]
        return self.strapdown.advance(StrapdownState(nav, None), w, f)[0].nav

    def seen(self, k, nav, bias):
        """Antenna minus fix at the end of epoch k, whitened; parts that are missing are zero."""
        C, arm = attitude.to_dcm(nav.q_nb), np.asarray(self.task.gps.lever_arm_m)
        h = self.task.epoch_s / self.task.n_sub
        rate = end_rate(self.dtheta[k] - h * bias[..., None, :3], self.task.epoch_s)
        about = C @ (np.cross(rate, arm))[..., None]
        ie = np.cross(earth.rate_n(self.model, self.task.site.latitude), (C @ arm))
        vel, pos = self.fixes[k]
        off = np.concatenate(
            [nav.vel + about[..., 0] - ie - vel, earth.offset(self.model, pos, nav.pos) + C @ arm], axis=-1
        )
        return np.where(np.isnan(off), 0.0, off) * self.R

    def chunk(self, k, e):
        """Whitened residuals of epoch k for errors e (..., 30) of the states k and k + 1: of growth, and of the fix."""
        a, b = (without(self.model, self.navs[k + i], self.bias[k + i], e[..., 15 * i : 15 * i + 15]) for i in (0, 1))
        grown = self.after(k, *a)
        w = np.concatenate([apart(self.model, grown, b[0]), b[1] - a[1]], axis=-1)
        return np.concatenate([w @ self.Q.T, self.seen(k, *b)], axis=-1)

    def first(self, e):
        nav, bias = without(self.model, self.navs[0], self.bias[0], e)
        return np.concatenate([apart(self.model, self.start, nav), bias], axis=-1) @ self.P0.T

    def improve(self):
        """Take one Gauss-Newton step, and keep the covariance."""
        T = len(self.dtheta)
        A, b = np.zeros((15 * (T + 1), 15 * (T + 1))), np.zeros(15 * (T + 1))
        parts = [(slice(0, 15), self.first)]
        parts += [(slice(15 * k, 15 * k + 30), lambda e, k=k: self.chunk(k, e)) for k in range(T)]
        for where, residual in parts:
            n = where.stop - where.start
            step = np.diag(np.tile(STEP * SCALE, n // 15))
            r, up, down = residual(np.zeros((1, n)))[0], residual(step), residual(-step)
            J = ((up - down) / (2 * np.diagonal(step)[:, None])).T
            A[where, where] += J.T @ J
            b[where] += J.T @ r
        scale = np.tile(SCALE, T + 1)
        unit = linalg.cho_factor(A * np.outer(scale, scale))
        e = (-scale * linalg.cho_solve(unit, scale * b)).reshape(T + 1, 15)
        whole = linalg.cho_solve(unit, np.eye(len(b))) * np.outer(scale, scale)
        self.cov = np.array([whole[15 * k : 15 * k + 15, 15 * k : 15 * k + 15] for k in range(T + 1)])
        moved = [without(self.model, nav, bias, one) for nav, bias, one in zip(self.navs, self.bias, e, strict=True)]
        self.navs, self.bias = [nav for nav, _ in moved], np.array([bias for _, bias in moved])
