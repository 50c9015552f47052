"""Names of the types of arrays and generators that the whole package shares."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Obs = dict[str, NDArray[Any]]  #: an observation; that of the vector environment has a leading run axis
Rngs = Sequence[np.random.Generator]  #: one for each run, or for each stream of random numbers
