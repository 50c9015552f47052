"""What the environments ask of a trajectory."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np

from sins_env.arrays import Array
from sins_env.types import NavState


class Motion(NamedTuple):
    """The truth over a chunk of epochs, runs first."""

    dtheta: Array  #: (runs, epochs, n_sub, 3) rad, exact integrals of omega_ib^b
    dvel: Array  #: (runs, epochs, n_sub, 3) m/s, exact integrals of f^b
    state: NavState  #: (runs, epochs, ...) at the end of each epoch
    rate_eb_b: Array  #: (runs, epochs, 3) rad/s at the end of each epoch, what a lever arm turns into velocity


class Trajectory(Protocol):
    def reset(self, rngs: Sequence[np.random.Generator]) -> NavState:
        """Draw one motion per generator; the true states at t = 0, (runs, ...)."""
        ...

    def chunk(self, first_epoch: int, num_epochs: int) -> Motion:
        """Epochs first_epoch + 1 ... first_epoch + num_epochs (epoch k ends at t_k)."""
        ...
