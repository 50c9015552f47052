"""Equivariant coordinates: the right-invariant errors, and biases that turn with the INS.

The symmetry is the semi-direct product of SE_2(3) with se(3), which acts on the INS's state X and on its biases. Invariant
coordinates leave the biases out of the group. With delta the biases left in the INS's input, in body axes, the errors are

    Exp(xi) = X_hat X^-1,   Ad delta = J_l(xi) beta,   Ad = [C_hat, 0; v_hat x C_hat, C_hat]

in the order gyro, accelerometer. J_l is the left Jacobian of SE(3). These are the normal coordinates of the group. On a flat
earth at rest xi' = A xi + beta exactly, and all that is not linear is in the growth of beta, in second order. Feedback of an
estimate turns the biases along with the attitude.

In a closed loop xi is zero whenever the tangent is taken. There the coordinates are a linear change of the invariant ones, so
an extended Kalman filter predicts and corrects alike in both. They differ in what a correction of many degrees does to the
biases and to their covariance.
Source: Fornasier, Ge, van Goor, Mahony & Weiss (2023), arXiv:2309.03765, the symmetry "SD"; error and reset with right and left
as in :mod:`solvers.pipeline.errors.invariant`; docs/mathematics/error_models.md#equivariant-coordinates.
"""

from __future__ import annotations

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.states import Layout
from sins_env.types import NavState
from solvers.pipeline.errors import group_slopes
from solvers.pipeline.errors.invariant import Chart, Invariant
from solvers.pipeline.errors.model import ACCEL_UNIT, GYRO_UNIT
from solvers.pipeline.errors.navigation import STATES
from solvers.pipeline.strapdown import EpochMotion

UNIT = GYRO_UNIT / ACCEL_UNIT  #: factor of a velocity that turns deg/h into mg
TWIST = STATES.only("phi", "dv")  #: the errors that act on the biases
TERMS = 20  #: terms of the series of a Jacobian; for angles up to pi the rest is below 1e-9


class Equivariant(Invariant):
    """Equivariant errors of the model ``NavigationErrors``, with its layout ``states``."""

    def chart(self, nav: NavState, held: Array) -> EquivariantChart:
        return EquivariantChart(held, self._states, attitude.to_dcm(nav.q_nb))


class EquivariantChart(Chart):
    """The change of coordinates at a state of the INS with the attitude C (..., 3, 3): the biases change as well."""

    def __init__(self, held: Array, states: Layout, C: Array) -> None:
        super().__init__(held, states)
        self._phi, *self._rows = (states[name] for name in ("phi", "dv", "dp")[: 1 + held.shape[-2]])
        self._biases = states.span("gyro_bias", "accel_bias")
        arm = UNIT * attitude.skew(held[..., 0, :])
        nothing = np.zeros_like(C)
        self._adjoint = np.block([[C, nothing], [arm @ C, C]])
        self._inverse = np.block([[C.mT, nothing], [-C.mT @ arm, C.mT]])

    def errors(self, xi: Array) -> Array:
        x = super().errors(xi)
        beta = xi[..., self._biases, None]
        x[..., self._biases] = (self._of(self._inverse, xi) @ (left_jacobian(xi) @ beta))[..., 0]
        return x

    def invariant(self, x: Array) -> Array:
        xi = super().invariant(x)
        turned = self._of(self._adjoint, x) @ x[..., self._biases, None]
        xi[..., self._biases] = np.linalg.solve(left_jacobian(xi), turned)[..., 0]
        return xi

    def errors_slope(self, xi: Array, x: Array) -> Array:
        b, J = self._biases, super().errors_slope(xi, x)
        left = self.right_jacobian(-xi)
        turned = xi.copy()  # with Ad delta = J_l beta in the place of beta, whose change by d xi is that of the product
        turned[..., b] = (left_jacobian(xi) @ xi[..., b, None])[..., 0]
        nav = slice(b.start)
        change = left[..., b, :].copy()
        change[..., nav] += self._minus_adjoint(turned)[..., b, nav] @ left[..., nav, nav]
        J[..., b, :] = self._of(self._inverse, xi) @ change
        return J

    def invariant_slope(self, xi: Array, x: Array) -> Array:
        return np.asarray(np.linalg.inv(self.errors_slope(xi, x)))

    def slope(self) -> Array:
        D = super().slope()
        D[..., self._biases, self._biases] = self._adjoint
        return D

    def growth(self, before: Chart, m: EpochMotion) -> Array:
        assert isinstance(before, EquivariantChart)
        F = super().growth(before, m)
        F[..., self._biases] = F[..., self._biases] @ before._inverse
        F[..., self._biases, :] = self._adjoint @ F[..., self._biases, :]
        return F

    def spread_noise(self, Q: Array) -> Array:
        out = super().spread_noise(Q)
        out[..., self._biases] = out[..., self._biases] @ self._adjoint.mT
        out[..., self._biases, :] = self._adjoint @ out[..., self._biases, :]
        return out

    def divided(self, H: Array) -> Array:
        out = super().divided(H)
        out[..., self._biases] = out[..., self._biases] @ self._inverse
        return out

    def right_jacobian(self, xi: Array) -> Array:
        """Return the right Jacobian (..., n, n) of the group: the sum of (-ad)^k / (k + 1)!, with the biases among its rows."""
        A = self._minus_adjoint(xi)
        J = one = np.eye(A.shape[-1])
        for k in range(TERMS, 0, -1):
            J = one + A @ J / (k + 1)
        return J

    def _minus_adjoint(self, xi: Array) -> Array:
        """Return -ad (..., n, n), on theta with its sign in these coordinates, and on biases in their units."""
        A = np.zeros((*xi.shape, xi.shape[-1]))
        turn = attitude.skew(xi[..., self._phi])
        for rows in (self._phi, *self._rows):
            A[..., rows, rows] = turn
        for rows in self._rows:
            A[..., rows, self._phi] = attitude.skew(xi[..., rows])
        first = self._biases.start
        gyro, accel = slice(first, first + 3), slice(first + 3, first + 6)
        vel = self._rows[0]
        A[..., gyro, gyro] = A[..., accel, accel] = turn
        A[..., accel, gyro] = -UNIT * attitude.skew(xi[..., vel])
        A[..., gyro, self._phi] = attitude.skew(xi[..., gyro])
        A[..., accel, self._phi] = attitude.skew(xi[..., accel])
        A[..., accel, vel] = -UNIT * A[..., gyro, self._phi]
        return A

    def _of(self, matrix: Array, x: Array) -> Array:
        """Return the matrix of each run for points or components x (..., n), with axes of one for these."""
        return matrix.reshape(*matrix.shape[:-2], *(1,) * (x.ndim - self.ndim), 6, 6)


def left_jacobian(xi: Array) -> Array:
    """Return J_l of SE(3) (..., 6, 6) for gyro and accelerometer biases in their units, at the errors xi (..., n)."""
    J = group_slopes.right_jacobian(
        -xi[..., :6], TWIST
    )  # theta has the other sign than the rotation vector of the error
    J[..., 3:, :3] *= -UNIT
    return J
