"""Factors of the assumed noise, with which something outside tunes a filter while it runs. docs/learning.md#tuning."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from sins_env.arrays import Array
from sins_env.checks import refused, unknown
from solvers.pipeline.aiding.together import there
from solvers.types import Measurement, Transition


class NoiseFactors(NamedTuple):
    """Factors of Q and of the diagonal of R."""

    q: Array  #: (...)
    r: Array  #: (..., m)

    @classmethod
    def of(cls, q: ArrayLike, r: ArrayLike | Mapping[str, ArrayLike], rows: Mapping[str, slice]) -> NoiseFactors:
        """Return the factors for the ``rows`` of the sensors by name; those that ``r`` does not name keep their noise.

        Raises:
            ValueError: an unknown sensor, or a factor that is not positive and finite.
        """
        given = r if isinstance(r, Mapping) else dict.fromkeys(rows, r)
        factors = {}
        for name, value in (("Q", q), *given.items()):
            if name not in ("Q", *rows):
                raise unknown("sensor", name, rows)
            factors[name] = np.asarray(value, dtype=float)
            if not (np.isfinite(factors[name]) & (factors[name] > 0.0)).all():
                raise refused(f"factor of the noise of {name}", value, "positive, finite numbers")
        size = max(part.stop for part in rows.values())
        scale = np.ones((*np.broadcast_shapes(*(factors[name].shape for name in given)), size))
        for name in given:
            scale[..., rows[name]] = factors[name][..., None]
        return cls(factors["Q"], scale)

    def process(self, tr: Transition) -> Transition:
        """Return a transition with the scaled Q."""
        return tr._replace(Q=self.q[..., None, None] * tr.Q)

    def measurement(self, me: Measurement) -> Measurement:
        """Return a measurement with the scaled R; a component that is missing remains so."""
        root = np.sqrt(self.r)
        return me._replace(R=root[..., :, None] * me.R * root[..., None, :], present=there(me))
