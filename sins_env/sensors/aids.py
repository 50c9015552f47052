"""Aiding sensors beside the receiver of GPS: what they share, and how the setting ``aids`` names them.

A sensor is one file of this folder with a specification, :class:`sins_env.specs.AidSpec`, and a subclass of ``Sensor``. Its
name is that of the setting and of the reading in an observation; beside the reading, ``<name>_valid`` says whether there is
one. See docs/mathematics/aiding.md#sensors.
"""

from __future__ import annotations

import zlib
from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, checks, earth
from sins_env.arrays import Array, Mask, Rngs
from sins_env.checks import classes, find
from sins_env.motion import Motion
from sins_env.sensors.gps import epochs_per_fix, received
from sins_env.sensors.imu import GaussMarkov, standard_normal
from sins_env.sensors.limits import Field, clip
from sins_env.specs import AidSpec
from sins_env.types import NavState, Site

Spec = TypeVar("Spec", bound=AidSpec)


class Sensor(ABC, Generic[Spec]):
    """A batch of sensors of one kind, one in each run.

    Errors are drawn at every epoch, with a reading or without, so that another rate leaves the other errors as they were.
    """

    name: ClassVar[str]
    specification: ClassVar[type[AidSpec]]
    size: ClassVar[int]  #: numbers of a reading
    limit: ClassVar[float]  #: largest absolute value of them
    what: ClassVar[str]  #: unit and meaning
    slip_angle = 0.0  #: rad for each m/s^2 to the right, by which the vehicle's nose points inwards of its velocity

    def __init__(self, spec: Spec, site: Site, epoch_s: float) -> None:
        self.spec, self.epoch_s, self.earth = spec, epoch_s, earth.get(site.earth)
        self.site = site
        self._every = epochs_per_fix(spec, epoch_s)
        self.fields: dict[str, Field] = {
            self.name: Field.of(self.size, -self.limit, self.limit, f"{self.what}; zeros without one"),
            f"{self.name}_valid": Field.mark(f"1 where there is a reading of {self.name} at t"),
        }
        self.mounting: Array | None = (
            None  #: (runs, 4) how the IMU sits in the vehicle, from b to the axes of the vehicle
        )

    def reset(self, rngs: Rngs) -> None:
        """Begin the runs: draw their fixed errors, with one generator for each."""
        fixed, self._noise, self._markov = zip(*(rng.spawn(3) for rng in rngs), strict=True)
        self.draw(fixed)

    @abstractmethod
    def draw(self, rngs: Rngs) -> None:
        """Draw the fixed errors of the runs."""

    @abstractmethod
    def measure(self, motion: Motion, first_epoch: int) -> Array:
        """Return the readings at the ends of all epochs of a chunk, (runs, epochs, size); NaN where a fault leaves none."""

    def begin(self, truth: NavState) -> None:
        """Take the true states at t = 0, for sensors that measure over an epoch."""

    def present(self, first_epoch: int, epochs: int) -> Mask:
        """Return which of the epochs after ``first_epoch`` end with a reading, (epochs,)."""
        number = np.arange(first_epoch + 1, first_epoch + epochs + 1)
        return (number % self._every == 0) & received(self.spec, number * self.epoch_s)

    def readings(self, motion: Motion, first_epoch: int) -> dict[str, NDArray[Any]]:
        """Return the fields of the observations at the ends of the epochs of a chunk, each (runs, epochs, ...)."""
        values = self.measure(motion, first_epoch)
        there = self.present(first_epoch, values.shape[1])[:, None] & ~np.isnan(values[..., :1])
        values = np.where(there, values, 0.0)
        clip(self.name, values, self.fields)
        return {self.name: values, f"{self.name}_valid": there.astype(np.int8)}

    def ends(self, first_epoch: int, epochs: int) -> Array:
        """Return the times of the ends of the epochs after ``first_epoch``, s, (epochs,)."""
        return np.arange(first_epoch + 1, first_epoch + epochs + 1, dtype=np.float64) * self.epoch_s

    def white(self, std: float, motion: Motion, size: int | None = None) -> Array:
        """Draw white errors (runs, epochs, size)."""
        return std * standard_normal(self._noise, (motion.state.vel.shape[1], size or self.size))

    def wandering(self, std: float, time_constant_s: float) -> GaussMarkov:
        """Begin Gauss-Markov errors of three components, which ``samples(epochs)`` yields."""
        error = GaussMarkov(std, time_constant_s, self.epoch_s)
        error.reset(self._markov)
        return error

    def body_velocity(self, motion: Motion, lever: Array, current: Array | float = 0.0) -> Array:
        """Return C' (v - current) + omega_eb x lever, m/s in b, at the ends of the epochs of a chunk."""
        C = attitude.to_dcm(motion.state.q_nb)
        through = (C.mT @ (motion.state.vel - current)[..., None])[..., 0]
        return through + np.cross(motion.rate_eb_b, lever) if lever.any() else through


def specs(given: Any) -> tuple[AidSpec, ...]:
    """Return the specifications of the setting ``aids``, in the order of their names.

    It is a dict with the name of a preset or a dict of fields for each sensor.

    Raises:
        ValueError: no such dict, an unknown sensor, or what its specification refuses.
    """
    if isinstance(given, tuple) and all(isinstance(one, AidSpec) for one in given):
        return given
    if not isinstance(given, Mapping):
        raise checks.refused("aids", given, "a dict with the name of a preset or a dict of fields for each sensor")
    found = [sensor_of(name).specification.of(fields) for name, fields in given.items()]
    return tuple(sorted(found, key=lambda spec: spec.name))


def known() -> dict[str, type[Sensor[Any]]]:
    """Return all aiding sensors by name."""
    return classes("sins_env.sensors", Sensor)  # type: ignore[type-abstract]


def sensor_of(name: str) -> type[Sensor[Any]]:
    """Return the sensor of a name.

    Raises:
        ValueError: an unknown name; the error offers the nearest one.
    """
    return find("aid", name, "sins_env.sensors", Sensor)  # type: ignore[type-abstract]


def stream(rng: np.random.Generator, name: str) -> np.random.Generator:
    """Return a generator that depends on the stream of ``rng`` and a name alone, so that no sensor changes another's errors."""
    source = rng.bit_generator.seed_seq
    assert isinstance(source, np.random.SeedSequence)
    return np.random.default_rng(
        np.random.SeedSequence(source.entropy, spawn_key=(*source.spawn_key, zlib.crc32(name.encode())))
    )
