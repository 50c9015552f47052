"""What a data set says of itself: task, seed, times, units, and what solvers are told."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from sins_env import __version__
from sins_env.evaluation.tasks.fingerprint import digest
from sins_env.learning.drawing import Drawing

VERSION = 1  #: version of the arrays, which a change of a name, shape or unit raises
#: The parts of a state, with their sizes and units.
STATES = {
    "q_nb": (4, "unit quaternion, scalar first, body R F U to navigation E N U"),
    "vel": (3, "m/s East, North, Up"),
    "pos": (3, "latitude rad, longitude rad, height m"),
}
#: The true states at the ends of epochs and at t = 0, and the told ones at t = 0.
KINDS = ("truth", "truth0", "start")


def units(drawing: Drawing) -> dict[str, str]:
    """Return unit and meaning of each array."""
    own = {
        "t": "s, end of the epoch",
        "dtheta": "rad, rotation increments R F U",
        "dvel": "m/s, velocity increments R F U",
    }
    states = {f"{kind}_{name}": unit for kind in KINDS for name, (_, unit) in STATES.items()}
    return own | drawing.meanings | states | {"start_known": "whether the start is told"}


def about(drawing: Drawing, splits: Sequence[int]) -> dict[str, Any]:
    """Return the facts of a data set, as JSON can hold them."""
    task, public = drawing.task, drawing.public
    return {
        "format": "sins-env data set",
        "version": VERSION,
        "sins_env": __version__,
        "task": task.name,
        "digest": digest(task),
        "env_id": task.env_id,
        "kwargs": dict(task.kwargs),
        "seed": drawing.seed,
        "splits": list(splits),
        "epoch_s": public.epoch_s,
        "samples": drawing.n_sub,
        "duration_s": public.duration_s,
        "coarse_s": public.coarse_s,
        "navigate": public.navigate,
        "delta_azimuth_deg": task.delta_azimuth_deg,
        "delta_level_arcsec": task.delta_level_arcsec,
        "told": {name: asdict(getattr(public, name)) for name in ("site", "imu", "gps", "prior")},
        "told_aids": {aid.name: asdict(aid) for aid in public.aids},
        "units": units(drawing),
    }
