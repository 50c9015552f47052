"""Moments of y = g(x) in factored form, for filters that carry a root S of the covariance P = S S' and never P.

Points come in pairs at +-r s_p, with s_p the columns of S. The odd part of their images makes the slope T, the even part
the rest U. Then cov(y) = T T' + U U' and cov(x, y) = S T', and one update serves all rules. Equations 000 (3.3.10-46);
docs/mathematics/filters.md#square-roots.
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
    """Factored moments of y = g(x): cov(y) = slope slope' + rest rest' and cov(x, y) = S slope'."""

    mean: Array  #: (..., m)
    slope: Array  #: (..., m, n), T
    rest: Array | None  #: (..., m, k), U; None: zero


class FactorRule(Protocol):
    """How N(mean, S S') passes through a function that is not ``Linear``."""

    def factors(self, g: Function, mean: Array, S: Array) -> Factors:
        """Return the factored moments of g(x) for x ~ N(mean, S S'): mean (..., n), S (..., n, n)."""
        ...


def factors(g: Function, mean: Array, S: Array, rule: FactorRule) -> Factors:
    """Return the factored moments of g(x) for x ~ N(mean, S S'); every rule maps ``Linear`` functions exactly."""
    if isinstance(g, Linear):
        return Factors(g(mean), g.matrix @ S, None)
    return rule.factors(g, mean, S)


def beside(*blocks: Array | None) -> Array:
    """Put matrices (..., m, k) side by side; batch axes are broadcast, and None is left out."""
    there = [block for block in blocks if block is not None]
    batch = np.broadcast_shapes(*{block.shape[:-2] for block in there})
    edges = np.cumsum([block.shape[-1] for block in there]).tolist()
    out = np.empty((*batch, there[0].shape[-2], edges[-1]))
    for block, end in zip(there, edges, strict=True):
        out[..., end - block.shape[-1] : end] = block
    return out


@dataclass(frozen=True)
class Differences:
    """Stirling's interpolation of g to first or second order: 000 (3.3.16-34)."""

    interval: float  #: distance of the points from the mean, in columns of S
    second: bool  #: whether to keep the second-order terms

    def factors(self, g: Function, mean: Array, S: Array) -> Factors:
        h = self.interval
        centre, plus, minus = _images(g, mean, S, _grid(h, mean.shape[-1]))
        slope = (plus - minus).mT / (2.0 * h)
        if not self.second:
            return Factors(centre, slope, None)
        bend = plus + minus - 2.0 * centre[..., None, :]
        rest = math.sqrt(h * h - 1.0) / (2.0 * h * h) * bend.mT  # 000 (3.3.24), docs/mathematics/errata.md no. 21
        return Factors(centre + bend.sum(axis=-2) / (2.0 * h * h), slope, rest)


@dataclass(frozen=True)
class PairedPoints:
    """The factors of a sigma-point rule whose outer points are pairs on the axes with one positive weight.

    The moments are those that ``SigmaPoints`` gives with the same root.
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
    """Return g at the centre (..., m) and on both sides (..., n, m); a rule without a centre takes the mean image."""
    n, first = mean.shape[-1], int(p.centre)
    y = g(draw(mean, S, p))
    plus, minus = y[..., first : first + n, :], y[..., first + n :, :]
    return (y[..., 0, :] if p.centre else y.mean(axis=-2)), plus, minus


@cache
def _grid(interval: float, n: int) -> Points:
    return points(Unscented(interval / math.sqrt(n)), n)  # a centre, and pairs at the interval


@cache
def pairs(rule: PointRule, n: int) -> Points:
    """Return the points of ``rule`` in n dimensions.

    Raises:
        ValueError: the rule has no square-root form, because its covariance is not a sum of squares.
    """
    p = points(rule, n)
    if p.equal is None or p.radius is None or p.equal < 0.0 or (p.centre and p.pull < 0.0):
        raise ValueError(
            f"{rule} has no square-root form in {n} dimensions, for its covariance is no sum of squares; allowed:"
            " equal weights on pairs of points, and beta + alpha^2 kappa / n >= 0"
        )
    return p
