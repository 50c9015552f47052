"""The interface of a trajectory: what a world asks of a true motion."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from sins_env.arrays import Array, Rngs
from sins_env.types import NavState


class Motion(NamedTuple):
    """The true motion in a chunk of epochs, with the run axis first."""

    dtheta: Array  #: (runs, epochs, n_sub, 3) exact integrals of omega_ib^b, rad
    dvel: Array  #: (runs, epochs, n_sub, 3) exact integrals of f^b, m/s
    state: NavState  #: (runs, epochs, ...) true states at the end of each epoch
    rate_eb_b: Array  #: (runs, epochs, 3) omega_eb^b at the end of each epoch, rad/s; a lever arm makes it a velocity


class Trajectory(Protocol):
    """A batch of true motions that yields chunks of epochs."""

    def reset(self, rngs: Rngs) -> NavState:
        """Draw one motion per generator, and return the true states at t = 0, (runs, ...)."""
        ...

    def chunk(self, first_epoch: int, num_epochs: int) -> Motion:
        """Return the motion in epochs first_epoch + 1 ... first_epoch + num_epochs; epoch k ends at t_k."""
        ...

    def earlier(self, after: NavState, t: Array, age: Array) -> tuple[NavState, Array]:
        """Return the true states and omega_eb^b at the times t - age, (runs, len(t), ...).

        ``t`` and ``age`` are (len(t),) s, and ``after`` are the true states at ``t``.
        """
        ...
