"""Irregular motion in a sea: components of a wave spectrum, with the amplitudes by which a vessel answers to them.

See docs/mathematics/simulation.md#spectrum.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import Any

import numpy as np

from sins_env import checks
from sins_env.arrays import Array

KINDS = {"jonswap": 3.3, "bretschneider": 1.0}  #: kinds of spectra, with their peak enhancement
MOST_COMPONENTS, MOST_GAMMA = 200, 20.0
_FINE = 20_000  #: points of the integrals over frequency
_LOW, _HIGH = (
    0.3,
    8.0,
)  #: band of the spectrum over its peak frequency, outside of which less than 4e-4 of the variance lies
#: Units of the answers by axis, and what a vessel does that says nothing: roll, pitch and heave of a ship of some 50 m.
PER_M = {axis: "deg_per_m" for axis in ("yaw", "pitch", "roll")} | {
    axis: "m_per_m" for axis in ("surge", "sway", "heave")
}
USUAL: Mapping[str, Mapping[str, float]] = {
    "roll": {"deg_per_m": 3.0},
    "pitch": {"deg_per_m": 1.5},
    "heave": {"m_per_m": 0.8},
}


@dataclass(frozen=True)
class Answer:
    """Response of one axis to a wave: so much per metre of its amplitude, with a resonance if there is a natural period.

    Raises:
        ValueError: a value out of its range.
    """

    per_m: float  #: response to slow waves, deg or m per m
    natural_period_s: float | None = None  #: None answers to all frequencies alike
    damping: float = 0.1  #: damping ratio of the resonance

    def __post_init__(self) -> None:
        checks.keep(self, "per_m", checks.number, least=0.0, most=180.0)
        checks.keep(self, "damping", checks.number, least=0.01, most=10.0)
        if self.natural_period_s is not None:
            checks.keep(self, "natural_period_s", checks.number, least=0.2, most=1e5)

    @classmethod
    def of(cls, axis: str, given: Any) -> Answer:
        """Make an answer from a dict with ``deg_per_m`` or, along an axis, ``m_per_m``.

        Raises:
            ValueError: an unknown setting, or a value out of its range; the error begins with the axis.
        """
        unit = PER_M[axis]
        allowed = (unit, *(one.name for one in fields(cls) if one.name != "per_m"))
        if not isinstance(given, Mapping) or unit not in given:
            raise checks.refused(axis, given, f"a dict with {unit}, and perhaps {', '.join(allowed[1:])}")
        for name in given:
            checks.choice(f"setting of {axis}", name, allowed)
        try:
            return cls(**{"per_m" if name == unit else name: value for name, value in given.items()})
        except ValueError as error:
            raise ValueError(f"{axis}.{str(error).replace('per_m', unit, 1)}") from None

    def gain(self, omega: Array) -> Array:
        """Return the amplitude per metre at frequencies in rad/s."""
        if self.natural_period_s is None:
            return np.full(omega.shape, self.per_m)
        r = omega * self.natural_period_s / (2 * np.pi)
        return np.asarray(self.per_m / np.hypot(1.0 - r**2, 2.0 * self.damping * r))


@dataclass(frozen=True)
class Spectrum:
    """A sea, and how a vessel answers to it.

    Raises:
        ValueError: a value out of its range, or an unknown axis.
    """

    kind: str = "jonswap"
    height_m: float = 1.0  #: significant height, four times the standard deviation of the surface
    peak_period_s: float = 8.0
    gamma: float | None = None  #: peak enhancement; None is that of the kind
    components: int = 24  #: number of components, each with the same share of the variance of the surface
    answers: Mapping[str, Answer] = field(default_factory=dict)  #: answers of the axes

    def __post_init__(self) -> None:
        checks.choice("kind of spectrum", self.kind, KINDS)
        checks.keep(self, "height_m", checks.number, least=0.01, most=30.0)
        checks.keep(self, "peak_period_s", checks.number, least=1.0, most=60.0)
        checks.keep(self, "components", checks.whole, least=4, most=MOST_COMPONENTS)
        if self.gamma is None:
            object.__setattr__(self, "gamma", KINDS[self.kind])
        checks.keep(self, "gamma", checks.number, least=1.0, most=MOST_GAMMA)

    @classmethod
    def of(cls, given: Any) -> Spectrum:
        """Make a spectrum from a dict of its fields, with the answers by axis beside them.

        Without answers there are those of ``USUAL``.

        Raises:
            ValueError: an unknown setting, or a value out of its range.
        """
        if isinstance(given, Spectrum):
            return given
        own = [one.name for one in fields(cls) if one.name != "answers"]
        if not isinstance(given, Mapping):
            raise checks.refused("spectrum", given, f"a dict of {', '.join(own)}, and answers of {', '.join(PER_M)}")
        for name in given:
            checks.choice("setting of spectrum", name, (*own, *PER_M))
        answers = {axis: given[axis] for axis in PER_M if axis in given} or USUAL
        return cls(
            **{name: value for name, value in given.items() if name in own},
            answers={axis: Answer.of(axis, one) for axis, one in answers.items()},
        )

    def density(self, omega: Array) -> Array:
        """Return the density of the surface at frequencies in rad/s, m^2 s; its integral is (height / 4)^2."""
        return np.asarray((self.height_m / 4) ** 2 / self._shape[1] * self._relative(omega))

    def _relative(self, omega: Array) -> Array:
        assert self.gamma is not None
        r = omega * self.peak_period_s / (2 * np.pi)
        width = np.where(r > 1, 0.09, 0.07)
        peak = self.gamma ** np.exp(-0.5 * ((r - 1) / width) ** 2)
        return np.asarray(r**-5.0 * np.exp(-1.25 * r**-4.0) * peak)

    @cached_property
    def _shape(self) -> tuple[Array, float]:
        """Frequencies of the band, and the integral of the relative density over them."""
        grid = np.geomspace(_LOW, _HIGH, _FINE) * 2 * np.pi / self.peak_period_s
        return grid, float(np.trapezoid(self._relative(grid), grid))

    def waves(self, axis: str) -> tuple[Array, Array]:
        """Return amplitudes (n,) in deg or m and frequencies (n,) in rad/s of the components of an axis.

        The band is cut into parts of the same variance of the surface. A component has the variance of the answer in its part,
        and its mean frequency, so that the sum has that of the whole and does not repeat itself.
        """
        grid, _ = self._shape
        density = self.density(grid)
        answer = density * self.answers[axis].gain(grid) ** 2
        surface, moment, variance = (_integral(grid, part) for part in (density, grid * density, answer))
        ends = np.interp(np.linspace(0, surface[-1], self.components + 1), surface, grid)
        inside, mean, energy = (np.diff(np.interp(ends, grid, part)) for part in (variance, moment, surface))
        return np.sqrt(2 * inside), mean / energy


def _integral(x: Array, y: Array) -> Array:
    """Return the integral of y from the first x to each, by the trapezoidal rule."""
    return np.concatenate([[0.0], np.cumsum(0.5 * (y[1:] + y[:-1]) * np.diff(x))])
