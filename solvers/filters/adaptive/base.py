"""What the adaptive filters share: they estimate the noise that they are told, and filter with the estimate.

A filter predicts with the estimated q and Q and corrects with the estimated r and R. Then the fix says something about the
noise (solvers/blocks/noise.py). Each filter's ``blend`` says how it remembers that.

Safeguards, without which 000 (3.4.45-48) is unusable (docs/mathematics/filters.md#adaptive-noise, and no. 33 of
docs/mathematics/errata.md#chapter-3):

- ``k0``: the told noise counts as so many fixes. Otherwise the first fix alone would replace it.
- ``project``: "diagonal" adapts the variances and keeps the told correlations, "full" adapts the eigenvalues. Both stay
  within ``floor`` and ``cap`` times the told ones, so that a noise told to be zero, such as a bias, stays zero. With "none"
  nothing is bounded, and an estimate that turns indefinite is counted as a repair at each use.
- ``guard``: "damp" scales each correction by the largest share that the noise can have in it. Without it a filter that is
  told the true noise gets worse, because it takes the errors of its start for noise. With "positive", a variance that hits
  its floor is replaced by the biased but positive statistic.
- ``gate``: an innovation beyond this quantile of chi-square counts as if it lay there.

Between fixes the noise adds up, so a fix after several epochs speaks of the sum. If a transition has a matrix G, the noise is
estimated in the driven directions: q_w = G+ q and Q_w = G+ Q G+'.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from sins_env.checks import choice, items, keep, number, unknown, whole
from solvers.blocks import noise as noises
from solvers.blocks.moments import SigmaPoints
from solvers.blocks.noise import Noise
from solvers.blocks.sigma_rules import Unscented
from solvers.blocks.square_root import indefinite
from solvers.filters.base import count
from solvers.filters.gaussian import GaussianFilter, initial_belief
from solvers.types import MISSING, Gaussian, Health, Innovation, Measurement, Transition

PARTS = ("q", "Q", "r", "R")
Past = tuple[Array, Array]  #: remembered statistics of a mean and of a covariance, each (..., slots, elements)


@dataclass(frozen=True)
class Told:
    """The process noise that a transition tells. It is one value for all runs, so a belief holds it as it is."""

    Q: Array  #: (..., p, p), along the driven directions
    inverse: Array | None  #: (p, n), pseudo-inverse of G; None: G = I

    @classmethod
    def by(cls, tr: Transition) -> Told:
        """Take the told noise out of a transition."""
        if tr.G is None:
            return cls(tr.Q, None)
        inverse = cast(Array, np.linalg.pinv(tr.G))
        return cls(inverse @ tr.Q @ inverse.T, inverse)


class AdaptiveBelief(NamedTuple):
    """One Gaussian, the estimated noise, and what the filter remembers of it."""

    mean: Array  #: (..., n)
    cov: Array  #: (..., n, n)
    health: Health
    noise: Noise  #: noise in use; parts that are not adapted are the told ones
    past: tuple[Past, Past]  #: memory for (q, Q) and for (r, R), beside the estimates themselves
    told: Told | None  #: told process noise; None before the first epoch
    fixes: NDArray[np.int64]  #: (...), number of fixes so far plus k0
    idle: NDArray[np.int64]  #: (...), number of epochs since the last fix
    gated: NDArray[np.int64]  #: (...), number of innovations beyond the gate so far


@dataclass(frozen=True)
class AdaptiveFilter(GaussianFilter[Any]):
    """Base of the adaptive filters; the moment rule is the unscented one.

    Raises:
        ValueError: a setting outside its range.
    """

    adapt: str | tuple[str, ...] = "Q"  #: which of q, Q, r, R are estimated: "Q", "qQ", ["q", "Q"], or "none"
    k0: int = 20  #: number of fixes that the told noise counts for
    floor: float = 1e-6  #: least variance, relative to the told one
    cap: float = 1e2  #: largest variance, relative to the told one
    project: str = "diagonal"  #: "diagonal", "full" or "none"
    guard: str = "damp"  #: "damp", "positive" or "none"
    gate: float = 0.999  #: probability that a good innovation lies within the gate; 1: no gate
    alpha: float = 1.0  #: spread of the points, > 0
    beta: float = 0.0  #: 2 suits the fourth moment of a Gaussian; 0 uses the covariance alone
    kappa: float = 0.0  #: second spread parameter, > -n
    root: str = "cholesky"  #: "cholesky" or "svd", which takes a singular covariance

    def __post_init__(self) -> None:
        _ = self.rule  # checks the settings
        keep(self, "adapt", _parts)
        keep(self, "project", choice, noises.PROJECTIONS)
        keep(self, "guard", choice, noises.GUARDS)
        keep(self, "k0", whole, least=0)
        keep(self, "floor", number, least=0.0, most=1.0)
        keep(self, "cap", number, least=1.0)
        keep(self, "gate", number, above=0.0, most=1.0)

    @cached_property
    def adapted(self) -> tuple[str, ...]:
        """The parts of the noise that are estimated, out of q, Q, r, R."""
        return () if self.adapt == "none" else tuple(self.adapt)

    @cached_property
    def rule(self) -> SigmaPoints:
        return SigmaPoints(Unscented(self.alpha, self.beta, self.kappa), self.root)

    @abstractmethod
    def blend(self, now: Array, new: Array, past: Array, k: NDArray[np.int64]) -> tuple[Array, Array]:
        """Return the estimate (..., s) after the statistic ``new``, the k-th of its run, and the past to keep.

        The past has the shape (..., slots, s). ``now`` (..., s) is the estimate before, and k has the shape (...).
        """

    def init(self, prior: Gaussian, rng: Any = None) -> AdaptiveBelief:
        """Make the belief at the start. The noise is zero until the model tells it; ``rng`` is not used."""
        b = initial_belief(prior)
        batch = b.mean.shape[:-1]
        nothing = Gaussian(np.zeros((*batch, 1)), np.zeros((*batch, 1, 1)))
        zeros = np.zeros(batch, dtype=np.int64)
        empty = np.zeros((*batch, 1, 1)), np.zeros((*batch, 1, 1))
        return AdaptiveBelief(*b, Noise(nothing, nothing), (empty, empty), None, zeros + self.k0, zeros, zeros)

    def propagate(self, b: Any, tr: Transition) -> Any:
        """Predict with the noise in use, whose Q is in ``tr``."""
        return super().predict(b, tr)

    def shift(self, b: Any, q: Array) -> Any:
        """Move the prediction by the mean (..., n) of the noise."""
        return b._replace(mean=b.mean + q)

    def update(self, b: Any, me: Measurement) -> tuple[Any, Innovation]:
        """Correct with the noise in use, which is in ``me``."""
        return super().correct(b, me)

    def checked(self, b: Any, tr: Transition, me: Measurement | None) -> tuple[Transition, Measurement | None]:
        tr, me = super().checked(b, tr, me)
        if me is not None and ("R" in self.adapted or "r" in self.adapted) and (b.fixes > self.k0).any():
            refuse_another_size(me, b.noise.v.mean.shape[-1])
        return tr, me

    def predict(self, b: AdaptiveBelief, tr: Transition) -> AdaptiveBelief:
        told = Told.by(tr)
        w = self._believed_w(b, told)
        q, Q = self._driven(b, w, tr)
        b = b._replace(noise=b.noise._replace(w=w), told=told, idle=b.idle + 1)
        x = count(self.propagate(b, tr._replace(Q=Q)), self._indefinite("Q", w.cov))
        return x if q is None else self.shift(x, q)

    def process_noise(self, b: AdaptiveBelief, tr: Transition) -> Gaussian:
        """Return the estimated noise w of the next epoch, for all states: mean (..., n), covariance (..., n, n)."""
        q, Q = self._driven(b, self._believed_w(b, Told.by(tr)), tr)
        return Gaussian(np.zeros_like(b.mean) if q is None else q, _each(Q, b))

    def _believed_w(self, b: AdaptiveBelief, told: Told) -> Gaussian:
        """Return the noise w that is assumed, along the driven directions; it is the told one before any fix."""
        w = b.noise.w
        if b.told is None or "Q" not in self.adapted:
            w = w._replace(cov=_each(told.Q, b))
        return w._replace(mean=np.zeros(w.cov.shape[:-1])) if b.told is None else w

    def _driven(self, b: AdaptiveBelief, w: Gaussian, tr: Transition) -> tuple[Array | None, Array]:
        """Return mean (..., n) and covariance of G w; if not adapted, the mean is None and the covariance the told one."""
        G, q, Q = tr.G, None, tr.Q
        if "q" in self.adapted:
            q = w.mean if G is None else w.mean @ G.T
        if "Q" in self.adapted and b.told is not None:
            Q = w.cov if G is None else G @ w.cov @ G.T
        return q, Q

    def correct(self, b: AdaptiveBelief, me: Measurement) -> tuple[AdaptiveBelief, Innovation]:
        b = b._replace(noise=b.noise._replace(v=self._told_v(b, me.R)))
        v, used = b.noise.v, me
        if "R" in self.adapted:
            used = used._replace(R=v.cov)
        if "r" in self.adapted:
            used = used._replace(z=me.z - v.mean)
        x, innovation = self.update(b, used)
        x = count(x, self._indefinite("R", v.cov))
        if self.adapted and b.told is not None:
            x = self._learn(b, x, innovation, me.R)
        return x._replace(fixes=b.fixes + 1, idle=np.zeros_like(b.idle)), innovation

    def correct_rows(self, b: AdaptiveBelief, me: Measurement, rows: Mask) -> tuple[AdaptiveBelief, Innovation]:
        """Correct by the components in the mask (m,); what is known of the noise of the others stays."""
        if rows.all():
            return super().correct_rows(b, me, rows)
        at, m = np.flatnonzero(rows), len(rows)
        untold = noises.variances(me.R) >= MISSING  # a variance that only marks what is missing; zero: not known yet
        R = np.where(untold[..., :, None] | untold[..., None, :], 0.0, me.R)
        noise, past = b.noise._replace(v=self._told_v(b, R)), b.past[1]
        cells = at if self.project == "diagonal" else (m * at[:, None] + at).ravel()  # of a covariance in the memory
        known = tuple(_memory(new, old) for new, old in zip((noise.v.mean, self._flat(noise.v.cov)), past, strict=True))
        part = Gaussian(noise.v.mean[..., at], noise.v.cov[..., at[:, None], at])
        few = known[0][..., at], known[1][..., cells]
        x, seen = super().correct_rows(b._replace(noise=noise._replace(v=part), past=(b.past[0], few)), me, rows)
        v = Gaussian(noise.v.mean.copy(), noise.v.cov.copy())
        v.mean[..., at], v.cov[..., at[:, None], at] = x.noise.v
        kept = tuple(_memory(old, new) for old, new in zip(known, x.past[1], strict=True))
        for memory, places, new in zip(kept, (at, cells), x.past[1], strict=True):
            memory[..., places] = new
        return x._replace(noise=x.noise._replace(v=v), past=(x.past[0], kept)), seen

    def _flat(self, cov: Array) -> Array:
        """Return the elements of a covariance that the memory holds."""
        return noises.variances(cov) if self.project == "diagonal" else cov.reshape(*cov.shape[:-2], -1)

    def _told_v(self, b: AdaptiveBelief, R: Array) -> Gaussian:
        """Return the noise v that is assumed before this fix; it is the told one before the first."""
        v, new = b.noise.v, b.fixes == self.k0
        if "R" not in self.adapted or new.all():
            v = v._replace(cov=_each(R, b))
        else:  # a component that was missing so far has no variance yet
            unknown = new[..., None] | (noises.variances(v.cov) == 0.0)
            if unknown.any():
                v = v._replace(cov=np.where(unknown[..., :, None] | unknown[..., None, :], R, v.cov))
        return v._replace(mean=np.where(new[..., None], np.zeros(v.cov.shape[:-1]), v.mean)) if new.any() else v

    def diagnostics(self, b: AdaptiveBelief) -> dict[str, Array]:
        """Return the noise in use: means, and variances with ``project`` "diagonal", else covariances."""
        w, v = b.noise
        cov = noises.variances if self.project == "diagonal" else np.asarray
        return {"q": w.mean, "Q": cov(w.cov), "r": v.mean, "R": cov(v.cov), "gated": b.gated.astype(float)}

    def _learn(self, b: AdaptiveBelief, x: AdaptiveBelief, innovation: Innovation, R: Array) -> AdaptiveBelief:
        """Return ``x`` with the noise as estimated after the fix that led from ``b`` to ``x``."""
        assert b.told is not None  # for mypy
        counted, beyond = noises.gated(innovation, self.gate)
        residual, S = counted[..., None] * innovation.residual, innovation.cov
        step, spent = counted[..., None] * (x.mean - b.mean), b.cov - x.cov  # K e and K S K'
        if b.told.inverse is not None:
            step, spent = step @ b.told.inverse.T, b.told.inverse @ spent @ b.told.inverse.T
        k, one, epochs = b.fixes + 1, np.ones(b.idle.shape), np.maximum(b.idle, 1.0)
        w, past_w = self._absorb("qQ", b.noise.w, Gaussian(step, spent), epochs, b.told.Q, b.past[0], k)
        v, past_v = self._absorb("rR", b.noise.v, Gaussian(residual, S), one, R, b.past[1], k)
        x = count(x, fallbacks=beyond if beyond.any() else None)
        return x._replace(noise=Noise(w, v), past=(past_w, past_v), gated=b.gated + beyond)

    def _absorb(
        self, parts: str, now: Gaussian, moved: Gaussian, epochs: Array, told: Array, past: Past, k: NDArray[np.int64]
    ) -> tuple[Gaussian, Past]:
        """Return one noise and its memory after a correction ``moved``, given with its expected covariance."""
        mean, cov = now
        past_mean, past_cov = past
        if parts[0] in self.adapted or parts[1] in self.adapted:
            new = self.statistic(now, moved, epochs)
        if parts[0] in self.adapted:
            mean, past_mean = self.blend(mean, new.mean, past_mean, k)
            mean = noises.bound_mean(mean, told, self.cap) if self.project != "none" else mean
        if parts[1] in self.adapted:
            found, past_cov = self._blend_cov(cov, new.cov, past_cov, k)
            if self.guard == "positive":
                biased, _ = self._blend_cov(cov, noises.least(moved, epochs), past[1], k)
                found = noises.replace_low(found, biased, self.floor * noises.variances(told))
            cov = noises.bound(found, told, self.floor, self.cap, self.project)
        return Gaussian(mean, cov), (past_mean, past_cov)

    def statistic(self, now: Gaussian, moved: Gaussian, epochs: Array) -> Gaussian:
        """Return the statistic of one noise; see :func:`solvers.blocks.noise.statistic`."""
        return noises.statistic(now, moved, epochs, self.guard == "damp")

    def _blend_cov(self, now: Array, new: Array, past: Array, k: NDArray[np.int64]) -> tuple[Array, Array]:
        """Blend covariances; if only variances are adapted the memory holds diagonals, which keeps it small."""
        p = now.shape[-1]
        if self.project == "diagonal":
            variance, past = self.blend(noises.variances(now), noises.variances(new), past, k)
            return variance[..., None] * np.eye(p), past
        flat, past = self.blend(now.reshape(*now.shape[:-2], p * p), new.reshape(*new.shape[:-2], p * p), past, k)
        return flat.reshape(now.shape), past

    def _indefinite(self, part: str, cov: Array) -> Mask | None:
        return indefinite(cov) if self.project == "none" and part in self.adapted else None


def refuse_another_size(me: Measurement, learnt: int) -> None:
    """Refuse a fix of another size than those whose noise has been learnt.

    Raises:
        ValueError: the size differs.
    """
    if me.z.shape[-1] != learnt:
        raise ValueError(
            f"z has {me.z.shape[-1]} components, and the noise of {learnt} has been learnt: needed z, h and R of the same {learnt}"
            " at each fix, with those that it lacks marked by `present`, or settings that learn no noise of fixes"
        )


def _memory(elements: Array, past: Array) -> Array:
    """Return a memory (..., slots, s) for elements (..., s) or a memory of them, with as many slots as ``past``."""
    if elements.ndim < past.ndim:
        elements = elements[..., None, :]
    if past.shape[-1] == elements.shape[-1] and past.shape[-2] != 1:
        return past.copy()
    return (
        np.repeat(elements[..., :1, :], past.shape[-2], axis=-2)
        if elements.shape[-2] != past.shape[-2]
        else elements.copy()
    )


def _each(matrix: Array, b: AdaptiveBelief) -> Array:
    """Copy ``matrix`` (p, p) or (..., p, p) for every run."""
    return np.broadcast_to(matrix, (*b.mean.shape[:-1], *matrix.shape[-2:])).copy()


def _parts(name: str, given: Any) -> str | tuple[str, ...]:
    """Check the setting ``adapt``, which may be a list, for JSON has no tuples."""
    parts = given if isinstance(given, str) else items(given)
    for part in [] if given == "none" else [given] if parts is None else parts:
        if part not in PARTS:
            raise unknown(name, part, [*PARTS, "none"])
    return parts if isinstance(parts, str) else tuple(parts or ())
