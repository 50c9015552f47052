"""A base at rest: what is called still, what rest shows of large errors, and the update with noise that is correlated."""

import dataclasses

import numpy as np
import pytest

from sins_env import attitude, earth
from sins_env.prior import matched_prior
from sins_env.specs import GpsSpec, imu_spec
from sins_env.types import NavState, Site, Task
from solvers.blocks.conditioning import condition
from solvers.blocks.moments import correlated_moments
from solvers.pipeline.aiding.stillness import KNOWN_MPS, Stillness, rest
from solvers.pipeline.errors.model import GYRO_UNIT
from solvers.pipeline.errors.navigation import STATES
from solvers.types import Gaussian

SITE = Site(0.7, 0.3, 100.0)
MODEL = earth.get("wgs84")
RATE, G = earth.rate_n(MODEL, 0.7), earth.gravity(MODEL, 0.7, 100.0)
RUNS, EPOCHS, T = 40, 130, 0.1


def told(imu="rlg-car", gps=None, **more):
    imu, gps = imu_spec(imu), gps or GpsSpec(vel_std_mps=0.03, rate_hz=10.0)
    prior = matched_prior(imu, gps, T, (0.1, 0.1, 2.0))
    return Task("a base", SITE, T, 2, 300.0, 0.0, imu, gps, dataclasses.replace(prior, **more))


def record(task, rng, turning=0.0, pushing=0.0, moving=(0.0, 0.0, 0.0), has=1.0):
    """Observations of runs whose biases are one standard deviation, with a rate and a force besides (EPOCHS, RUNS, 3)."""
    C = attitude.to_dcm(attitude.from_euler(0.4, 0.02, -0.03)).T
    p, imu = task.prior, task.imu
    shape = (EPOCHS, RUNS, 2, 3)
    h = T / 2
    noise = [np.sqrt(np.diag(p.Q)[i] / 2) * rng.standard_normal(shape) for i in (0, 3)]
    w = C @ RATE + p.gyro_bias_std_deg_h * GYRO_UNIT + turning
    f = C @ [0.0, 0.0, G] + p.accel_bias_std_ug * 9.8e-6 + pushing
    true = (np.broadcast_to(a, (EPOCHS, RUNS, 3))[:, :, None] * h for a in (w, f))
    whole = [np.cumsum((a + n).swapaxes(1, 2).reshape(-1, RUNS, 3), axis=0) for a, n in zip(true, noise, strict=True)]
    lsb = imu.gyro_lsb_arcsec * np.radians(1 / 3600), imu.accel_lsb_mps
    whole = [np.diff(np.rint(a / q) * q if q else a, axis=0, prepend=0.0) for a, q in zip(whole, lsb, strict=True)]
    dtheta, dvel = (a.reshape(EPOCHS, 2, RUNS, 3).swapaxes(1, 2) for a in whole)
    fix = np.asarray(moving) + np.sqrt(np.diag(p.R)[:3]) * rng.standard_normal((EPOCHS, RUNS, 3))
    valid = (rng.random((EPOCHS, RUNS, 1)) < has).astype(np.int8)
    names = ("dtheta", "dvel", "gps_vel", "gps_valid")
    return [dict(zip(names, row, strict=True)) for row in zip(dtheta, dvel, fix * valid, valid, strict=True)]


def share(task, seen):
    """How often runs are called still once the window is full, and before."""
    detector = Stillness(task, RUNS)
    found = np.array([detector.seen(obs) for obs in seen])
    return found[99:].mean(), found[:99].mean()


@pytest.mark.parametrize("imu", ["rlg-car", "tactical", "mems"])
def test_rest_is_seen(imu):
    at, before = share(told(imu), record(told(imu), np.random.default_rng(1)))
    assert at > 0.999
    assert before == 0.0


CASES = {
    "sway": {"turning": 3e-5 * np.sin(np.arange(EPOCHS) / 5.0)[:, None, None] * [1.0, 0.3, 0.1]},
    "push": {"pushing": 0.2 * np.sin(np.arange(EPOCHS))[:, None, None] * [1.0, 0.0, 0.0]},
    "turntable": {"turning": np.array([0.0, 0.0, 1e-4])},
    "lift": {"pushing": np.array([0.0, 0.0, 0.05])},
    "cruise": {"moving": (0.02, 0.0, 0.0)},
    "outage": {"has": 0.0},
    "jolts": {"turning": 3e-5 * (np.arange(EPOCHS) % 10 == 9)[:, None, None]},
}


@pytest.mark.parametrize("case", CASES)
def test_what_is_not_rest(case):
    task = told()
    assert share(task, record(task, np.random.default_rng(2), **CASES[case]))[0] == 0.0


def test_motion_is_seen_at_once():
    """A turn of an arcsec, too small for the whole window, ends rest for a second."""
    task = told()
    seen = record(task, np.random.default_rng(3))
    seen[110]["dtheta"][:, 0, 1] += 4.8e-6
    detector = Stillness(task, RUNS)
    found = np.array([detector.seen(obs) for obs in seen])
    assert found[109].all()
    assert not found[110:120].any()
    assert found[120:].mean() > 0.9


