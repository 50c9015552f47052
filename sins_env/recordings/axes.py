"""Frames of recorded files: the directions of the sensors' axes, and North-East-Down against East-North-Up."""

from __future__ import annotations

import re

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.checks import refused

_UNIT = {"R": (1, 0, 0), "F": (0, 1, 0), "U": (0, 0, 1), "L": (-1, 0, 0), "B": (0, -1, 0), "D": (0, 0, -1)}
_SIGNED = re.compile(r"([+-][xyz])([+-][xyz])([+-][xyz])")
ALLOWED = (
    "where x, y, z point, three letters of R L F B U D (FRD, RFU, FLU ...), or right, forward, up in terms of them "
    "(+y+x-z for FRD); right-handed"
)


def to_rfu(axes: str) -> Array:
    """Return the matrix (3, 3) from a file's components to Right-Forward-Up.

    ``axes`` has one letter for the direction of each of the file's x, y, z: "BRU" is backward, right, up. It may also be a
    signed permutation that names the components right, forward and up: "+y-x+z" is the same.

    Raises:
        ValueError: anything else, or axes that are not right-handed. With mirrored axes nobody knows whether the gyros
            follow the right-hand rule.
    """
    text = axes if isinstance(axes, str) else ""
    signed = _SIGNED.fullmatch(text.lower())
    if signed:
        turn = np.zeros((3, 3))
        for row, part in enumerate(signed.groups()):
            turn[row, "xyz".index(part[1])] = -1.0 if part[0] == "-" else 1.0
    elif len(text) == 3 and set(text.upper()) <= _UNIT.keys():
        turn = np.array([_UNIT[letter] for letter in text.upper()], dtype=float).T
    else:
        raise refused("axes", axes, ALLOWED)
    if round(np.linalg.det(turn)) != 1:
        raise refused("axes", axes, ALLOWED)
    return turn


def turned(vectors: Array, turn: Array) -> Array:
    """Return ``vectors @ turn.T``, (..., 3), for a signed permutation, without the copies and zeros of a product."""
    out = np.empty(vectors.shape)
    for i, column in enumerate(np.abs(turn).argmax(axis=1)):
        np.multiply(vectors[..., column], turn[i, column], out=out[..., i])
    return out


def swap_ned(vectors: Array) -> Array:
    """Turn North-East-Down into East-North-Up, or back, (..., 3)."""
    return vectors[..., [1, 0, 2]] * np.array([1.0, 1.0, -1.0])


def swap_ned_attitude(q_nb: Array) -> Array:
    """Turn the attitude (..., 4) of a Right-Forward-Up body in ENU into that of a Forward-Right-Down body in NED, or back.

    C' = T C T with the swap T, which is a half turn about (1, 1, 0) and its own inverse.
    """
    return q_nb[..., [0, 2, 1, 3]] * np.array([1.0, 1.0, 1.0, -1.0])


def heading_pitch_roll(q_nb: Array) -> Array:
    """Read heading in [0, 2 pi), pitch and roll, rad, (..., 3), from an attitude (..., 4).

    They equal yaw, pitch and roll of a Forward-Right-Down body in North-East-Down. These are the same three rotations of
    the same vehicle, in other axes.
    """
    heading, pitch, roll = attitude.to_euler(attitude.to_dcm(q_nb))
    return np.stack([heading % (2 * np.pi), pitch, roll], axis=-1)
