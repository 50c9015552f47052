"""What is told of a swaying base: sinusoids of its angles and ways, by name, one by one, or as the spectrum of a sea.

See docs/mathematics/simulation.md#sway.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from sins_env import checks
from sins_env.trajectory.spectrum import Spectrum
from sins_env.units import DEG

TURNS = ("yaw", "pitch", "roll")  #: axes of a component that turns the base about its mean attitude
WAYS = ("surge", "sway", "heave")  #: axes of one that moves it: forward, to the right and up from the mean heading
AXES = (*TURNS, *WAYS)
#: Largest sum of the amplitudes about or along an axis, deg and m.
MOST_AMPLITUDE = {"yaw": 180.0, "pitch": 80.0, "roll": 180.0, **dict.fromkeys(WAYS, 50.0)}
MOST_SPEED_MPS = 10.0  #: largest sum of the speeds along an axis
MOST_COMPONENTS = 500  #: most components of an axis
LEAST_PERIOD_S, MOST_PERIOD_S = 0.2, 1e5


@dataclass(frozen=True)
class Component:
    """The sinusoid amplitude cos(2 pi t / period + phase) of one angle or one way.

    Raises:
        ValueError: a value out of its range.
    """

    amplitude: float  #: amplitude of an angle in deg, of a way in m
    period_s: float = 8.0  #: period, s
    phase_deg: float | None = None  #: phase at t = 0, deg; None draws it in each run

    def __post_init__(self) -> None:
        checks.keep(self, "amplitude", check_amplitude)
        checks.keep(self, "period_s", check_period)
        checks.keep(self, "phase_deg", check_phase)

    @property
    def omega(self) -> float:
        """Frequency, rad/s."""
        return 2 * math.pi / self.period_s


def check_amplitude(name: str, given: Any) -> float:
    """Check the amplitude of a component, deg or m."""
    return checks.number(name, given, least=0.0, most=180.0)


def check_period(name: str, given: Any) -> float:
    """Check the period of a component, s."""
    return checks.number(name, given, least=LEAST_PERIOD_S, most=MOST_PERIOD_S)


def check_phase(name: str, given: Any) -> float | None:
    """Check the phase of a component, deg, or None."""
    allowed = "an angle in degrees, -360 to 360, or None, which draws it in each run"
    return None if given is None else checks.number(name, given, allowed, least=-360.0, most=360.0)


def amplitude_field(axis: str) -> str:
    """Return the name of the amplitude in the dict of a component of that axis, which has the unit."""
    return "amplitude_deg" if axis in TURNS else "amplitude_m"


def _component(axis: str, given: Any) -> Component:
    amplitude = amplitude_field(axis)
    allowed = (amplitude, "period_s", "phase_deg")
    if not isinstance(given, Mapping):
        raise checks.refused(axis, given, f"a dict of {', '.join(allowed)}, or a list of such dicts")
    for name in given:
        checks.choice(f"setting of {axis}", name, allowed)
    if amplitude not in given:
        raise ValueError(f"{axis} = {checks.shown(given)} has no {amplitude}; allowed: a number from 0 on")
    fields = {"amplitude" if name == amplitude else name: value for name, value in given.items()}
    try:
        return Component(**fields)
    except ValueError as error:
        text = str(error)
        raise ValueError(
            f"{axis}.{text.replace('amplitude', amplitude, 1) if text[:9] == 'amplitude' else text}"
        ) from None


def components_of(axis: str, given: Any) -> tuple[Component, ...]:
    """Return the components about or along an axis from a dict, or a list of dicts.

    Raises:
        ValueError: an unknown setting, a value out of its range, or components that are too large together.
    """
    several = checks.items(given)
    return checked(axis, tuple(_component(axis, one) for one in ([given] if several is None else several)))


def checked(axis: str, found: tuple[Component, ...]) -> tuple[Component, ...]:
    """Return components about or along an axis.

    Raises:
        ValueError: too many of them, or components that are too large together.
    """
    if len(found) > MOST_COMPONENTS:
        raise ValueError(f"{len(found)} components of {axis}; allowed: at most {MOST_COMPONENTS}")
    total, most = sum(one.amplitude for one in found), MOST_AMPLITUDE[axis]
    if total > most * (1 + 1e-9):
        raise ValueError(f"the amplitudes of {axis} add up to {total:g}; allowed: at most {most:g}")
    speed = sum(one.amplitude * one.omega for one in found) if axis in WAYS else 0.0
    if speed > MOST_SPEED_MPS:
        raise ValueError(f"the speeds of {axis} add up to {speed:g} m/s; allowed: at most {MOST_SPEED_MPS:g} m/s")
    return found


def sea(given: Any) -> dict[str, tuple[Component, ...]]:
    """Return the components of a spectrum by axis; their phases are drawn in each run.

    Raises:
        ValueError: an unknown setting, or a value out of its range.
    """
    spectrum = Spectrum.of(given)
    waves = {axis: spectrum.waves(axis) for axis in spectrum.answers}
    return {
        axis: tuple(Component(float(a), 2 * math.pi / float(w)) for a, w in zip(*pair, strict=True))
        for axis, pair in waves.items()
    }


@dataclass(frozen=True)
class Oscillation:
    """The sinusoid amplitude cos(2 pi t / period_s + phase)."""

    amplitude: float
    period_s: float
    phase: float = 0.0


@dataclass(frozen=True)
class SwayMotion:
    """A swaying motion: angles about the mean attitude in rad, and a linear sway whose phases are drawn per run."""

    heading: Oscillation
    pitch: Oscillation
    roll: Oscillation
    sway_m: tuple[float, float, float]  #: amplitudes of the linear sway in the order E, N, U
    sway_period_s: tuple[float, float, float]  #: its periods in the same order
    components: Mapping[str, tuple[Component, ...]] = field(
        default_factory=dict
    )  #: further ones by the name of their axis

    @classmethod
    def of(cls, given: Any) -> SwayMotion:
        """Make a motion from a dict that has, for some axes, a component or a list of them; a motion is returned as it is.

        The key ``spectrum`` adds those of a sea (:class:`sins_env.trajectory.spectrum.Spectrum`), with phases that each run draws.

        A component is a dict of ``amplitude_deg`` (along an axis ``amplitude_m``), ``period_s`` and ``phase_deg``. About and
        along an axis that is left out the base stays still.

        Raises:
            ValueError: an unknown axis or setting, a value out of its range, or components that are too large together.
        """
        if isinstance(given, SwayMotion):
            return given
        if not isinstance(given, Mapping):
            raise checks.refused("motion", given, f"{', '.join(MOTIONS)}, or a dict of {', '.join(AXES)}")
        for name in given:
            checks.choice("axis of motion", name, (*AXES, "spectrum"))
        found = {name: components_of(name, given[name]) for name in AXES if name in given}
        if given.get("spectrum") is not None:
            for name, more in sea(given["spectrum"]).items():
                found[name] = checked(name, (*found.get(name, ()), *more))
        return replace(STILL, components={name: found[name] for name in AXES if name in found})


#: The motion of 000 section 2.5.1. See docs/mathematics/simulation.md#sway.
THESIS = SwayMotion(
    heading=Oscillation(5 * DEG, 7.0, math.pi / 4),
    pitch=Oscillation(7 * DEG, 5.0, math.pi / 4),
    roll=Oscillation(10 * DEG, 6.0, math.pi / 7),
    sway_m=(0.02, 0.03, 0.03),
    sway_period_s=(7.0, 6.0, 8.0),
)
#: A base that stands still.
STILL = SwayMotion(Oscillation(0, 1), Oscillation(0, 1), Oscillation(0, 1), (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))

MOTIONS = ("thesis", "random")  #: allowed names of a motion
