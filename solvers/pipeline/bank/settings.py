"""The settings of the bank: one value, which is checked once and which all parts read."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sins_env.checks import flag, items, keep, number, numbers, refused
from solvers.pipeline import coarse as coarse_methods

PAIRS = "pairs of finite numbers > 0, at least one"
WITH_ONE = "finite numbers > 0 with 1.0 among them"


@dataclass(frozen=True)
class BankSettings:
    """Settings of the bank.

    ``spacing_deg``: largest width of a slice of headings.
    ``imu_factors``: factors of the told variances of (gyros, accelerometers); the first pair is the likeliest by far.
    ``fix_factors``: factors of the told variance of a fix, 1 among them.
    ``fix_offsets``: whether the velocity of fixes may be off by a constant for some seconds.
    ``stillness``: whether a base that is seen to stand still has no velocity and no rate, and one that is seen to be parked but
    rocked no lasting velocity (:mod:`solvers.pipeline.aiding.stillness`).
    ``coarse``: method of the coarse phase (:mod:`solvers.pipeline.coarse`), after which its epochs are filtered again around
    what it found; None: no coarse phase.
    ``bias_walk``: whether the biases wander as fast as told Gauss-Markov biases do.

    Raises:
        ValueError: a value that is not allowed.
    """

    spacing_deg: float = 20.0
    imu_factors: Sequence[Sequence[float]] = ((1.0, 1.0), (1.0, 0.01), (30.0, 0.01), (30.0, 1e-4))
    fix_factors: Sequence[float] = (0.01, 0.1, 1.0, 10.0, 100.0)
    fix_offsets: bool = True
    stillness: bool = False
    coarse: str | None = None
    bias_walk: bool = False

    def __post_init__(self) -> None:
        keep(self, "spacing_deg", number, least=0.5, most=360.0)  # a slice has an inertial solution of its own
        keep(self, "imu_factors", _pairs)
        keep(self, "fix_factors", numbers, None, WITH_ONE, above=0.0)
        if 1.0 not in self.fix_factors:
            raise refused("fix_factors", self.fix_factors, WITH_ONE)
        keep(self, "fix_offsets", flag)
        keep(self, "stillness", flag)
        keep(self, "bias_walk", flag)
        if self.coarse is not None:
            coarse_methods.check_method(self.coarse)


def _pairs(name: str, given: Any) -> tuple[tuple[float, ...], ...]:
    rows = items(given)
    if not rows:
        raise refused(name, given, PAIRS)
    return tuple(numbers(name, row, 2, PAIRS, above=0.0) for row in rows)
