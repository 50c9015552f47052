"""Stamps that start again at the end of a GPS week or a day, and counters that are full."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.recordings.recording import first_few, seconds
from sins_env.recordings.stamps.scales import DAY_S, WEEK_S

BITS = (8, 16, 24, 32)  #: widths of counters
LONGEST_S, LONGEST_STEPS = 60.0, 20.0  #: longest time, and number of usual steps, between the stamps around a wrap

Place = Callable[[int], str]


def unrolled(t: Array) -> Array:
    """Return stamps (n,), s, without wraps: a step back by nearly a week or a day is a step onwards."""
    back = np.flatnonzero(np.diff(t) < 0)
    if not len(back):
        return t
    steps = np.diff(t)
    longest = max(LONGEST_STEPS * float(np.median(np.abs(steps))), LONGEST_S)
    lift = np.zeros(len(steps))
    for i in back:
        lift[i] = next((period for period in (WEEK_S, DAY_S) if 0 < steps[i] + period <= longest), 0.0)
    return np.concatenate([t[:1], t[1:] + np.cumsum(lift)])


def counted(counter: Array) -> NDArray[np.int64]:
    """Return a running number from 0 for each sample, (n,), of a counter that may wrap at 8, 16, 24 or 32 bits.

    A counter that advances by more than one from sample to sample is divided by its usual step.

    Raises:
        ValueError: a counter that is not made of whole numbers, or that stands still or runs back.
    """
    whole = np.rint(counter)
    if (whole != counter).any():
        raise ValueError(f"counter is {counter[np.argmax(whole != counter)]:g}; allowed: whole numbers")
    steps = np.diff(whole).astype(np.int64)
    full = next((2**bits for bits in BITS if whole.max() < 2**bits), 0)
    usual = max(int(np.median(steps)), 1) if len(steps) else 1
    wraps = (steps < 0) & (steps + full > 0) & (steps + full <= full // 2)
    steps = np.where(wraps, steps + full, steps)
    bad = np.flatnonzero(steps < 1)
    if len(bad):
        i = int(bad[0])
        raise ValueError(
            f"counter goes from {whole[i]:.0f} to {whole[i + 1]:.0f} at sample {i + 1}; allowed: a counter that grows"
        )
    if (steps % usual).any():
        usual = 1
    return np.concatenate([[0], np.cumsum(steps // usual)])


def check_increasing(path: str, name: str, place: Place, t: Array, drop: bool = False, step: str = "") -> None:
    """Check that stamps increase.

    Raises:
        ValueError: stamps that run back, or that repeat unless ``drop``; the error has their times.
    """
    back = np.flatnonzero(np.diff(t) < 0)
    if len(back):
        i = int(back[0])
        times = f"{seconds(t[i + 1])} s after {seconds(t[i])} s"
        raise ValueError(f"{path}: {name} does not increase{step} at {place(i + 1)}: {times}")
    same = np.flatnonzero(np.diff(t) == 0) + 1
    if len(same) and not drop:
        first, many = place(int(same[0])), len(same) > 1
        listed = first_few([f"{seconds(t[i])} s" for i in same[:6]] + [""] * (len(same) - 6))
        raise ValueError(
            f"{path}: {name} does not increase{step} at {first}: {len(same)} repeated stamp{'s' * many}, {listed}; allowed: "
            "each stamp once, or drop_duplicates, which keeps the first sample of each"
        )
