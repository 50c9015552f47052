"""``SINS/Replay-v0``: a real recording delivered epoch by epoch, as the simulated environments deliver theirs.

A window of the recording is one episode. With a ``stride`` there are as many windows as fit, window i beginning
``i * stride`` seconds after the first; ``reset(options={"window": i})`` picks one, else the run's seed draws it.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, recordings
from sins_env.envs.align import AlignEnv, AlignVectorEnv
from sins_env.envs.settings import STARTS, check_misalignment, check_timing, told_start
from sins_env.envs.windows import Windows
from sins_env.envs.world import CHUNK_EPOCHS, EpochData, World
from sins_env.errors import build, unknown
from sins_env.imu import standard_normal
from sins_env.specs import (
    COARSE_STD_DEG,
    GPS_PRESETS,
    PRIORS,
    TOLD_START_STD_DEG,
    GpsSpec,
    ImuSpec,
    gps_spec,
    imu_spec,
)
from sins_env.types import NavState, Task

Array = NDArray[np.float64]
