"""Where navigation begins after coarse alignment: on a base at rest, with exact increments made by hand."""

import dataclasses

import numpy as np
import pymap3d
import pytest
from numpy.testing import assert_allclose

from sins_env import attitude, earth
from sins_env.worlds.flight import FlightSettings
from solvers import make
from solvers.filters.kalman.kf import KF
from solvers.pipeline.estimator import Aligner, Navigator

EPOCH, N_SUB, COARSE, LEVER = 0.1, 3, 20.0, (0.5, -1.0, 2.0)
Q = attitude.from_euler(np.radians([40.0, 130.0]), np.radians([2.0, -1.0]), np.radians([-3.0, 1.0]))
C = attitude.to_dcm(Q)


@pytest.fixture
def task():
    task = FlightSettings(duration=30.0).task("SINS/NavFlight-v0")
    gps = dataclasses.replace(task.gps, lever_arm_m=LEVER)
    more = {"epoch_s": EPOCH, "n_sub": N_SUB, "coarse_s": COARSE, "gps": gps, "start": None}
    return dataclasses.replace(task, duration_s=30.0, **more)


def observations(task, fixes, noise=0.0):
    """Two runs; ``fixes``: by number of the epoch, metres E, N, U of the IMU from the site, for each run or None."""
    model, site = earth.get(task.site.earth), task.site
    rate = np.swapaxes(C, -1, -2) @ earth.rate_n(model, site.latitude)
    force = np.swapaxes(C, -1, -2) @ np.array([0.0, 0.0, float(earth.gravity(model, site.latitude, site.height))])
    rng = np.random.default_rng(0)
    for k in range(1, round(COARSE / EPOCH) + 1):
        obs = {"t": np.full((2, 1), EPOCH * k), "gps_vel": np.zeros((2, 3)), "gps_pos": np.zeros((2, 3))}
        obs["gps_valid"] = np.zeros((2, 1), np.int8)
        for name, value in (("dtheta", rate), ("dvel", force)):
            obs[name] = np.repeat(value[:, None] * EPOCH / N_SUB, N_SUB, axis=1)
        for run, offset in enumerate(fixes.get(k, (None, None))):
            if offset is not None:
                enu = np.array(offset) + C[run] @ LEVER
                obs["gps_pos"][run] = pymap3d.enu2geodetic(*enu, *site.pos, deg=False)
                obs["gps_vel"][run] = noise * rng.standard_normal(3)
                obs["gps_valid"][run] = 1
        yield obs


def test_the_place_is_that_of_the_last_fix(task):
    """Its own for each run, less the lever arm; the site where there has been none."""
    navigator = Navigator(KF())
    navigator.reset(task, np.random.default_rng(0), 2)
    fixes = {50: ((9.0, 9.0, 9.0), None), 120: ((3.0, -4.0, 1.0), None)}
    actions = [navigator.step(obs) for obs in observations(task, fixes)]
    end = actions[-1]
    off = np.stack(pymap3d.geodetic2enu(*end[:, 7:].T, *task.site.pos, deg=False), axis=-1)
    assert_allclose(off, [[3.0, -4.0, 1.0], [0.0, 0.0, 0.0]], atol=1e-4)
    assert_allclose(end[:, 4:7], 0.0, atol=1e-15)
    assert_allclose(actions[0][:, 7:], np.tile(task.site.pos, (2, 1)))
    assert np.abs(attitude.misalignment(end[:, :4], Q)).max() < np.radians(1e-3)


def test_a_base_at_rest_needs_no_velocity(task):
    """Of fixes that are 0.1 m/s wrong each second the default makes nothing, ``aided`` all: g omega cos L t^2 / 2 is 0.1 m/s."""
    fixes = {k: ((0.0, 0.0, 0.0),) * 2 for k in range(10, 200, 10)}
    away = {}
    for coarse in (None, "aided"):
        navigator = Navigator(KF(), coarse=coarse)
        navigator.reset(task, np.random.default_rng(0), 2)
        *_, end = (navigator.step(obs) for obs in observations(task, fixes, noise=0.1))
        away[coarse] = np.degrees(np.abs(attitude.misalignment(end[:, :4], Q)[:, 2]))
    assert away[None].max() < 1e-3
    assert away["aided"].min() > 1.0


def test_the_default_of_the_coarse_phase():
    assert (Navigator.default.coarse, Aligner.default.coarse) == ("svd", "aided")
    pipeline = make("ckf")
    assert (pipeline.navigator.settings.coarse, pipeline.aligner.settings.coarse) == (None, None)
    pipeline = make("ckf", coarse="two_vector")
    assert (pipeline.navigator.settings.coarse, pipeline.aligner.settings.coarse) == ("two_vector",) * 2
    with pytest.raises(ValueError, match="did you mean 'svd'"):
        Navigator(KF(), coarse="sdv")
