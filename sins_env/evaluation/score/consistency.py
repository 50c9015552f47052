"""Whether covariances are right: NEES over runs, with the band of its mean."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from scipy import special

from sins_env.arrays import Array
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.score.resampling import CONFIDENCE, Interval


class Nees(NamedTuple):
    """Mean over runs of e' P^-1 e at one time; as many as there are errors is consistent."""

    t_s: float  #: from switch-on
    mean: float
    band: Interval  #: where 95 % of such means lie if the covariances are right
    runs: int

    @property
    def inside(self) -> bool:
        return self.band[0] <= self.mean <= self.band[1]


def nees_band(runs: int, dof: int = 3) -> Interval:
    """95 % band of the mean of ``runs`` chi-square values."""
    tail = 0.5 * (1 - CONFIDENCE)
    low, high = chi2_quantile(np.array([tail, 1 - tail]), dof * runs) / runs
    return float(low), float(high)


def chi2_quantile(part: Any, dof: int) -> Any:
    """scipy.stats has it, too, but takes long to import."""
    return 2 * special.gammaincinv(0.5 * dof, part)


def consistency(criteria: Criteria, nees: Array, dof: int = 3) -> tuple[Nees, ...]:
    """NEES (R, times) at the task's times; empty where no covariance was reported or it is not scored."""
    out = []
    for epoch, values in zip(criteria.nees_epochs, nees.T, strict=False):
        known = values[~np.isnan(values)]
        if len(known):
            band = nees_band(len(known), dof)
            out.append(Nees(epoch * criteria.epoch_s, float(known.mean()), band, len(known)))
    return tuple(out)
