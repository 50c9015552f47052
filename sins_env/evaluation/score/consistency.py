"""Consistency of covariances: NEES over runs, with the band of its mean."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.score.resampling import CONFIDENCE, Interval


class Nees(NamedTuple):
    """Mean over runs of e' P^-1 e at one time; a consistent filter has the number of errors in e."""

    t_s: float  #: time, s from switch-on
    mean: float
    band: Interval  #: interval that holds 95 % of such means if the covariances are right
    runs: int

    @property
    def inside(self) -> bool:
        """Whether the mean lies in the band."""
        return self.band[0] <= self.mean <= self.band[1]


def nees_band(runs: int, dof: int = 3) -> Interval:
    """Return the 95 % band of the mean of ``runs`` chi-square values with ``dof`` degrees of freedom."""
    tail = 0.5 * (1 - CONFIDENCE)
    low, high = chi2_quantile(np.array([tail, 1 - tail]), dof * runs) / runs
    return float(low), float(high)


def chi2_quantile(part: Any, dof: int) -> Any:
    """Return the chi-square quantile of a probability ``part``; scipy.stats has it, too, but takes long to import."""
    from scipy import special  # slow to import

    return 2 * special.gammaincinv(0.5 * dof, part)


def consistency(criteria: Criteria, nees: Array, dof: int = 3) -> tuple[Nees, ...]:
    """Summarise NEES (R, times) at each time of the task; times at which no run reported a covariance are left out."""
    out = []
    for epoch, values in zip(criteria.nees_epochs, nees.T, strict=False):
        known = values[~np.isnan(values)]
        if len(known):
            band = nees_band(len(known), dof)
            out.append(Nees(epoch * criteria.epoch_s, float(known.mean()), band, len(known)))
    return tuple(out)
