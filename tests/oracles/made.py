"""Recordings made in memory, with values that can be told apart, and attitudes by scipy."""

import numpy as np

from sins_env.recordings import Gnss, Recording, Reference
from sins_env.types import Site

SITE = Site(0.53, 1.98, 21.5)
#: East-North-Up and Right-Forward-Up from North-East-Down and Forward-Right-Down: the same swap
SWAP = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])


def attitudes(t):
    """Rotations of Right-Forward-Up into East-North-Up, through north and over a wide range of tilt."""
    from scipy.spatial.transform import Rotation  # a process of followers.py starts without it

    angles = np.stack([3.0 * np.sin(0.2 * t), 0.4 * np.sin(t), 0.5 * np.cos(0.7 * t)], axis=-1)
    return Rotation.from_euler("ZXY", angles)


def recording(samples=2000, rate=200.0, t0=1000.0, gaps=(), gnss=True, reference=True, velocity=True, std=True, seed=0):
    """Increments of random numbers about gravity; ``gaps`` are slices of samples that are missing."""
    rng = np.random.default_rng(seed)
    dtheta = 1e-4 * rng.standard_normal((samples, 3))
    dvel = np.array([0.1, -0.2, 9.8]) / rate + 1e-3 * rng.standard_normal((samples, 3))
    for gap in gaps:
        dtheta[gap] = dvel[gap] = np.nan
    t = t0 + np.arange(1, int(samples / rate) + 1)
    many = len(t)
    pos = np.column_stack([0.53 + 1e-7 * np.arange(many), 1.98 - 1e-7 * np.arange(many), 20.0 + np.arange(many)])
    vel = rng.standard_normal((many, 3))
    fixes = Gnss(
        t,
        vel if velocity else None,
        pos,
        1 + rng.random((many, 3)) if std else None,
        0.1 + rng.random((many, 3)) if std and velocity else None,
    )
    t_ref = t0 + 0.05 * np.arange(1, int(20 * samples / rate) + 1)
    ones = np.ones((len(t_ref), 1))
    ref = Reference(
        t_ref,
        attitudes(t_ref).as_quat(scalar_first=True),
        rng.standard_normal((len(t_ref), 3)) if velocity else None,
        ones * [0.53, 1.98, 21.0] if velocity else None,
    )
    lever = np.array([0.3, -0.2, 1.1]) if gnss else None
    return Recording("made", rate, t0, dtheta, dvel, SITE, fixes if gnss else None, lever, ref if reference else None)
