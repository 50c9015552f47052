"""All aids of a task as one: their parameters, one measurement with the rows of each, gates, and how well each fits.

A measurement has the rows of all aids at every epoch; those of an aid without a reading are missing. So filters that estimate
the noise of a fix always see the same components. With GPS alone, its measurement is handed on as it is.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from sins_env.arrays import Array
from sins_env.checks import find
from sins_env.types import Observation, Task
from solvers.blocks.conditioning import gate_limit
from solvers.blocks.moments import Linearized, moments, tangent, transform
from solvers.pipeline.aiding.aid import Aid, Ins, Sensor
from solvers.pipeline.aiding.zero_velocity import ZeroRate
from solvers.pipeline.errors.model import ErrorModel, Parameter, each_by
from solvers.types import MISSING, Function, Gaussian, Innovation, Measurement, Transition

E = TypeVar("E", bound=ErrorModel)

Part = tuple[Function | None, int]  #: a function and the number of its rows; None: zeros


def kinds(task: Task, errors: ErrorModel) -> list[tuple[type[Sensor], Any]]:
    """Return the aids of a task that show states of these errors, each with its specification.

    Raises:
        ValueError: a sensor for which there is no aid.
    """
    found = [(find("aid", spec.name, "solvers.pipeline.aiding", Sensor), spec) for spec in task.aids]  # type: ignore[type-abstract]
    return [(kind, spec) for kind, spec in found if kind.fits(errors.states)]


def with_parameters(errors: E, task: Task, behind: Sequence[Parameter] = ()) -> E:
    """Return an error model with the parameters of the aids of a task that are not known, and others behind them."""
    own = [p for kind, spec in kinds(task, errors) for p in kind.states_of(spec) if p.std]
    return replace(errors, parameters=(*own, *behind))


def sensors(task: Task, errors: ErrorModel) -> tuple[Sensor, ...]:
    """Return the aids of a task beside GPS, for an error model with their parameters."""
    return tuple(kind(spec, task, errors.states) for kind, spec in kinds(task, errors))


class Aids:
    """GPS, which comes first, and the other aids of a task."""

    def __init__(self, aids: Sequence[Aid]) -> None:
        self.aids = tuple(aids)
        ends = np.cumsum([aid.rows for aid in self.aids])
        #: The last measurement whose noise drives the errors too, and the covariance (..., n, m) of both; None without one.
        self.shared: tuple[Measurement, Array] | None = None
        self.rows = {aid.name: slice(end - aid.rows, end) for aid, end in zip(self.aids, ends.tolist(), strict=True)}

    def read(self, obs: Observation, ins: Ins) -> Measurement | None:
        """Return the measurement at the end of an epoch; None if no run has a reading of any aid."""
        parts = [aid.read(obs, ins) for aid in self.aids]
        self.shared = None
        for aid, part in zip(self.aids, parts, strict=True):
            if isinstance(aid, ZeroRate) and part is not None:
                self.shared = part, aid.shared(ins)
        if len(parts) == 1 or all(part is None for part in parts):
            return parts[0]
        return stacked(parts, [aid.rows for aid in self.aids], ins.nav.vel.shape[:-1])

    def gated(self, me: Measurement, tr: Transition, x: Gaussian, share: float) -> Measurement:
        """Return the measurement without readings of aids that are too far from their prediction.

        A reading counts as far if good ones lie nearer with the probability ``share``. The prediction is linear from the
        estimate ``x`` before the epoch.
        """
        ahead = transform(tr.f, x, Linearized())[0]
        y = moments(me.h, ahead._replace(cov=ahead.cov + tr.Q), Linearized())[0]
        present = there(me)
        residual = np.where(present, me.z - y.mean, np.nan)
        found = fits(Innovation(residual, y.cov + me.R), self.rows)
        kept = present.copy()
        for name, rows in self.rows.items():
            limit = gate_limit(share, rows.stop - rows.start)
            kept[..., rows] &= ~(found[f"{name}_nis"] > limit)[..., None]
        return me._replace(present=kept)


def there(me: Measurement) -> Any:
    """Return which components (..., m) of a measurement are there."""
    found = ~np.isnan(me.z) & (np.diagonal(me.R, axis1=-2, axis2=-1) < MISSING)
    return found if me.present is None else found & me.present


def stacked(parts: Sequence[Measurement | None], rows: Sequence[int], batch: tuple[int, ...]) -> Measurement:
    """Return the measurements of several aids as one; what is missing has z = 0, and a variance of one unless it is known.

    The law of a fix is that of all its components, so it is not handed on.
    """
    m = sum(rows)
    z, present, R = np.zeros((*batch, m)), np.zeros((*batch, m), dtype=bool), np.zeros((*batch, m, m))
    end = 0
    for part, size in zip(parts, rows, strict=True):
        here = slice(end, end + size)
        end += size
        R[..., here, here] = np.eye(size)
        if part is not None:
            found = there(part)
            present[..., here] = found
            z[..., here] = np.where(found, part.z, 0.0)
            gone = np.diagonal(part.R, axis1=-2, axis2=-1) >= MISSING
            some = np.count_nonzero(gone)
            R[..., here, here] = (
                np.where(gone[..., None] | gone[..., None, :], np.eye(size), part.R) if some else part.R
            )
    h = Joined([(None if part is None else part.h, size) for part, size in zip(parts, rows, strict=True)])
    return Measurement(z, h, R, None, present)


class Joined:
    """The functions of several aids as one, with its Jacobian."""

    def __init__(self, parts: Sequence[Part]) -> None:
        self.parts = tuple(parts)
        self.size = sum(m for _, m in parts)

    def __call__(self, x: Array) -> Array:
        shape = x.shape[:-1]
        return np.concatenate([np.zeros((*shape, m)) if h is None else h(x) for h, m in self.parts], axis=-1)

    def jacobian(self, x: Array) -> Array:
        """Return the Jacobian (..., m, n) at x (..., n)."""
        return self.value_and_jacobian(x)[1]

    def value_and_jacobian(self, x: Array) -> tuple[Array, Array]:
        """Return the value (..., m) and the Jacobian (..., m, n) at x (..., n)."""
        shape, n = x.shape[:-1], x.shape[-1]
        y, J, end = np.zeros((*shape, self.size)), np.zeros((*shape, self.size, n)), 0
        for h, m in self.parts:
            here = slice(end, end + m)
            end += m
            if h is not None:
                y[..., here], J[..., here, :] = tangent(h, x, np.zeros_like(x))
        return y, J


def fits(innovation: Innovation, rows: Mapping[str, slice]) -> dict[str, Array]:
    """Return what the innovation of each aid was.

    These are ``<aid>_residual`` (..., m), its covariance ``<aid>_covariance`` (..., m, m), and ``<aid>_nis`` (...), the
    normalised square. Missing components do not count; an aid without any has NaN.
    """
    found: dict[str, Array] = {}
    for name, here in rows.items():
        nu, S = innovation.residual[..., here], innovation.cov[..., here, here]
        gone = np.isnan(nu)
        S = np.where(gone[..., None] | gone[..., None, :], np.eye(nu.shape[-1]), S)
        known = np.where(gone, 0.0, nu)
        nis = np.sum(known * np.linalg.solve(S, known[..., None])[..., 0], axis=-1)
        found[f"{name}_residual"], found[f"{name}_nis"] = nu, np.where(gone.all(axis=-1), math.nan, nis)
        found[f"{name}_covariance"] = innovation.cov[..., here, here]
    return found


def decayed(parameters: Sequence[Parameter], own: Mapping[str, Array], epoch_s: float) -> dict[str, Array]:
    """Return parameters that were fed back as they are expected an epoch later: what wanders tends to zero, a clock runs on."""
    return {
        p.name: own[p.name] if p.constant else each_by(p.carry(epoch_s), own[p.name])
        for p in parameters
        if p.name in own
    }
