"""Moments of y = g(x) in factored form, for filters that carry a root S of the covariance, P = S S', and never P.

Points in pairs at +-r s_p, the columns s_p of S, give every such rule the same form: odd parts make the slope, even
parts the rest. With cov(y) = T T' + U U' and cov(x, y) = S T', the update is one for all. # 000 (3.3.10-46)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple, Protocol, cast

import numpy as np

from sins_env.arrays import Array
from solvers.blocks.moments import draw
from solvers.blocks.sigma_rules import PointRule, Points, Unscented, points
from solvers.types import Function, Linear


class Factors(NamedTuple):
    """cov(y) = slope slope' + rest rest', cov(x, y) = S slope'."""

    mean: Array  #: (..., m)
    slope: Array  #: (..., m, n) T
    rest: Array | None  #: (..., m, k) U; None: nothing


class FactorRule(Protocol):
    """How N(mean, S S') passes through a function that is not ``Linear``."""

    def factors(self, g: Function, mean: Array, S: Array) -> Factors: ...


def factors(g: Function, mean: Array, S: Array, rule: FactorRule) -> Factors:
    """The factored moments of g(x), x ~ N(mean, S S'); ``Linear`` is mapped exactly under every rule."""
    if isinstance(g, Linear):
        return Factors(g(mean), g.matrix @ S, None)
    return rule.factors(g, mean, S)


def beside(*blocks: Array | None) -> Array:
    """The matrices (..., m, k) side by side; batch axes are broadcast, None is left out."""
    there = [block for block in blocks if block is not None]
    batch = np.broadcast_shapes(*{block.shape[:-2] for block in there})
    edges = np.cumsum([block.shape[-1] for block in there]).tolist()
    out = np.empty((*batch, there[0].shape[-2], edges[-1]))
    for block, end in zip(there, edges, strict=True):
        out[..., end - block.shape[-1] : end] = block
    return out


@dataclass(frozen=True)
class Differences:
    """Stirling's interpolation of g to first or second order on steps of ``interval`` columns. # 000 (3.3.16-34)"""

    interval: float
    second: bool

    def factors(self, g: Function, mean: Array, S: Array) -> Factors:
        h = self.interval
        centre, plus, minus = _images(g, mean, S, _grid(h, mean.shape[-1]))
        slope = (plus - minus).mT / (2.0 * h)
        if not self.second:
            return Factors(centre, slope, None)
        bend = plus + minus - 2.0 * centre[..., None, :]
        rest = math.sqrt(h * h - 1.0) / (2.0 * h * h) * bend.mT  # 000 (3.3.24) corrected: h^4 under the root
        return Factors(centre + bend.sum(axis=-2) / (2.0 * h * h), slope, rest)


@dataclass(frozen=True)
class PairedPoints:
    """A sigma-point rule whose outer points are pairs on the axes with one positive weight, like ``Cubature``.

    The moments are those of ``SigmaPoints`` on the same root.
    """

    rule: PointRule

    def factors(self, g: Function, mean: Array, S: Array) -> Factors:
        p = pairs(self.rule, mean.shape[-1])
        centre, plus, minus = _images(g, mean, S, p)
        w = math.sqrt(0.5 * cast(float, p.equal))  # half the weight of a pair's odd and even parts
        slope = w * (plus - minus).mT
        bend = plus + minus - 2.0 * centre[..., None, :]
        e = cast(float, p.equal) * bend.sum(axis=-2)
        rest = w * (bend - (2.0 / p.total) * e[..., None, :]).mT
        if p.centre and p.pull:
            rest = beside(rest, math.sqrt(p.pull) * e[..., None])
        return Factors(centre + e, slope, rest)


def _images(g: Function, mean: Array, S: Array, p: Points) -> tuple[Array, Array, Array]:
    """g at the centre (..., m) and on both sides (..., n, m); without a centre the average of all stands for it."""
    n, first = mean.shape[-1], int(p.centre)
    y = g(draw(mean, S, p))
    plus, minus = y[..., first : first + n, :], y[..., first + n :, :]
    return (y[..., 0, :] if p.centre else y.mean(axis=-2)), plus, minus


@cache
def _grid(interval: float, n: int) -> Points:
    return points(Unscented(interval / math.sqrt(n)), n)  # a centre, and pairs at the interval


@cache
def pairs(rule: PointRule, n: int) -> Points:
    """The points of ``rule``, if they can be factored."""
    p = points(rule, n)
    if p.equal is None or p.radius is None or p.equal < 0.0 or (p.centre and p.pull < 0.0):
        raise ValueError(
            f"{rule} has no square-root form in {n} dimensions, for its covariance is no sum of squares; allowed:"
            " equal weights on pairs of points, and beta + alpha^2 kappa / n >= 0"
        )
    return p
