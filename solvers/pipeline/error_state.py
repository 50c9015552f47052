"""The 10-state error model of alignment: how the INS's velocity error and misalignment grow over an epoch. equations.md C.3.

    x = [dV_E, dV_N,  phi_E, phi_N, phi_U,  nabla_x, nabla_y,  eps_x, eps_y, eps_z]
         m/s          rad                   mg (1e-3 g)        deg/h

The default is the exact large-angle model: with every hatted quantity from the INS, C = C_n^c(phi), C_w of C.1,

    phi' = C_w^-1 [(I - C) omega_in + C d_omega_en - C_hat eps]
    dV'  = (I - C') f + C' C_hat nabla - (2 omega_ie + omega_en) x dV - d_omega_en x (V - dV),   rows E and N.

``model="thesis"`` takes C to first order in the tilt and C_w = I, as (2.3.4) and (2.3.19) do (for comparison: 1 deg of
tilt then biases the azimuth by 270 arcsec after 360 s). ``bias_frame="nav"`` takes the biases as constant in n, as the thesis does.

The epoch map integrates with the INS's own integrals of specific force and attitude and evaluates C once: its change
within the epoch enters the velocity as C_mid' u = C' (u + r x u / 2), r being the rotation of c against n. That is second
order in the epoch; tests compare it with the difference of two strapdown runs and with an adaptive ODE solver.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude
from sins_env.errors import unknown
from sins_env.specs import DEG_PER_H, G0, Prior
from solvers.pipeline.strapdown import EpochMotion
from solvers.types import Gaussian, Linear, Measurement, NoiseLaw, Transition

Array = NDArray[np.float64]

MODELS = ("exact", "thesis")
BIAS_FRAMES = ("body", "nav")
ACCEL_UNIT = 1e-3 * G0  #: m/s^2 in one unit of nabla
GYRO_UNIT = DEG_PER_H  #: rad/s in one unit of eps
PHI = slice(2, 5)

#: where the ten states stand in the fifteen errors of :class:`sins_env.specs.Prior`, and their units
_OF_PRIOR = np.array([3, 4, 0, 1, 2, 12, 13, 9, 10, 11])
_UNITS = np.array([1.0] * 5 + [ACCEL_UNIT] * 2 + [GYRO_UNIT] * 3)
_H = np.eye(2, 10)


def first_order_rows(phi: Array) -> Array:
    """C_n^c to first order in phi_E, phi_N, components in front: (3, ...) -> (3, 3, ...). (2.3.4)."""
    x, y, z = phi
    s, c = np.sin(z), np.cos(z)
    C = np.empty((3, *phi.shape))
    C[0, 0], C[0, 1], C[0, 2] = c, s, -y
    C[1, 0], C[1, 1], C[1, 2] = -s, c, x
    C[2, 0], C[2, 1], C[2, 2] = y * c + x * s, y * s - x * c, 1.0
    return C


def _front(a: Array, axes: int = 1) -> Array:
    """The last ``axes`` axes in front, and an axis for points behind: (*batch, 3) -> (3, *batch, 1)."""
    n = a.ndim - axes
    return a.transpose(*range(n, a.ndim), *range(n))[..., None]


class EpochMap:
    """x -> x after the epoch; takes (*batch, 10) and, for sigma points, (*batch, points, 10).

    Inside, components stand in front: planes over runs and points are what NumPy is fast on.
    """

    def __init__(self, motion: EpochMotion, exact: bool, body_biases: bool) -> None:
        h = motion.dt
        self._exact, self._ndim = exact, motion.dvel_n.ndim
        C = h * (_front(motion.C, 2) if body_biases else np.eye(3).reshape(3, 3, *(1,) * self._ndim))
        self._accel, self._gyro = ACCEL_UNIT * C[:, :2], GYRO_UNIT * C
        self._force = _front(motion.dvel_n)
        self._turn = _front(h * (motion.rate_ie + motion.rate_en))
        self._tilt = _front(-0.5 * attitude.skew(motion.dvel_n), 2)  # r -> r x force / 2
        transport = _front(h * motion.transport, 2)[:, :2]
        if transport.ndim < self._ndim + 2:  # one transport matrix for all runs
            transport = transport.reshape(3, 2, *(1,) * self._ndim)
        self._transport = transport
        # - (2 omega_ie + omega_en) x dV - d_omega_en x V as a matrix on dV; the rest is quadratic in dV
        VE, VN, VU = _front(motion.vel)
        coriolis = _front(h * (2 * motion.rate_ie + motion.rate_en))[2]
        east, north, up = transport[1, 0], transport[0, 1], transport[2, 0]
        K = np.zeros((2, 2, *np.broadcast_shapes(VE.shape, coriolis.shape)))
        K[0, 0], K[0, 1], K[1, 0], K[1, 1] = up * VN - east * VU, coriolis, -coriolis - up * VE, north * VU
        self._coriolis = K

    def __call__(self, x: Array) -> Array:
        if x.ndim == self._ndim:
            return self._advance(x[..., None, :])[..., 0, :]
        return self._advance(x)

    def _advance(self, x: Array) -> Array:
        total = np.add.reduce
        n = x.ndim - 1
        X = np.ascontiguousarray(x.transpose(n, *range(n)))
        dV, phi, nabla, eps = X[:2], X[2:5], X[5:7], X[7:]
        if self._exact:
            C, s, c = attitude.misalignment_rows(phi)
        else:
            C = first_order_rows(phi)
        u = self._force - total(self._accel * nabla, axis=1)
        rows = C[:, :2]
        gain = self._force[:2] - total(rows * u[:, None], axis=0)  # (I - C') f + C' C_hat nabla, C at the start
        v = dV + 0.5 * gain  # mid-epoch
        w = self._turn - total(self._transport * v, axis=1)
        r = self._turn - total(C * w, axis=1) - total(self._gyro * eps, axis=1)  # omega_nc h
        gain -= total(
            rows * total(self._tilt * r, axis=1)[:, None], axis=0
        )  # C at mid-epoch; nabla is nothing beside f
        out = np.empty(X.shape)
        np.add(dV, gain, out=out[:2])
        out[:2] += total(self._coriolis * v, axis=1)
        sway = self._transport[2, 0] * v[0]
        out[0] -= sway * v[1]
        out[1] += sway * v[0]
        if self._exact:
            k = (c[1] * r[2] - s[1] * r[0]) / c[0]  # rows of C_w^-1
            out[2] = phi[0] + c[1] * r[0] + s[1] * r[2]
            out[3] = phi[1] + r[1] - s[0] * k
            out[4] = phi[2] + k
        else:
            np.add(phi, r, out=out[2:5])
        out[5:] = X[5:]
        return np.ascontiguousarray(out.transpose(*range(1, n + 1), 0))


@dataclass(frozen=True)
class AlignmentErrors:
    """The model as settings; epochs are turned into transitions for a filter.

    Raises:
        ValueError: an unknown ``model`` or ``bias_frame``.
    """

    model: str = "exact"
    bias_frame: str = "body"

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise unknown("model", self.model, MODELS)
        if self.bias_frame not in BIAS_FRAMES:
            raise unknown("bias_frame", self.bias_frame, BIAS_FRAMES)

    def prior(self, prior: Prior, batch: tuple[int, ...]) -> Gaussian:
        """N(0, P0) for every run: (*batch, 10), (*batch, 10, 10)."""
        P0 = self._select(prior.P0)
        return Gaussian(np.zeros((*batch, 10)), np.broadcast_to(P0, (*batch, 10, 10)).copy())

    def noise(self, prior: Prior) -> Array:
        """Q (10, 10) of one epoch."""
        return self._select(prior.Q)

    def transition(self, motion: EpochMotion, Q: Array) -> Transition:
        return Transition(EpochMap(motion, self.model == "exact", self.bias_frame == "body"), Q, None, motion.dt)

    def measurement(
        self, residual: Array, R: Array, arm_velocity: Array | None = None, law: NoiseLaw | None = None
    ) -> Measurement:
        """INS minus GPS velocity, E and N (..., 2): [I 0] x, plus the lever arm's part turned by phi. (2.3.20).

        ``arm_velocity`` (..., 3): C_hat (omega_eb x lever arm), already added to the INS's velocity in ``residual``.
        """
        if arm_velocity is None:
            return Measurement(residual, Linear(_H), R, law)

        def h(x: Array) -> Array:
            a = arm_velocity[..., None, :] if x.ndim > arm_velocity.ndim else arm_velocity
            turned = np.matmul(np.swapaxes(attitude.misalignment_dcm(x[..., PHI]), -1, -2), a[..., None])[..., 0]
            return x[..., :2] + (a - turned)[..., :2]

        return Measurement(residual, h, R, law)

    @staticmethod
    def _select(full: Array) -> Array:
        return full[np.ix_(_OF_PRIOR, _OF_PRIOR)] / np.outer(_UNITS, _UNITS)
