"""Slices of headings: inertial solutions with weights, side by side along one axis for all runs of a batch.

A slice has an INS of its own with the biases fed back so far, and for each model of the noise a Gaussian of its right-invariant
errors xi. Runs have different numbers of slices: ``run`` tells to which run a slice belongs, in ascending order. Sums over the
slices of a run are taken in their order, so that a run of a batch has the bits of a single run.

A slice j is seen from another b through Exp(d) = X_b X_j^-1: with Exp(xi_j) = X_j X^-1 follows Exp(xi_b) = Exp(d) Exp(xi_j), which
is d + J_r(d)^-1 xi_j to first order in xi_j. Equations: docs/mathematics/filters.md#bank-of-inertial-solutions.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.earth import Earth
from sins_env.kernels import kernel
from solvers.blocks.conditioning import nis
from solvers.blocks.mixtures import collapse
from solvers.pipeline.bank.models import carried
from solvers.pipeline.errors.group_slopes import right_jacobian
from solvers.pipeline.errors.invariant import Invariant
from solvers.pipeline.errors.navigation import NavigationErrors
from solvers.pipeline.strapdown import StrapdownState
from solvers.types import Gaussian, Innovation

PRUNE = 1e-8  #: weight below which a slice is dropped
MERGE_WITHIN = 0.5  #: distance to the best slice, in standard deviations, at which one is merged into it


class Slices(NamedTuple):
    """N slices of all runs together; M models, n states, C regimes."""

    run: NDArray[np.int64]  #: (N,), run of each slice, in ascending order
    ins: StrapdownState  #: (N, ...)
    bias: Array  #: (N, 6 + p), gyro rad/s, accelerometer m/s^2, and p parameters of aids in SI units, fed back so far
    weight: Array  #: (N, M), which sum to one in each run
    mean: Array  #: (N, M, n)
    cov: Array  #: (N, M, n, n)
    regimes: Array  #: (N, M, C), probabilities of the regimes at the last fix

    @property
    def x(self) -> Gaussian:
        """The Gaussians of the models, (N, M, n) and (N, M, n, n)."""
        return Gaussian(self.mean, self.cov)

    def take(self, index: NDArray[Any]) -> Slices:
        """Return the slices at ``index`` (K,), or those of a mask (N,)."""
        return cast(Slices, taken(self, index))

    def put(self, index: NDArray[Any], other: Slices) -> Slices:
        """Return these slices with those at ``index`` replaced by ``other``, which has as many."""
        return cast(Slices, replaced(self, index, other))


class Reading(NamedTuple):
    """A reading of an aid, and the slices before they were corrected by it."""

    s: Slices
    nu: Array  #: (N, m), INS minus reading
    H: Array  #: (N, m, n), at zero error
    R: Array  #: (m, m), or (N, m, m)
    seen: NDArray[np.int64]  #: the slices that have it


def taken(part: Any, index: NDArray[Any]) -> Any:
    """Return the rows at ``index`` of an array; of a tuple of arrays, or of such tuples, part by part."""
    if part is None:
        return None
    if isinstance(part, tuple):
        parts = (taken(one, index) for one in part)
        return type(part)(*parts) if hasattr(part, "_fields") else tuple(parts)
    return part[index]


def replaced(a: Any, index: NDArray[Any], b: Any) -> Any:
    """Return the arrays ``a`` with the rows ``b`` at ``index``; a tuple of arrays, or of such tuples, part by part."""
    if a is None:
        return None
    if isinstance(a, tuple):
        return type(a)(*(replaced(one, index, two) for one, two in zip(a, b, strict=True)))
    out = a.copy()
    out[index] = b
    return out


def join(a: Slices, b: Slices) -> Slices:
    """Return the slices of different runs together, in the order of the runs."""

    def both(one: Any, two: Any) -> Any:
        if one is None:
            return None
        if isinstance(one, tuple):
            return type(one)(*(both(x, y) for x, y in zip(one, two, strict=True)))
        return np.concatenate([one, two])

    together = Slices(*(both(one, two) for one, two in zip(a, b, strict=True)))
    return together.take(np.argsort(together.run, kind="stable"))


def sum_by_run(values: Array, run: NDArray[np.int64], runs: int) -> Array:
    """Return the sums (runs, ...) of ``values`` (N, ...) over the slices of each run, in their order."""
    shape = values.shape[1:]
    sums: Array = _sum_by_run(values.reshape(len(values), math.prod(shape)), run, np.empty(runs))
    return sums.reshape(runs, *shape)


@kernel("(n,k),(n),(r)->(r,k)", "dqdd")
def _sum_by_run(values: Array, run: Array, runs: Array, out: Array) -> None:
    """Fill in the sums; of ``runs`` the length counts alone."""
    out[:] = 0.0
    for i in range(len(run)):
        for k in range(values.shape[1]):
            out[run[i], k] += values[i, k]


def normalised(log_weight: Array, run: NDArray[np.int64], runs: int) -> Array:
    """Return weights (N, M) that sum to one in each run, from their logarithms."""
    weight: Array = _normalised(log_weight, run, np.empty(runs))
    return weight


@kernel("(n,m),(n),(r)->(n,m)", "dqdd")
def _normalised(log_weight: Array, run: Array, runs: Array, weight: Array) -> None:
    n, m = log_weight.shape
    top, total = np.full(len(runs), -math.inf), np.zeros(len(runs))
    for i in range(n):
        for j in range(m):
            if log_weight[i, j] != log_weight[i, j]:
                top[run[i]] = math.nan
            elif log_weight[i, j] > top[run[i]]:
                top[run[i]] = log_weight[i, j]
    for i in range(n):
        of_slice = 0.0
        for j in range(m):
            weight[i, j] = math.exp(log_weight[i, j] - top[run[i]])
            of_slice += weight[i, j]
        total[run[i]] += of_slice
    for i in range(n):
        for j in range(m):
            weight[i, j] /= total[run[i]]


def best(weight: Array, run: NDArray[np.int64], runs: int) -> NDArray[np.int64]:
    """Return the index of the likeliest slice of each run, (runs,); the first among equals; -1 for a run without slices."""
    top: NDArray[np.int64] = _best(weight, run, np.empty(runs))
    return top


@kernel("(n,m),(n),(r)->(r)", "dqdq")
def _best(weight: Array, run: Array, runs: Array, top: Array) -> None:
    largest = np.full(len(runs), -1.0)
    top[:] = -1
    for i in range(len(run)):
        size = 0.0
        for j in range(weight.shape[1]):
            size += weight[i, j]
        if size == size and size > largest[run[i]]:
            largest[run[i]] = size
            top[run[i]] = i


class View(NamedTuple):
    """How slices are seen from the best one of their run: xi there is d + K xi.

    In the best slices d = 0 and K = I. If no run has others, both are None.
    """

    top: NDArray[np.int64]  #: (runs,), index of the best slice of each run
    d: Array | None  #: (N, n)
    K: Array | None  #: (N, n, n)
    moving: int  #: number of states that K changes, which come first

    def seen(self, s: Slices) -> Gaussian:
        """Return the Gaussians (N, M, n), (N, M, n, n) of the slices as errors of the INS of the best one."""
        if self.d is None or self.K is None:
            return s.x
        return Gaussian(s.mean @ self.K.mT + self.d[:, None], carried(self.K, s.cov, self.moving))


class Frame:
    """The geometry of the slices: earth, coordinates and error model of an episode."""

    def __init__(self, model: Earth, coordinates: Invariant, errors: NavigationErrors, own: int) -> None:
        self.model, self.coordinates, self.errors = model, coordinates, errors
        self.own = slice(0, own)  #: states of the INS itself; an offset of the fixes follows
        states = errors.states
        self.moving = states["gyro_bias"].start  #: number of states that an epoch changes, which come first
        self._biases = slice(self.moving, own)  # and parameters of aids
        self._units = states.si[self._biases]

    def reset(self, s: Slices) -> Slices:
        """Feed the mean of each slice over its models back into its INS."""
        m = np.zeros((len(s.run), s.mean.shape[-1]))
        m[:, self.own] = conditional_mean(s.weight, s.mean)[:, self.own]
        nav = self.coordinates.corrected(m, s.ins.nav)
        J = right_jacobian(m, self.errors.states)
        return s._replace(
            ins=s.ins._replace(nav=nav),
            bias=s.bias + self._units * m[:, self._biases],
            mean=(s.mean - m[:, None]) @ J.mT,
            cov=carried(J, s.cov, self.moving),
        )

    def difference(self, b: Slices, j: Slices) -> Array:
        """Return d (N, n) with Exp(d) = X_b X_j^-1 for pairs of slices; biases are those of j minus those of b."""
        at, nav = b.ins.nav, j.ins.nav
        x = np.zeros((len(b.run), b.mean.shape[-1]))
        states = self.errors.states
        x[:, states["phi"]] = attitude.misalignment(at.q_nb, nav.q_nb)
        x[:, states["dv"]] = at.vel - nav.vel
        if "dp" in states:
            x[:, states["dp"]] = -earth.offset(self.model, at.pos, nav.pos)
        d = self.coordinates.at(at).invariant(x)
        d[:, self._biases] = (j.bias - b.bias) / self._units
        return d

    def view(self, s: Slices, runs: int) -> View:
        """Return how the slices are seen from the best one of their run."""
        top = best(s.weight, s.run, runs)
        N, n = len(s.run), s.mean.shape[-1]
        other = np.flatnonzero(np.arange(N) != top[s.run])
        if not len(other):
            return View(top, None, None, self.moving)
        d, K = np.zeros((N, n)), np.broadcast_to(np.eye(n), (N, n, n)).copy()
        d[other] = self.difference(s.take(top[s.run[other]]), s.take(other))
        k = slice(self.moving)
        K[other, k, k] = np.linalg.inv(right_jacobian(d[other], self.errors.states)[:, k, k])
        return View(top, d, K, self.moving)

    def mean(self, s: Slices, view: View, runs: int) -> Array:
        """Return the mean (runs, n) of the slices of each run as errors of the INS of its best one."""
        seen = conditional_mean(s.weight, s.mean)
        if view.d is not None and view.K is not None:
            seen = (view.K @ seen[..., None])[..., 0] + view.d
        return sum_by_run(s.weight.sum(axis=-1)[:, None] * seen, s.run, runs)

    def gaussian(self, s: Slices, view: View, runs: int) -> Gaussian:
        """Return mean (runs, n) and covariance (runs, n, n) of the slices of each run as errors of the INS of its best one."""
        one = collapse(_conditional(s.weight), view.seen(s))
        size = s.weight.sum(axis=-1)
        mean = sum_by_run(size[:, None] * one.mean, s.run, runs)
        apart = one.mean - mean[s.run]
        cov = one.cov + apart[..., :, None] * apart[..., None, :]
        return Gaussian(mean, sum_by_run(size[:, None, None] * cov, s.run, runs))

    def innovation(self, reading: Reading, runs: int) -> Innovation:
        """Return the innovation (runs, m) of a reading in the best slice of each run; NaN in a run without one."""
        s, nu, H, R, seen = reading
        one = collapse(_conditional(s.weight), s.x)
        residual, S = nu - (H @ one.mean[..., None])[..., 0], H @ one.cov @ H.mT + R
        top = best(s.weight, s.run, runs)
        gone = ((top < 0) | ~np.isin(top, seen))[:, None]
        return Innovation(np.where(gone, np.nan, residual[top]), np.where(gone[..., None], np.nan, S[top]))

    def tidy(self, s: Slices, runs: int) -> Slices:
        """Drop slices of little weight, and merge those that agree with the best one of their run into it, model by model."""
        view = self.view(s, runs)
        at, x = view.top[s.run], view.seen(s)
        one = collapse(_conditional(s.weight), x)
        own, size = self.own, s.weight.sum(axis=-1)
        is_best = np.arange(len(s.run)) == at
        distance = nis(Innovation((one.mean - one.mean[at])[:, own], one.cov[at][:, own, own]))
        near = is_best | ((distance <= MERGE_WITHIN**2) & (size > PRUNE))
        merged = sum_by_run(near.astype(float), s.run, runs) > 1.5
        if merged.any():
            use, into = near & merged[s.run], view.top[merged]
            s = s.put(into, _merge(s.take(use), Gaussian(x.mean[use], x.cov[use]), s.take(into)))
        several = sum_by_run(np.ones(len(s.run)), s.run, runs) > 1.5
        s = s.take(is_best | (~near & (size > PRUNE)))
        total = np.where(several, sum_by_run(s.weight.sum(axis=-1), s.run, runs), 1.0)
        return s._replace(weight=s.weight / total[s.run][:, None])


def _merge(parts: Slices, x: Gaussian, into: Slices) -> Slices:
    """Return the slices ``into``, one for each run of ``parts``, with the moments of all parts together, model by model.

    ``x`` are the Gaussians of the parts as errors of the INS of their run's slice in ``into``.
    """
    runs = len(into.run)
    place = np.searchsorted(into.run, parts.run)
    total = sum_by_run(parts.weight, place, runs)
    share = parts.weight / np.where(total > 0.0, total, 1.0)[place]
    mean = sum_by_run(share[..., None] * x.mean, place, runs)
    apart = x.mean - mean[place]
    cov = sum_by_run(share[..., None, None] * (x.cov + apart[..., :, None] * apart[..., None, :]), place, runs)
    regimes = sum_by_run(share[..., None] * parts.regimes, place, runs)
    some = total > 0.0
    return into._replace(
        weight=total,
        mean=np.where(some[..., None], mean, into.mean),
        cov=np.where(some[..., None, None], cov, into.cov),
        regimes=np.where(some[..., None], regimes, into.regimes),
    )


def _conditional(weight: Array) -> Array:
    """Return the weights (N, M) of the models of each slice alone."""
    total = weight.sum(axis=-1, keepdims=True)
    some = total > 0.0
    return np.where(some, weight / np.where(some, total, 1.0), 1.0 / weight.shape[-1])


def conditional_mean(weight: Array, mean: Array) -> Array:
    """Return the mean (N, n) of each slice over its models."""
    return np.asarray((_conditional(weight)[:, None, :] @ mean)[:, 0])
