"""What the pipeline asks of an aid: the states that it adds, and measurements of the errors from observations.

A sensor's own errors are parameters: states behind those of the INS. A measurement is INS minus reading, z = h(x) + v, and h is
what the sensor would read at the INS minus what it would read at the INS without the errors x. So h(0) = 0, and nothing is
linearised by hand. Equations: docs/mathematics/aiding.md#measurement.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.states import Layout
from sins_env.types import NavState, Observation, Task
from solvers.pipeline.errors.model import Parameter
from solvers.pipeline.strapdown import end_rate
from solvers.types import Measurement


@dataclass(eq=False)
class Ins:
    """The INS at the end of an epoch, and what an aid may ask of the epoch."""

    nav: NavState  #: at the end
    before: NavState  #: at the start
    dtheta: Array  #: (..., n_sub, 3) rad, increments without the biases fed back so far
    last: Array | None  #: (..., 6), the sample before the epoch, if it is known
    epoch_s: float
    rate_ie: Array  #: (3,) rad/s, earth rate in n
    own: Mapping[str, Array] = field(
        default_factory=dict
    )  #: parameters fed back so far by name, (..., size) in SI units
    #: Increments (dtheta rad, dvel m/s) of this epoch and of some before it, (..., samples, 3), without the biases fed back so
    #: far. They are kept if fixes are made between the ends of epochs.
    samples: tuple[Array, Array] | None = None

    @cached_property
    def C(self) -> Array:
        """Attitude C_hat at the end, (..., 3, 3)."""
        return np.asarray(attitude.to_dcm(self.nav.q_nb))

    @cached_property
    def rate(self) -> Array:
        """omega_eb^b at the end, (..., 3) rad/s, extrapolated from the last two samples."""
        angles = self.dtheta
        if angles.shape[-2] == 1 and self.last is not None:
            angles = np.concatenate([self.last[..., None, :3], angles], axis=-2)
        return end_rate(angles, self.epoch_s * angles.shape[-2] / self.dtheta.shape[-2]) - self._rate_ie_b

    @cached_property
    def mean_rate(self) -> Array:
        """Mean of omega_eb^b over the epoch, (..., 3) rad/s."""
        return self.dtheta.sum(axis=-2) / self.epoch_s - self._rate_ie_b

    @cached_property
    def _rate_ie_b(self) -> Array:
        return np.asarray((self.C.mT @ self.rate_ie[:, None])[..., 0])


class Aid(Protocol):
    """A sensor as the task tells it, made anew for each episode; ``states`` is the layout of the errors x."""

    name: ClassVar[str]
    rows: int  #: number of components of a measurement

    def read(self, obs: Observation, ins: Ins) -> Measurement | None:
        """Return the measurement at the end of an epoch; None if no run has a reading."""
        ...


class State(NamedTuple):
    """The state of a sensor: that of the INS, or that of the INS without some errors."""

    C: Array  #: (..., 3, 3) attitude
    vel: Array  #: (..., 3) m/s E, N, U
    away: Array  #: (..., 3) m E, N, U from the place of the INS
    rate: Array  #: (..., 3) rad/s, omega_eb^b
    own: Mapping[str, Array]  #: parameters by name, (..., size) in SI units


class Sensor(ABC):
    """Base of the aids whose reading is a function of one state: a subclass gives the function and its slopes.

    Args:
        spec: what the task tells of the sensor.
        task: the task.
        states: layout of the errors x.
    """

    name: ClassVar[str]
    rows: int

    def __init__(self, spec: Any, task: Task, states: Layout) -> None:
        self.spec, self.task, self.states = spec, task, states
        self.parameters = self.states_of(spec)
        self.prepare()

    @classmethod
    def states_of(cls, spec: Any) -> tuple[Parameter, ...]:
        """Return the parameters that the sensor adds to the errors of the INS; those without a spread are no states."""
        return ()

    @classmethod
    def fits(cls, states: Layout) -> bool:
        """Return whether the errors x have the states that a reading shows."""
        return True

    def prepare(self) -> None:  # noqa: B027 - most have nothing to prepare
        """Compute what is the same at all epochs."""

    @abstractmethod
    def value(self, s: State) -> Array:
        """Return the reading at a state, (..., rows)."""

    @abstractmethod
    def slopes(self, s: State) -> dict[str, Array]:
        """Return the derivatives (..., rows, k) of the reading that are not zero, by what it depends on.

        These are "turn", which is a turn e of the axes, C -> (I + [e x]) C, then "vel", "away" and "rate", and parameters.
        """

    @abstractmethod
    def noise(self) -> Array:
        """Return the assumed variances of a reading, (rows,), or (..., rows) where ``covariance`` says so."""

    def told(self, obs: Observation, ins: Ins) -> tuple[Array, Mask]:
        """Return the readings (..., rows) at the end of the epoch, and which components are there."""
        value, valid = field_of(obs, self.name), field_of(obs, f"{self.name}_valid")
        return value, np.broadcast_to(valid == 1, value.shape)

    def rate(self, ins: Ins) -> Array:
        """Return the rate that counts, (..., 3); here that at the end of the epoch."""
        return ins.rate

    def read(self, obs: Observation, ins: Ins) -> Measurement | None:
        """Return the measurement at the end of an epoch; None if no run has a reading."""
        reading, present = self.told(obs, ins)
        if not present.any():
            return None
        batch = ins.nav.vel.shape[:-1]  # a parameter without a spread is known to be zero, and no state
        own = {p.name: ins.own[p.name] if p.std else np.zeros((*batch, p.size)) for p in self.parameters}
        hat = State(ins.C, ins.nav.vel, np.zeros_like(ins.nav.vel), self.rate(ins), own)
        expected = self.value(hat)
        z = np.where(present, expected - reading, 0.0)
        return Measurement(z, Shown(self, hat, expected), self.covariance(), None, present)

    def covariance(self) -> Array:
        """Return the assumed covariance of a reading, (rows, rows), or (..., rows, rows) if it differs by run."""
        return self._same

    @cached_property
    def _same(self) -> Array:
        return np.diag(self.noise())


class Reads(Protocol):
    """A reading as a function of one state."""

    rows: int

    @property
    def states(self) -> Layout:
        """Layout of the errors x."""
        ...

    @property
    def parameters(self) -> tuple[Parameter, ...]:
        """Parameters of the sensor."""
        ...

    def value(self, s: State) -> Array:
        """Return the reading at a state, (..., rows)."""
        ...

    def slopes(self, s: State) -> dict[str, Array]:
        """Return the derivatives (..., rows, k) of the reading that are not zero, by what it depends on."""
        ...


@dataclass(frozen=True)
class Shown:
    """What a reading shows of the errors x, h(x), with its Jacobian."""

    sensor: Reads
    hat: State  #: at the INS
    expected: Array  #: (..., rows), reading at the INS

    def __call__(self, x: Array) -> Array:
        return self._value(x, self.without(x))

    def jacobian(self, x: Array) -> Array:
        """Return dh / dx (..., rows, n) at x (..., n)."""
        return self._slope(x, self.without(x))

    def value_and_jacobian(self, x: Array) -> tuple[Array, Array]:
        """Return h and dh / dx at x (..., n)."""
        if not self._points(x) and not np.count_nonzero(x):  # where a closed loop is, as a rule
            return np.zeros(np.broadcast_shapes(self.expected.shape, (*x.shape[:-1], 1))), self._slope(x, self.hat)
        s = self.without(x)
        return self._value(x, s), self._slope(x, s)

    def _value(self, x: Array, s: State) -> Array:
        expected = self.expected[..., None, :] if self._points(x) else self.expected
        return expected - self.sensor.value(s)

    def _slope(self, x: Array, s: State) -> Array:
        states, phi = self.sensor.states, x[..., self.sensor.states["phi"]]
        slopes = self.sensor.slopes(s)
        J = np.zeros((*x.shape[:-1], self.sensor.rows, states.size))
        if "turn" in slopes:
            turn = attitude.misalignment_dcm(phi).mT @ attitude.misalignment_rate_matrix(phi)
            J[..., states["phi"]] = -(slopes.pop("turn") @ turn)
        for name, block in (("vel", "dv"), ("away", "dp"), ("rate", "gyro_bias")):
            if name in slopes and block in states:
                J[..., states[block]] = slopes.pop(name) * states.si[states[block]]
        for p in self.sensor.parameters:
            if p.name in slopes and p.std:
                J[..., states[p.name]] = -slopes[p.name] * p.si
        return J

    def without(self, x: Array) -> State:
        """Return the state of the INS without the errors x (..., n), or (..., points, n)."""
        states, hat, si = self.sensor.states, self.hat, self.sensor.states.si
        C, vel, rate, own = hat.C, hat.vel, hat.rate, hat.own
        if self._points(x):
            C, vel, rate = C[..., None, :, :], vel[..., None, :], rate[..., None, :]
            own = {name: value[..., None, :] for name, value in own.items()}

        def part(name: str) -> Array:
            return x[..., states[name]] * si[states[name]]

        dv = part("dv")
        if dv.shape[-1] < 3:  # a model without a vertical velocity
            dv = np.concatenate([dv, np.zeros_like(dv[..., :1])], axis=-1)
        vel = vel - dv
        return State(
            attitude.misalignment_dcm(part("phi")).mT @ C,
            vel,
            -part("dp") if "dp" in states else np.zeros_like(vel),
            rate - part("gyro_bias"),
            {name: value + part(name) if name in states else value for name, value in own.items()},
        )

    def _points(self, x: Array) -> bool:
        return x.ndim > self.hat.vel.ndim


def field_of(obs: Observation, name: str) -> Array:
    """Return a field of an observation that a task tells.

    Raises:
        ValueError: the observation does not have it.
    """
    if name not in obs:
        raise ValueError(
            f"an observation without {name!r}, of which the task tells; allowed: {name!r} and {name}_valid in each"
        )
    return np.asarray(obs[name])  # type: ignore[literal-required]


def earth_rate(task: Task) -> Array:
    """Return the earth rate in n at the site, (3,) rad/s."""
    return np.asarray(earth.rate_n(earth.get(task.site.earth), task.site.latitude))
