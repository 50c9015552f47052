"""The network: innovations in, factors of the told noises out.

At a fix, with the innovation nu, the predicted covariance H P H' and the told R = diag(sigma^2), it sees only what does not
change if the axes are turned or mirrored:

    e = nu / sigma,   mean of e^2,   mean of diag(H P H') / sigma^2,   the same of the trend,   and two cosines:
    of e with the last e, and of e with the trend up to then, t <- t + SHARE (e - t).

A gated recurrent unit (Cho et al. 2014, doi:10.3115/v1/D14-1179) remembers. Its answers are log factors of R, for this fix, and of
the told noises of gyros and accelerometers, for the next epoch. With the answer 0 the filter is the told one.

NumPy and PyTorch share these lines: ``xp`` is either, and arrays are of its kind.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

FEATURES, SIZE, ANSWERS = 5, 24, 3
LIMITS = (12.0, 8.0, 16.0)  #: largest size of the log factors of R, of the gyros' noise and of the accelerometers'
SHARE = 0.1  #: share of a fix in the trend
LEAST = 1e-6  #: added to what a logarithm is taken of

#: The weights by name, with their shapes.
SHAPES = {
    "gates": (2 * SIZE, FEATURES + SIZE + 1),  # update and reset, each from features, memory and 1
    "candidate": (SIZE, FEATURES + SIZE + 1),
    "answer": (ANSWERS, SIZE + 1),
}
Weights = Mapping[str, Any]


class Memory(NamedTuple):
    """What the network remembers from fix to fix."""

    state: Any  #: (..., SIZE)
    last: Any  #: (..., 3), e of the last fix
    trend: Any  #: (..., 3)


def read(path: str | Path) -> dict[str, np.ndarray]:
    """Return the weights of an NPZ file in float64.

    Raises:
        ValueError: a name or a shape that this network does not have.
    """
    with np.load(path, allow_pickle=False) as file:
        found = {name: file[name].astype(np.float64) for name in file.files}
    shapes = {name: value.shape for name, value in found.items()}
    if shapes != SHAPES:
        raise ValueError(f"{path} holds {shapes}; allowed: {SHAPES}")
    return found


def blank(batch: tuple[int, ...]) -> Memory:
    """Return the memory before the first fix."""
    return Memory(np.zeros((*batch, SIZE)), np.zeros((*batch, 3)), np.zeros((*batch, 3)))


def answer(xp: Any, weights: Weights, memory: Memory, e: Any, spread: Any) -> tuple[Any, Memory]:
    """Return the log factors (..., 3) of R, gyro noise and accelerometer noise, and the memory after the fix.

    Args:
        xp: ``numpy`` or ``torch``.
        weights: arrays of :data:`SHAPES`.
        memory: before the fix.
        e: innovation over the told standard deviations of the fix, (..., 3).
        spread: mean of the predicted variances over the told ones of the fix, (...).
    """
    trend = memory.trend + SHARE * (e - memory.trend)
    white = SHARE / (2.0 - SHARE)  # the variance of the trend of white e
    seen = [_log(xp, _mean_square(e)), _log(xp, spread), _log(xp, _mean_square(trend) / white)]
    x = xp.stack([*seen, _cosine(xp, e, memory.last), _cosine(xp, e, memory.trend)], -1)
    one, state = xp.ones_like(x[..., :1]), memory.state
    update, reset = _halves(_sigmoid(xp, _linear(xp, weights["gates"], x, state, one)))
    candidate = xp.tanh(_linear(xp, weights["candidate"], x, reset * state, one))
    state = state + update * (candidate - state)
    shares = xp.tanh(_linear(xp, weights["answer"], state, one))
    return xp.stack([limit * shares[..., i] for i, limit in enumerate(LIMITS)], -1), Memory(state, e, trend)


def _linear(xp: Any, W: Any, *parts: Any) -> Any:
    """Return W x for x of several parts: a product for each run, so that a run has the same bits in any batch."""
    return (W @ xp.concatenate(parts, -1)[..., None])[..., 0]


def _halves(x: Any) -> tuple[Any, Any]:
    return x[..., :SIZE], x[..., SIZE:]


def _sigmoid(xp: Any, x: Any) -> Any:
    return 0.5 + 0.5 * xp.tanh(0.5 * x)


def _mean_square(e: Any) -> Any:
    return (e * e).sum(-1) / 3.0


def _log(xp: Any, x: Any) -> Any:
    """Return a logarithm of about unit size."""
    return 0.25 * xp.log(x + LEAST)


def _cosine(xp: Any, a: Any, b: Any) -> Any:
    return (a * b).sum(-1) / xp.sqrt((a * a).sum(-1) * (b * b).sum(-1) + LEAST)
