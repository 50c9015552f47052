"""Analytic coarse alignment: attitude from the mean specific force and the mean rate of a base at rest.

    R_b = R_n C_b^n,   rows of R_b and R_n:   1  g, w, g x w       2  g, g x w, (g x w) x g       3  the same normalised

with g = -f and w measured in b and known in n. All forms have the azimuth error -eps_E / (omega_ie cos L) + tan L nabla_E / g.
They differ in how far C_b^n = R_n^-1 R_b is from a rotation: form 1 by eps_U / (omega_ie cos L), form 2 by errors of scale only,
form 3 not at all. Once it is made a rotation, they also differ in level. Form 1 takes half of eps_U / (omega_ie cos L) into
phi_E, the others only nabla / g.

The means are taken in body axes, so the attitude is a mean over all epochs so far. The mean rate must be that of the earth: a
door slam of 0.1 deg within 90 s already is 4 deg/h. For bases that move use the inertial frame.
Source: 000 section 6.2.1, after Wei and Zhang (2000), whose numbering could not be checked;
docs/mathematics/coarse_alignment.md#analytic-methods.
"""

from __future__ import annotations

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.types import Observation, Task
from solvers.pipeline.coarse.fits import by_svd, triad
from solvers.pipeline.coarse.on_the_spot import OnTheSpot
from solvers.pipeline.coarse.spread import Spread, of_means
from solvers.pipeline.strapdown import cross


def from_means(form: int, force: Array, rate: Array, force_n: Array, rate_n: Array) -> Array:
    """Return C_b^n (..., 3, 3), which in forms 1 and 2 is not yet a rotation.

    ``force`` in m/s^2 and ``rate`` in rad/s are (..., 3) in b; ``force_n`` and ``rate_n`` are (3,) in n.
    """
    if form == 3:
        return triad(-force_n, rate_n, -force, rate)
    return np.linalg.inv(_rows(form, -force_n, rate_n)) @ _rows(form, -force, rate)


def _rows(form: int, g: Array, w: Array) -> Array:
    """Return the matrix R of form 1 or 2."""
    gxw = cross(g, w)
    return np.stack([g, w, gxw] if form == 1 else [g, gxw, cross(gxw, g)], axis=-2)


class Analytic(OnTheSpot):
    """Form 1, 2 or 3 with the means over all epochs so far, made a rotation by the SVD; batch first.

    If there is no force, or one along the rate, the missing directions are arbitrary; this is not an error.
    """

    def __init__(self, task: Task, batch: tuple[int, ...], form: int) -> None:
        model = earth.get(task.site.earth)
        latitude, _, height = task.site.pos
        self._form, self._epoch_s, self._k = form, task.epoch_s, 0
        self._force_n = np.array([0.0, 0.0, float(earth.gravity(model, latitude, height))])
        self._rate_n = earth.rate_n(model, latitude)
        self._site, self._prior = (latitude, float(model.rate)), task.prior
        self._dvel, self._dtheta = np.zeros((*batch, 3)), np.zeros((*batch, 3))

    def add(self, obs: Observation) -> None:
        """Take one more epoch."""
        self._k += 1
        self._dvel = self._dvel + obs["dvel"].sum(axis=-2)
        self._dtheta = self._dtheta + obs["dtheta"].sum(axis=-2)

    def attitude(self) -> Array:
        """Return the mean attitude so far, q_nb (..., 4)."""
        t = max(self._k, 1) * self._epoch_s
        C = from_means(self._form, self._dvel / t, self._dtheta / t, self._force_n, self._rate_n)
        return attitude.from_dcm(by_svd(C))

    def spread(self) -> Spread:
        """Return what the mean attitude is off by if the base stood still."""
        C, gravity = attitude.to_dcm(self.attitude()), self._force_n[2]
        latitude, rate = self._site
        return of_means(self._form, latitude, gravity, rate, self._k, self._epoch_s, C, self._prior)
