"""The bound of a task as an answer: its errors over time, their budget, and when a wanted accuracy is reached."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.planning.quantities import QUANTITIES, Quantity, Wanted
from sins_env.evaluation.tasks.task import EvaluationTask


class Reached(NamedTuple):
    """When a wanted accuracy is reached; times in s from switch-on."""

    wanted: Wanted
    first_s: float  #: when it is reached for the first time; inf if not within the task
    holds_s: float  #: from when on it holds to the end; inf if not
    best: float  #: the least bound within the task, SI
    later_s: float  #: when it would be reached if the last part of the motion went on; inf if not within the horizon
    limit: float  #: what the bound then tends to, SI
    settled: bool  #: whether it has settled there within the horizon


@dataclass(frozen=True, repr=False)
class Curves:
    """The smallest 1-sigma errors that the sensors and the motion of a task allow, over time."""

    task: EvaluationTask
    t: Array  #: (K,) ends of the epochs, s from switch-on
    sigma: Mapping[str, Array]  #: (K,) bound of each quantity, SI
    sources: tuple[str, ...]  #: names of the sources of error; none if no budget was asked for
    budget_t: Array  #: (B,) times of the budget, s
    shares: Mapping[str, Array]  #: (B, sources) share of each source in the variance; they add up to one
    without: Mapping[str, Array]  #: (B, sources) bound if this source alone were not there, SI
    limit: Mapping[str, float]  #: what the bound tends to if the last part of the motion goes on, SI
    settled: Mapping[str, bool]  #: whether it has settled there after a day
    repeated_s: float  #: length of this part, s
    reached: tuple[Reached, ...]
    holds: bool  #: whether the start is drawn from a Gaussian; if not, the bound is only a reference
    known: tuple[str, ...]  #: errors of the IMU that the bound counts as known
    family: Mapping[str, Self] = field(default_factory=dict)  #: the same task with other settings, by what differs

    def __repr__(self) -> str:
        parts = [f"{self.final(name) / q.unit:.4g} {q.unit_name} in {q.what}" for name, q in self.quantities.items()]
        return f"<{type(self).__name__} of {self.task.name} at {self.t[-1]:g} s: {', '.join(parts)}>"

    @property
    def quantities(self) -> dict[str, Quantity]:
        """The quantities that the task has, by name."""
        return {name: QUANTITIES[name] for name in self.sigma}

    def final(self, name: str) -> float:
        """Return the bound of a quantity at the end, SI."""
        return float(self.sigma[name][-1])

    def at(self, name: str, t: float) -> float:
        """Return the bound of a quantity at the end of the epoch that ends at or after ``t`` s, SI.

        Raises:
            ValueError: a time beyond the task.
        """
        return float(self.sigma[name][self.index(self.t, t)])

    def index(self, times: Array, t: float) -> int:
        """Return the index of the first of the times at or after ``t`` s.

        Raises:
            ValueError: a time beyond the task.
        """
        if not 0 <= t <= self.t[-1] * (1 + 1e-9):
            raise ValueError(f"t = {t:g} s; allowed: 0 to {self.t[-1]:g} s, the duration of {self.task.name}")
        return min(int(np.searchsorted(times, t * (1 - 1e-9))), len(times) - 1)

    @cached_property
    def _rows(self) -> list[int]:
        """Indices of about a dozen times for a table, one, two and five of each decade and the end."""
        decades = [step * 10.0**power for power in range(-1, 7) for step in (1, 2, 5)]
        times = [t for t in decades if self.t[0] <= t * (1 + 1e-9) and t < 0.95 * self.t[-1]]
        return sorted({self.index(self.t, t) for t in times[-9:]} | {len(self.t) - 1})

    def rows(self) -> list[dict[str, float]]:
        """Return plain rows over time, in the units of ``QUANTITIES``: at one, two and five of each decade, and at the end."""
        return [
            {
                "t": float(self.t[i]),
                **{name: float(self.sigma[name][i]) / q.unit for name, q in self.quantities.items()},
            }
            for i in self._rows
        ]

    def budget(self, t: float | None = None) -> list[dict[str, Any]]:
        """Return a row for each source of error at ``t`` s, by default at the end; the largest share of azimuth comes first.

        A row has the ``source``, and by quantity its ``share`` in the variance, and the bound ``without`` it in its unit.

        Raises:
            ValueError: a time beyond the task.
        """
        i = self.index(self.budget_t, self.t[-1] if t is None else t)
        rows = [
            {
                "source": source,
                "share": {name: float(part[i, s]) for name, part in self.shares.items()},
                "without": {name: float(part[i, s]) / QUANTITIES[name].unit for name, part in self.without.items()},
            }
            for s, source in enumerate(self.sources)
        ]
        return sorted(rows, key=lambda row: -row["share"]["azimuth"])

    def to_dict(self, t: float | None = None) -> dict[str, Any]:
        """Return everything as JSON can hold it: curves at about 1 Hz, SI but for what says its unit. Infinity is None."""
        every = max(1, round(1.0 / (self.t[1] - self.t[0]))) if len(self.t) > 1 else 1
        picked = slice(every - 1, None, every)
        return {
            "task": self.task.name,
            "holds": self.holds,
            "counted_as_known": list(self.known),
            "units": {name: q.unit_name for name, q in self.quantities.items()},
            "t_s": self.t[picked].tolist(),
            "bound": {name: (curve[picked] / QUANTITIES[name].unit).tolist() for name, curve in self.sigma.items()},
            "budget": self.budget(t) if self.sources else [],
            "repeated_s": self.repeated_s,
            "limit": {name: _finite(value / QUANTITIES[name].unit) for name, value in self.limit.items()},
            "settled": dict(self.settled),
            "until": [_plain(one) for one in self.reached],
            "family": {name: one.to_dict(t) for name, one in self.family.items()},
        }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _plain(one: Reached) -> dict[str, Any]:
    unit = QUANTITIES[one.wanted.quantity]
    return {
        "wanted": one.wanted.text,
        "quantity": one.wanted.quantity,
        "unit": unit.unit_name,
        "size": one.wanted.size / unit.unit,
        **{name: _finite(getattr(one, name)) for name in ("first_s", "holds_s", "later_s")},
        "best": one.best / unit.unit,
        "limit": _finite(one.limit / unit.unit),
        "settled": one.settled,
    }
