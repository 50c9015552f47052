"""Riccati recursions of many covariances at once: of all sources of error, without one of them, and the share of each.

Members of a stack share F and H. Each has its own start, driving noise and noise of readings. A member with its own gain is a
Riccati recursion. A member with the gain of the first one is a part of its covariance: the recursion

    C <- A (F C F' + Q) A' + K R K',  A = I - K H

is linear in C, Q and R for a given gain, so parts whose starts and noises add up to those of the first member add up to it.
See docs/mathematics/bound.md#budget.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.evaluation.bound.error_dynamics import FIXES, ErrorDynamics, Reading
from sins_env.evaluation.bound.fisher import LEAST_STD
from sins_env.evaluation.planning.sources import Source


class Stack(NamedTuple):
    """Covariances of some members, with the part of each in start and noise."""

    P: Array  #: (members, runs, n, n)
    drives: Mask  #: (members, n) which states are driven
    R: Mapping[str, Array]  #: (members, m, m) by the name of the readings
    own: int  #: number of the first members, which have their own gain; the others have that of the first one


def stack(model: ErrorDynamics, runs: int, budget: Sequence[Source] = ()) -> Stack:
    """Return the stack of all sources; with a budget also without each of its sources, and then of each alone.

    A part without noise of its readings keeps the least noise that a reading may have, so that the gain exists.
    """
    R_all = {FIXES: model.R, **{name: np.diag(term.noise()) for name, (_, term) in model.aids.items()}}
    members: list[tuple[Any, Any, Mapping[str, Mask]]] = [(1, 1, {})]
    members += [(~one.start, ~one.drive, {k: ~rows for k, rows in one.noise.items()}) for one in budget]
    own = len(members)
    members += [(one.start, one.drive, dict(one.noise)) for one in budget]
    P, drives = [], []
    R: dict[str, list[Array]] = {name: [] for name in R_all}
    for i, (start, drive, noise) in enumerate(members):
        P.append(model.P0 * (np.ones(model.n) * start))
        drives.append(np.ones(model.n, dtype=bool) & drive)
        for name, whole in R_all.items():
            rows = noise.get(name, np.full(len(whole), i < own))
            least = LEAST_STD**2 * np.eye(len(whole)) * ~rows if i < own else 0.0
            R[name].append(whole * np.outer(rows, rows) + least)
    shape = (len(members), runs, model.n, model.n)
    return Stack(
        np.broadcast_to(np.array(P)[:, None], shape).copy(),
        np.array(drives),
        {name: np.array(parts) for name, parts in R.items()},
        own,
    )


def predicted(P: Array, F: Array, added: Array) -> Array:
    """Return covariances (members, runs, n, n) after an epoch with F (runs, n, n).

    ``added`` (members, n) is the variance that white noise has added; half of it goes through F, half does not.
    """
    diagonal = np.arange(P.shape[-1])
    P = P.copy()
    P[..., diagonal, diagonal] += 0.5 * added[:, None]
    P = F @ P @ F.mT
    P[..., diagonal, diagonal] += 0.5 * added[:, None]
    return P


def corrected(P: Array, H: Array, R: Array, own: int) -> tuple[Array, Array]:
    """Return covariances after a reading with H (runs, m, n) and R (members, m, m), and the gains of the first members.

    The first ``own`` members have their own gain (own, runs, n, m); the others have that of the first one. It is Joseph's form,
    with I - K H applied to one side and then to the other.
    """
    shown = H @ P
    S = shown[:own] @ H.mT + R[:own, None]
    K = np.asarray(np.linalg.solve(S, shown[:own]).mT, dtype=float)
    gain = K if own == len(P) else np.concatenate([K, np.broadcast_to(K[:1], (len(P) - own, *K.shape[1:]))])
    P = P - gain @ shown
    P = P - (P @ H.mT) @ gain.mT + gain @ R[:, None] @ gain.mT
    return 0.5 * (P + P.mT), K


def advanced(stacked: Stack, F: Array, added: Array, readings: Sequence[Reading], k: int) -> Stack:
    """Return a stack after epoch ``k`` of a chunk with F (runs, n, n), in which ``added`` (n,) variance comes in."""
    P = predicted(stacked.P, F, added * stacked.drives)
    runs = P.shape[1]
    for one in readings:
        if one.there[k]:
            P, _ = corrected(P, one.H[:runs, k], stacked.R[one.name], stacked.own)
    return stacked._replace(P=P)
