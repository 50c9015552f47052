"""pyins: ``run_feedback_filter`` on the flight. Its axes are North-East-Down and Front-Right-Down, its angles degrees."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd
from pyins.filters import run_feedback_filter
from pyins.inertial_sensor import EstimationModel
from pyins.measurements import NedVelocity, Position

from peers.flight import Flown, Tape
from sins_env import attitude
from sins_env.states import ERRORS, FIX
from sins_env.types import NavState
from solvers.types import Array

DISTRIBUTION = "python-ins"

LLA, VELOCITY, ANGLES = ["lat", "lon", "alt"], ["VN", "VE", "VD"], ["roll", "pitch", "heading"]
INCREMENT = ["theta_x", "theta_y", "theta_z", "dv_x", "dv_y", "dv_z"]


def swapped(v: Array) -> Array:
    """Turn vectors (..., 3) from East-North-Up to North-East-Down, or from Right-Front-Up to Front-Right-Down."""
    return v[..., [1, 0, 2]] * np.array([1.0, 1.0, -1.0])


def degrees(pos: Array) -> Array:
    """Return a position (..., 3) with latitude and longitude in degrees instead of radians."""
    return np.concatenate([np.degrees(pos[..., :2]), pos[..., 2:]], axis=-1)


def feedback_filter(tape: Tape, steps: int) -> Callable[[], Flown]:
    """Make the block of pyins; it gets one increment more than ``steps``, because it uses a fix at the next increment."""
    task = tape.task
    assert task.start is not None
    times = np.array([obs["t"][0] for obs in tape.observations[: steps + 1]])
    increments = pd.DataFrame(
        np.array(
            [np.concatenate([swapped(o["dtheta"][0]), swapped(o["dvel"][0])]) for o in tape.observations[: steps + 1]]
        ),
        index=times,
        columns=INCREMENT,
    )
    increments["dt"] = task.epoch_s
    fixes = tape.observations[:steps]
    positions = pd.DataFrame(degrees(np.array([o["gps_pos"] for o in fixes])), index=times[:steps], columns=LLA)
    velocities = pd.DataFrame(swapped(np.array([o["gps_vel"] for o in fixes])), index=times[:steps], columns=VELOCITY)
    R = np.sqrt(np.diagonal(task.prior.R))
    measurements = [Position(positions, R[FIX["dp"]]), NedVelocity(velocities, R[FIX["dv"]][0])]
    std = np.sqrt(np.diagonal(task.prior.P0))
    noise = np.sqrt(np.diagonal(task.prior.Q) / task.epoch_s)
    start = as_pva(task.start, times[0] - task.epoch_s)

    def block() -> Flown:
        result = run_feedback_filter(
            start,
            position_sd=std[ERRORS["dp"]][0],
            velocity_sd=std[ERRORS["dv"]][0],
            level_sd=np.degrees(std[ERRORS["phi"]][0]),
            azimuth_sd=np.degrees(std[ERRORS["phi"]][2]),
            increments=increments,
            gyro_model=EstimationModel(bias_sd=std[ERRORS["gyro_bias"]][0], noise=noise[ERRORS["phi"]][0]),
            accel_model=EstimationModel(bias_sd=std[ERRORS["accel_bias"]][0], noise=noise[ERRORS["dv"]][0]),
            measurements=measurements,
            time_step=task.epoch_s,
        )
        return Flown(as_state(result.trajectory.iloc[steps]))

    return block


def as_pva(nav: NavState, time: float) -> Any:
    """Return a state in the form of pyins."""
    heading, pitch, roll = attitude.to_euler(attitude.to_dcm(nav.q_nb))
    values = [*degrees(nav.pos), *swapped(nav.vel), *np.degrees([roll, pitch, heading])]
    return pd.Series(values, index=LLA + VELOCITY + ANGLES, name=time)


def as_state(pva: Any) -> NavState:
    """Return a state of pyins in our form."""
    lat, lon, alt = pva[LLA]
    roll, pitch, heading = np.radians(pva[ANGLES].to_numpy())
    return NavState(
        attitude.from_euler(heading, pitch, roll),
        swapped(pva[VELOCITY].to_numpy()),
        np.array([np.radians(lat), np.radians(lon), alt]),
    )
