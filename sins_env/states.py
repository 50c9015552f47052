"""Layouts of error states: blocks with a name, a size and a unit, which everything else selects by their names.

    ERRORS["dp"]                                     the slice of the position error among the fifteen errors of an INS
    ERRORS.span("dv", "dp")                          the slice of neighbouring blocks
    ERRORS.only("phi", "dv")                         the layout of these blocks alone
    ERRORS.plus(Block("odometer.scale", 1, "1e-3"))  the layout with a block behind the others
    ERRORS.places(layout)                            the indices of another layout's states among these

A further block stands behind the others, so it moves none of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from sins_env.arrays import Array
from sins_env.checks import unknown


@dataclass(frozen=True)
class Block:
    """Neighbouring states of one kind."""

    name: str
    size: int
    unit: str
    si: float = 1.0  #: SI value of one unit


@dataclass(frozen=True)
class Layout:
    """The blocks of a state, in order.

    Raises:
        ValueError: two blocks of one name.
    """

    blocks: tuple[Block, ...]

    def __post_init__(self) -> None:
        twice = [name for name in self.names if self.names.count(name) > 1]
        if twice:
            raise ValueError(f"blocks {', '.join(self.names)}; allowed: one block named {twice[0]!r}")

    @cached_property
    def names(self) -> tuple[str, ...]:
        return tuple(block.name for block in self.blocks)

    @cached_property
    def _named(self) -> dict[str, tuple[Block, slice]]:
        ends = np.cumsum([block.size for block in self.blocks]).tolist()
        return {b.name: (b, slice(end - b.size, end)) for b, end in zip(self.blocks, ends, strict=True)}

    def _find(self, name: str) -> tuple[Block, slice]:
        if name not in self._named:
            raise unknown("block of states", name, self._named)
        return self._named[name]

    @cached_property
    def size(self) -> int:
        """The number of states."""
        return sum(block.size for block in self.blocks)

    @cached_property
    def si(self) -> Array:
        """SI value of one unit of each state, (n,)."""
        return np.repeat([block.si for block in self.blocks], [block.size for block in self.blocks])

    def __contains__(self, name: object) -> bool:
        return name in self._named

    def __getitem__(self, name: str) -> slice:
        """Return the slice of a block.

        Raises:
            ValueError: a name that no block has, with the nearest.
        """
        return self._find(name)[1]

    def span(self, *names: str) -> slice:
        """Return the slice of neighbouring blocks, which are named in their order.

        Raises:
            ValueError: blocks that are not neighbours in this order.
        """
        parts = [self[name] for name in names]
        if any(a.stop != b.start for a, b in pairwise(parts)):
            raise ValueError(f"span of {', '.join(names)}; allowed: neighbours among {', '.join(self.names)}")
        return slice(parts[0].start, parts[-1].stop)

    def only(self, *names: str) -> Layout:
        """Return the layout of these blocks alone, in the order of the names."""
        return Layout(tuple(self._find(name)[0] for name in names))

    def without(self, *names: str) -> Layout:
        """Return the layout of the other blocks."""
        return self.only(*(name for name in self.names if name not in names))

    def plus(self, *blocks: Block) -> Layout:
        """Return the layout with further blocks behind these."""
        return Layout((*self.blocks, *blocks))

    def places(self, other: Layout) -> NDArray[np.int64]:
        """Return the indices (other.size,) of the states of ``other`` in this layout.

        A smaller block holds the first components of the block of its name.

        Raises:
            ValueError: a block that is not among these, or is larger.
        """
        found = []
        for block in other.blocks:
            mine, where = self._find(block.name)
            if block.size > mine.size:
                raise ValueError(f"block {block.name!r} of {block.size} states; allowed: at most {mine.size}")
            found.append(np.arange(where.start, where.start + block.size))
        return np.concatenate(found)

    def values(self, by_block: Mapping[str, ArrayLike]) -> Array:
        """Return values (n,) that are given by block, one for all its states or one for each; the other blocks have zero."""
        out = np.zeros(self.size)
        for name, value in by_block.items():
            out[self[name]] = value
        return out


#: The errors of an INS that every prior tells, E, N, U and in body axes R, F, U.
ERRORS = Layout(
    (
        Block("phi", 3, "rad"),
        Block("dv", 3, "m/s"),
        Block("dp", 3, "m"),
        Block("gyro_bias", 3, "rad/s"),
        Block("accel_bias", 3, "m/s^2"),
    )
)
#: The errors that a fix shows, in its own order.
FIX = ERRORS.only("dv", "dp")
#: The errors of an attitude, and those of a navigation answer: what is scored, and what ``covariance()`` is of.
ATTITUDE, NAVIGATION = ERRORS.only("phi"), ERRORS.only("phi", "dv", "dp")


def answered(navigate: bool) -> Layout:
    """Return the layout of the errors of an answer: of its attitude alone, or with velocity and position."""
    return NAVIGATION if navigate else ATTITUDE
