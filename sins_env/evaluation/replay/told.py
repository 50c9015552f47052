"""What a solver tells of itself at every epoch: covariance, innovations, biases and parameters of aids, each with its sigma.

All of it is optional. ``covariance()`` belongs to the contract of an estimator; the rest comes from ``diagnostics()``, in which
the names below are looked for. What a solver does not tell is NaN.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.estimators.guard import EstimatorError, Guarded
from sins_env.states import Layout, answered

GPS = "gps"  #: name of the fixes among the aids
SIGMA, RESIDUAL, COVARIANCE, NIS = (
    "_sigma",
    "_residual",
    "_covariance",
    "_nis",
)  #: endings of names in ``diagnostics()``
DOUBT = "doubt"  #: share of epochs so far in which the solver doubted the told noise


@dataclass(eq=False, repr=False)
class Told:
    """Values in W windows at K epochs, which are filled in epoch by epoch."""

    windows: int
    epochs: int
    navigates: bool
    cov: Array = field(init=False)  #: (W, K, n, n) of phi in rad and, in navigation, velocity in m/s and position in m
    values: dict[str, Array] = field(default_factory=dict)  #: arrays (W, K, ...) by their names in ``diagnostics()``

    def __post_init__(self) -> None:
        n = answered(self.navigates).size
        self.cov = np.full((self.windows, self.epochs, n, n), np.nan)

    def __repr__(self) -> str:
        return f"<Told of {self.windows} windows: {', '.join(self.values) or 'no diagnostics'}>"

    def ask(self, k: int, guard: Guarded) -> None:
        """Fill in what the solver tells after epoch ``k``.

        Raises:
            EstimatorError: the solver failed, or a value changed its shape.
        """
        P = guard.covariance()
        if P is not None:
            self.cov[:, k] = P
        found = guard.diagnostics()
        for name in wanted(found):
            self.put(name, slice(k, k + 1), found[name][:, None])

    def put(self, name: str, epochs: slice, value: Array) -> None:
        """Fill in ``value`` (W, epochs, ...) under a name."""
        if name not in self.values:
            self.values[name] = np.full((self.windows, self.epochs, *value.shape[2:]), np.nan)
        if self.values[name].shape[2:] != value.shape[2:]:
            shape, before = value.shape[2:], self.values[name].shape[2:]
            raise EstimatorError(f"diagnostics returned {name} of shape {shape} a run; allowed: {before}, as before")
        self.values[name][:, epochs] = value

    @classmethod
    def joined(cls, parts: Sequence[Told]) -> Told:
        """Return several parts with the same epochs as one."""
        out = cls(sum(part.windows for part in parts), parts[0].epochs, parts[0].navigates)
        out.cov = np.concatenate([part.cov for part in parts])
        shapes = {name: value.shape[1:] for part in parts for name, value in part.values.items()}
        for name, shape in shapes.items():
            every = [part.values.get(name, np.full((part.windows, *shape), np.nan)) for part in parts]
            out.values[name] = np.concatenate(every)
        return out

    @property
    def layout(self) -> Layout:
        """Blocks of the covariance."""
        return answered(self.navigates)

    @property
    def aids(self) -> list[str]:
        """Names of the sensors whose innovations are told, the fixes first."""
        found = [name.removesuffix(NIS) for name in self.values if name.endswith(NIS)]
        return sorted(found, key=lambda name: (name != GPS, name))

    @property
    def constants(self) -> list[str]:
        """Names of the biases and parameters that are told."""
        return [name.removesuffix(SIGMA) for name in self.values if name.endswith(SIGMA)]

    def value(self, name: str, window: int, *shape: int) -> Array:
        """Return a value of a window, (K, ...); NaN in this ``shape`` if it is not told."""
        told = self.values.get(name)
        return np.full((self.epochs, *shape), np.nan) if told is None else told[window]

    def innovations(self, window: int, size: int) -> tuple[Array, Array]:
        """Return the residuals (K, m) of the fixes and their covariance (K, m, m); NaN for m = ``size`` if they are not told."""
        nu = self.value(f"{GPS}{RESIDUAL}", window, size)
        return nu, self.value(f"{GPS}{COVARIANCE}", window, size, size)


def wanted(found: Mapping[str, Array]) -> list[str]:
    """Return the names among the diagnostics that are kept at every epoch."""
    ends = (RESIDUAL, COVARIANCE, NIS)
    pairs = [name for name in found if f"{name}{SIGMA}" in found or name.removesuffix(SIGMA) in found.keys() - {name}]
    return [name for name in found if name.endswith(ends) or name == DOUBT or name in pairs]


def sigma_of_angles(angles: Array, cov: Array) -> Array:
    """Return the standard deviations (K, 3) of heading, pitch, roll from the covariance (K, 3, 3) of phi E, N, U, rad.

    To first order phi = -dh U + dp r + dr f, with r the level axis to the right and f the forward axis.
    """
    h, p = angles[:, 0], angles[:, 1]
    zero, one = np.zeros_like(h), np.ones_like(h)
    up = np.stack([zero, zero, one], axis=-1)
    right = np.stack([np.cos(h), -np.sin(h), zero], axis=-1)
    forward = np.stack([np.sin(h) * np.cos(p), np.cos(h) * np.cos(p), np.sin(p)], axis=-1)
    M = np.stack([-up, right, forward], axis=-1)
    known = np.isfinite(M).all(axis=(-2, -1)) & (np.abs(np.cos(p)) > 1e-6)
    J = np.linalg.inv(np.where(known[:, None, None], M, np.eye(3)))
    P = J @ cov @ J.mT
    return np.where(known[:, None], np.sqrt(np.abs(np.diagonal(P, axis1=-2, axis2=-1))), np.nan)
