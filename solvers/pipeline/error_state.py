"""The 10-state error model of alignment: how the INS's velocity error and misalignment grow over an epoch. equations.md C.3.

    x = [dV_E, dV_N,  phi_E, phi_N, phi_U,  nabla_x, nabla_y,  eps_x, eps_y, eps_z]
         m/s          rad                   mg (1e-3 g)        deg/h

The default is the exact large-angle model: with every hatted quantity from the INS, C = C_n^c(phi), C_w of C.1,

    phi' = C_w^-1 [(I - C) omega_in + C d_omega_en - C_hat eps]
    dV'  = (I - C') f + C' C_hat nabla - (2 omega_ie + omega_en) x dV - d_omega_en x (V - dV),   rows E and N.

``model="thesis"`` takes C to first order in the tilt and C_w = I, as (2.3.4) and (2.3.19) do (for comparison: it biases the
azimuth by 3300 arcsec at 1 deg of tilt). ``bias_frame="nav"`` takes the biases as constant in n, as the thesis does.

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
from solvers.pipeline.strapdown import EpochMotion, cross_planes
from solvers.types import Gaussian, Linear, Measurement, Transition

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


class EpochMap:
    """x -> x after the epoch; takes (*batch, 10) and, for sigma points, (*batch, points, 10)."""

    def __init__(self, motion: EpochMotion, exact: bool, body_biases: bool) -> None:
        self._exact = exact
        self._batch_ndim = motion.dvel_n.ndim - 1
        h = motion.dt
        front = np.moveaxis
        C = front(motion.C, (-2, -1), (0, 1)) if body_biases else np.eye(3).reshape(3, 3, *(1,) * self._batch_ndim)
        self._accel, self._gyro = (h * ACCEL_UNIT) * C[:, :2], (h * GYRO_UNIT) * C
        self._force = front(motion.dvel_n, -1, 0)
        self._turn = front(h * (motion.rate_ie + motion.rate_en), -1, 0)
        self._vel = front(motion.vel, -1, 0)
        self._coriolis = h * (2 * motion.rate_ie + motion.rate_en)[..., 2]
        transport = h * motion.transport
        self._transport = (transport[..., 0, 1], transport[..., 1, 0], transport[..., 2, 0])

    def __call__(self, x: Array) -> Array:
        if x.ndim - 1 > self._batch_ndim:  # sigma points: one more axis behind the runs
            points = self._with_points()
            return points(x)
        return self._advance(x)

    def _with_points(self) -> EpochMap:
        out = object.__new__(EpochMap)
        out._exact, out._batch_ndim = self._exact, self._batch_ndim + 1
        for name in ("_accel", "_gyro", "_force", "_turn", "_vel", "_coriolis"):
            setattr(out, name, getattr(self, name)[..., None])
        out._transport = tuple(np.asarray(part)[..., None] for part in self._transport)  # type: ignore[assignment]
        return out

    def _advance(self, x: Array) -> Array:
        X = np.ascontiguousarray(np.moveaxis(x, -1, 0))  # components in front: planes are what NumPy is fast on
        dV, phi = X[:2], X[2:5]
        if self._exact:
            C, (sx, sy, _), (cx, cy, _) = attitude.misalignment_rows(phi)
        else:
            C = first_order_rows(phi)
        u = self._force - (self._accel * X[None, 5:7]).sum(axis=1)
        gain = self._force[:2] - (C[:, :2] * u[:, None]).sum(axis=0)  # (I - C') f + C' C_hat nabla, C at the start
        vE, vN = dV + 0.5 * gain
        TN, TE, TU = self._transport
        dEn, dNn, dUn = TN * vN, TE * vE, TU * vE  # d_omega_en h at mid-epoch
        w = self._turn - np.stack([dEn, dNn, dUn])
        r = self._turn - (C * w[None]).sum(axis=1) - (self._gyro * X[None, 7:10]).sum(axis=1)  # omega_nc h
        gain -= 0.5 * (C[:, :2] * cross_planes(r, u)[:, None]).sum(axis=0)  # C at mid-epoch
        out = np.empty_like(X)
        VE, VN, VU = self._vel
        out[0] = dV[0] + gain[0] + self._coriolis * vN - dNn * VU + dUn * (VN - vN)
        out[1] = dV[1] + gain[1] - self._coriolis * vE - dUn * (VE - vE) + dEn * VU
        if self._exact:
            k = (cy * r[2] - sy * r[0]) / cx  # rows of C_w^-1
            out[2] = phi[0] + cy * r[0] + sy * r[2]
            out[3] = phi[1] + r[1] - sx * k
            out[4] = phi[2] + k
        else:
            out[2:5] = phi + r
        out[5:] = X[5:]
        return np.ascontiguousarray(np.moveaxis(out, 0, -1))


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

    def measurement(self, residual: Array, R: Array, arm_velocity: Array | None = None) -> Measurement:
        """INS minus GPS velocity, E and N (..., 2): [I 0] x, plus the lever arm's part turned by phi. (2.3.20).

        ``arm_velocity`` (..., 3): C_hat (omega_eb x lever arm), already added to the INS's velocity in ``residual``.
        """
        if arm_velocity is None:
            return Measurement(residual, Linear(_H), R)

        def h(x: Array) -> Array:
            a = arm_velocity[..., None, :] if x.ndim > arm_velocity.ndim else arm_velocity
            turned = np.matmul(np.swapaxes(attitude.misalignment_dcm(x[..., PHI]), -1, -2), a[..., None])[..., 0]
            return x[..., :2] + (a - turned)[..., :2]

        return Measurement(residual, h, R)

    @staticmethod
    def _select(full: Array) -> Array:
        return full[np.ix_(_OF_PRIOR, _OF_PRIOR)] / np.outer(_UNITS, _UNITS)
