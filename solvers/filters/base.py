"""What every filter of the zoo shares: one step, beliefs of any make, and the care for runs that fail.

A belief is a NamedTuple with ``health``. Its other fields are arrays with the batch axes in front, NamedTuples of such
arrays, or values shared by all runs. Floating-point fields are finite in a run that is well; a run in which one is not
is lost, and is frozen.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, Protocol, TypeVar, cast

import numpy as np

from sins_env.arrays import Array, Mask
from solvers.filters.brief import Brief
from solvers.filters.inputs import (
    checked_measurement,
    checked_transition,
    covariance,
    numbers,
    patterns,
    picked,
    unwound,
)
from solvers.types import Function, Gaussian, Health, Innovation, Measurement, Transition


class AnyBelief(Protocol):
    """A belief of any make; only its ``health`` is known here."""

    @property
    def health(self) -> Health: ...


B = TypeVar("B", bound=AnyBelief)

FEW = 4096  #: size of an array up to which BLAS works in the calling thread; waking others takes milliseconds on a busy machine
#: Decorator of what may lose runs: these are marked, instead of a warning. A context costs half a microsecond more.
QUIET = np.errstate(invalid="ignore", over="ignore", divide="ignore")


@dataclass(frozen=True)
class BatchFilter(Brief, ABC, Generic[B]):
    """Base of the filters: a subclass makes its belief, and predicts and corrects it."""

    batched: ClassVar[bool] = True  #: whether the filter takes any batch shape; False: one run, of shape ()
    one_mean: ClassVar[bool] = True  #: whether the belief has a single mean, near which angles are counted

    @abstractmethod
    def init(self, prior: Gaussian, rng: Any = None) -> B:
        """Make the belief at the start; see :class:`solvers.types.Filter`."""

    @abstractmethod
    def predict(self, b: B, tr: Transition) -> B:
        """Return the belief one epoch later; repairs and fallbacks are counted by ``count``."""

    @abstractmethod
    def correct(self, b: B, me: Measurement) -> tuple[B, Innovation]:
        """Return the belief after a measurement, and the innovation."""

    @abstractmethod
    def estimate(self, b: B) -> Gaussian:
        """Return mean (..., n) and covariance (..., n, n) of the belief."""

    @abstractmethod
    def move(self, b: B, g: Function, jac: Callable[[Array], Array]) -> B:
        """Do what ``relocate`` does, but without care for runs that it loses."""

    @QUIET
    def step(self, b: B, tr: Transition, me: Measurement | None) -> tuple[B, Innovation | None]:
        """Predict, then correct with the components of the fix that are there.

        A run that turns non-finite is frozen at its last good belief and marked in ``health``. From then on
        its innovation is NaN. It does not affect the other runs.

        Raises:
            ValueError: shapes that do not fit, or a Q or R that is no covariance.
        """
        tr, me = self.checked(b, tr, me)
        return self.advance(b, tr, me)

    def checked(self, b: B, tr: Transition, me: Measurement | None) -> tuple[Transition, Measurement | None]:
        """Return transition and measurement in the form of solvers/filters/inputs.py.

        Raises:
            ValueError: see ``step``.
        """
        batch, n = b.health.failed_at.shape, self.states(b)
        return checked_transition(tr, batch, n), None if me is None else checked_measurement(me, batch, n)

    def states(self, b: B) -> int:
        """Return the number of states."""
        return b.mean.shape[-1]  # type: ignore[attr-defined]

    def advance(self, b: B, tr: Transition, me: Measurement | None) -> tuple[B, Innovation | None]:
        """Do what ``step`` does, for a transition and a measurement that are checked."""
        x = self.predict(b, tr)
        if me is None:
            return settle(b, x), None
        y, innovation = self.corrected(x, me)
        after = settle(b, y)
        if after.health.frozen:
            innovation = _blank(innovation, after.health.failed_at >= 0)
        return after, innovation

    def corrected(self, b: B, me: Measurement) -> tuple[B, Innovation]:
        """Correct each run by the components of a checked fix that it has; runs that miss the same ones go together."""
        if me.present is None:
            return self.correct(b, self.unwound(b, me))
        m = me.z.shape[-1]
        after, innovation = b, Innovation(np.full(me.z.shape, np.nan), np.full((*me.z.shape, m), np.nan))
        for rows, here in patterns(me.present):
            y, seen = self.correct_rows(b, me._replace(z=np.where(np.isnan(me.z), 0.0, me.z)), rows)
            after = mixed(here, y, after)
            innovation = filled(innovation, here, rows, seen)
        return after, innovation

    def correct_rows(self, b: B, me: Measurement, rows: Mask) -> tuple[B, Innovation]:
        """Correct all runs by the components in the mask (m,) alone."""
        if not rows.all():
            me = picked(me, rows)
        return self.correct(b, self.unwound(b, me))

    def unwound(self, b: B, me: Measurement) -> Measurement:
        """Return a checked measurement whose angles lie near the fix."""
        return me if me.turns is None else unwound(me, self.estimate(b).mean if self.one_mean else None)

    @QUIET
    def relocate(self, b: B, g: Function, jac: Callable[[Array], Array]) -> B:
        """Move every mean x to g(x) and every covariance P to J(x) P J(x)', as feedback into the INS asks.

        Frozen runs are moved too, because only the origin of their errors changes. A run that the move makes non-finite is
        frozen and marked.
        """
        x = self.move(b, g, jac)
        return x if _finite(x) else _keep(b, x, _finite_runs(x), x.health)

    def diagnostics(self, b: B) -> dict[str, Array]:
        """Return what the filter knows beside its estimate, by name: arrays with the batch axes in front."""
        return {}


def initial_health(*arrays: Array, batch: tuple[int, ...]) -> Health:
    """Return the health at the start; a run whose arrays are not finite has failed at epoch 0."""
    well: Mask = np.ones(batch, dtype=bool)
    for a in arrays:
        well = well & _finite_rows(a, len(batch))
    zeros = np.zeros(batch, dtype=np.int64)
    return Health(0, zeros, np.where(well, -1, 0), zeros, not well.all())


def initial_gaussian(prior: Gaussian) -> Gaussian:
    """Copy ``prior`` to mean (..., n) and covariance (..., n, n); the covariance may be one (n, n) for all runs.

    Raises:
        ValueError: the shapes do not fit, or the covariance is none.
    """
    mean: Array = np.array(numbers("prior mean", prior.mean))
    n, given = mean.shape[-1] if mean.ndim else 0, np.shape(prior.cov)
    if n == 0 or (given not in ((*mean.shape, n), (n, n)) and (n != 1 or given not in ((), (1,)))):
        needed = (*mean.shape, n)
        raise ValueError(f"prior mean of shape {mean.shape}: the covariance must be {needed}, given {given}")
    with np.errstate(invalid="ignore", over="ignore"):
        cov = covariance("prior covariance", prior.cov, mean.shape[:-1], n)
    return Gaussian(mean, np.array(np.broadcast_to(cov, (*mean.shape, n))))


def count(b: B, repairs: Mask | None = None, fallbacks: Mask | None = None) -> B:
    """Return the belief with the runs of the masks (...) counted as repaired or fallen back; None: no run."""
    if repairs is None and fallbacks is None:
        return b
    health = b.health
    if repairs is not None:
        health = health._replace(repairs=health.repairs + repairs)
    if fallbacks is not None:
        health = health._replace(fallbacks=health.fallbacks + fallbacks)
    return with_health(b, health)


def with_health(b: B, health: Health) -> B:
    """Return the belief with another health; ``_replace`` takes three times as long."""
    made: Any = b
    at = made._fields.index("health")
    return cast(B, made._make((*made[:at], health, *made[at + 1 :])))


def mixed(where: Mask, other: B, b: B) -> B:
    """Return ``other`` with its counts in the runs of the mask (...), and ``b`` in the rest."""
    repairs = np.where(where, other.health.repairs, b.health.repairs)
    fallbacks = np.where(where, other.health.fallbacks, b.health.fallbacks)
    health = b.health._replace(repairs=repairs, fallbacks=fallbacks)
    return with_health(cast(B, choose(where, other, b)), health)


def fall_back(where: Mask, b: B, other: B) -> B:
    """Return ``other`` in the runs of the mask (...), counted as fallbacks, and ``b`` in the rest."""
    return count(mixed(where, other, b), fallbacks=where)


def settle(before: B, after: B) -> B:
    """Return ``after`` in the runs that are finite and not frozen, and ``before`` in the others."""
    epoch, _, failed_at, _, frozen = before.health
    _, repairs, failed, fallbacks, lost = after.health
    health = Health(epoch + 1, repairs, failed, fallbacks, lost)
    if not frozen and _finite(after):
        return with_health(after, health)
    well = (failed_at < 0) & _finite_runs(after)
    repairs = np.where(well, health.repairs, before.health.repairs)
    fallbacks = np.where(well, health.fallbacks, before.health.fallbacks)
    return _keep(before, after, well, health._replace(repairs=repairs, fallbacks=fallbacks))


def _keep(before: B, after: B, well: Mask, health: Health) -> B:
    """Return ``after`` in the runs that are well, and ``before`` in the others, marked as failed now or earlier."""
    failed_at = np.where(well | (health.failed_at >= 0), health.failed_at, health.epoch)
    health = health._replace(failed_at=failed_at, frozen=bool((failed_at >= 0).any()))
    return with_health(cast(B, choose(well, after, before)), health)


def choose(well: Mask, after: Any, before: Any) -> Any:
    """Take every field from ``after`` in the runs of ``well`` (...), else from ``before``; health is that of ``after``."""
    if isinstance(after, Health):
        return after
    if isinstance(after, tuple):
        parts = (choose(well, a, b) for a, b in zip(after, before, strict=True))
        return type(after)(*parts) if hasattr(after, "_fields") else tuple(parts)
    if isinstance(after, np.ndarray | np.generic):  # NumPy makes scalars of () arrays
        return np.where(well.reshape((*well.shape, *(1,) * (after.ndim - well.ndim))), after, before)
    return after


def _arrays(b: Any) -> Iterator[Array]:
    """Yield the floating-point arrays of a belief."""
    for part in b:
        if isinstance(part, np.ndarray | np.generic):
            if part.dtype.kind == "f":
                yield cast(Array, part)
        elif isinstance(part, tuple) and not isinstance(part, Health):
            yield from _arrays(part)


def _finite(b: Any) -> bool:
    """Return whether all runs are finite, by one sum per array; one that overflows gives False too."""
    for part in b:
        if type(part) is np.ndarray:
            if part.dtype.kind == "f" and not math.isfinite(_gauge(part)):
                return False
        elif type(part) is not Health and not all(math.isfinite(_gauge(a)) for a in _arrays((part,))):
            return False
    return True


def _gauge(a: Array) -> float:
    """Return a number that is finite only if all of ``a`` are: the sum of squares by BLAS, which takes threads for large arrays."""
    return float(np.vdot(a, a) if a.size <= FEW else np.add.reduce(a, axis=None))


def _finite_runs(b: Any) -> Mask:
    shape = b.health.failed_at.shape
    well: Mask = np.ones(shape, dtype=bool)
    for a in _arrays(b):
        well = well & _finite_rows(a, len(shape))
    return well


def _finite_rows(a: Array, axes: int) -> Mask:
    return np.asarray(np.isfinite(a).all(axis=tuple(range(axes, a.ndim))))


def filled(innovation: Innovation, here: Mask, rows: Mask, seen: Innovation) -> Innovation:
    """Return the innovation with that of the components ``rows`` (m,) in the runs of the mask (...)."""
    at = np.flatnonzero(rows)
    residual, cov = innovation.residual.copy(), innovation.cov.copy()
    residual[..., at] = np.where(here[..., None], seen.residual, residual[..., at])
    cov[..., at[:, None], at] = np.where(here[..., None, None], seen.cov, cov[..., at[:, None], at])
    return Innovation(residual, cov)


def _blank(innovation: Innovation, frozen: Mask) -> Innovation:
    residual = np.where(frozen[..., None], np.nan, innovation.residual)
    return Innovation(residual, np.where(frozen[..., None, None], np.nan, innovation.cov))