def levels(seen, imu="rlg-car"):
    """What the detector says of a parked base in each epoch, (EPOCHS, RUNS)."""
    detector, found = Stillness(told(imu), RUNS), []
    for obs in seen:
        detector.seen(obs)
        found.append(detector.level())
    return np.array(found)


def rocked(amplitude, **more):
    """A base that a force of so many m/s^2 along one axis rocks with a period of 0.63 s."""
    force = amplitude * np.sin(np.arange(EPOCHS))[:, None, None] * [1.0, 0.0, 0.0]
    return record(told(), np.random.default_rng(2), pushing=force, **more)


def test_a_parked_base_has_the_velocity_with_which_it_is_rocked():
    """The RMS is that of the integral of the force; nothing is said before the window is full, and no less than 1 cm/s."""
    found = levels(rocked(0.6))
    v = np.cumsum(0.6 * T * np.sin(np.arange(EPOCHS)))
    assert np.isnan(found[:99]).all()
    np.testing.assert_allclose(found[99:], v.std() / np.sqrt(3.0), rtol=0.05)
    np.testing.assert_array_equal(levels(rocked(0.01))[99:], 0.01)


@pytest.mark.parametrize("case", [{"moving": (0.02, 0.0, 0.0)}, {"has": 0.0}, {"amplitude": 2.0}])
def test_what_is_not_parked(case):
    assert np.isnan(levels(rocked(**{"amplitude": 0.6, **case}))).all()


@pytest.mark.parametrize(("start", "latest"), [(1.0, 1), (0.1, 6)])
def test_a_start_is_seen_before_the_fixes_show_it(start, latest):
    """A parked base drives away after 11 s: no velocity beyond 0.06 m/s is taken for none."""
    force = np.where(np.arange(EPOCHS) < 110, 0.0, start)[:, None, None] * [0.0, 1.0, 0.0]
    found = levels(record(told(), np.random.default_rng(2), pushing=force))
    assert np.isfinite(found[99:110]).all()
    assert np.isnan(found[110 + latest : 120]).all()


def test_fixes_must_know_the_velocity():
    """As many as the square of their noise over that which is asked."""
    gps = GpsSpec(vel_std_mps=0.2, rate_hz=10.0)
    task, fewest = told(gps=gps), (0.2 / KNOWN_MPS) ** 2
    for count, still in ((fewest - 1, False), (fewest + 1, True)):
        seen = record(task, np.random.default_rng(4))
        for k, obs in enumerate(seen):
            obs["gps_valid"][:] = k % 100 < count
        assert (share(task, seen)[0] > 0.99) == still


def test_what_rest_shows_of_errors_of_any_size():
    """The residual of a base at rest is h of its errors: velocity, misalignment and biases."""
    rng = np.random.default_rng(5)
    task, phi, dv = told(), 1e-6 * rng.standard_normal(3), np.array([0.3, -0.2, 0.1])
    eps = np.array([1.0, -2.0, 3.0])
    C_hat = attitude.to_dcm(attitude.from_euler(0.4, 0.02, -0.03))
    C = attitude.misalignment_dcm(phi).T @ C_hat
    nav = NavState(attitude.from_dcm(C_hat), dv, SITE.pos)
    shown = rest(task, STATES, T * (C.T @ RATE + GYRO_UNIT * eps), nav)
    x = np.zeros(15)
    x[STATES["phi"]], x[STATES["dv"]], x[STATES["gyro_bias"]] = phi, dv, eps
    np.testing.assert_allclose(shown.z, shown.H @ x, rtol=1e-6, atol=1e-15)
    noise = shown.noise[3:, 3:]
    np.testing.assert_allclose(noise, task.prior.Q[:3, :3] / T**2)
    np.testing.assert_allclose(shown.cross[:3, 3:], -T * C_hat @ noise)


def test_the_heading_stays_where_it_was():
    """A minute at rest: with the correlation the attitude keeps its variance, with independent noise a random walk is left."""
    task = told()
    shown = rest(task, STATES, np.zeros(3), NavState(attitude.from_euler(0.4, 0.0, 0.0), np.zeros(3), SITE.pos))
    R, kept = shown.motion + shown.noise, []
    for M in (shown.cross, 0.0 * shown.cross):
        P = task.prior.P0.copy()
        P[:3, :3] = 0.0
        P[9:] /= GYRO_UNIT
        P[:, 9:] /= GYRO_UNIT
        C = attitude.to_dcm(attitude.from_euler(0.4, 0.0, 0.0))
        F = np.eye(15)
        F[:3, 9:12] = -T * GYRO_UNIT * C
        x = Gaussian(np.zeros(15), P)
        for _ in range(600):
            x = Gaussian(x.mean, F @ x.cov @ F.T)
            x.cov[:3, :3] += task.prior.Q[:3, :3]
            x, _, _ = condition(x, correlated_moments(shown.H, x, R, M), shown.z)
        kept.append(x.cov[2, 2] / (600 * task.prior.Q[2, 2]))
    assert kept[0] < 1e-3
    assert kept[1] > 0.05
