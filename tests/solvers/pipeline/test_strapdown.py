"""Strapdown: round trips of exact increments, orders of coning and sculling, and pyins on the same increments."""

import numpy as np
import pandas as pd
import pytest
from pyins import strapdown as pyins_strapdown

from sins_env import attitude, earth
from sins_env.trajectory import STILL, THESIS, Sway, Vehicle
from sins_env.types import NavState, Site
from sins_env.units import ARCSEC
from solvers.pipeline import strapdown as S

SITE = Site(0.6974, 2.03, 50.0)
MODEL = earth.get("wgs84")


def fly(trajectory, epochs, hold_position=True, runs=2):
    """Largest attitude (rad) and velocity (m/s) errors over the run, and the last state and truth."""
    truth = trajectory.reset([np.random.default_rng(i) for i in range(runs)])
    mechanisation = S.Strapdown(MODEL, trajectory.epoch_s, trajectory.n_sub, SITE.pos, hold_position)
    state = mechanisation.start(NavState(truth.q_nb, truth.vel, np.broadcast_to(SITE.pos, truth.vel.shape)))
    worst_attitude = worst_velocity = 0.0
    for first in range(0, epochs, 100):
        motion = trajectory.chunk(first, min(100, epochs - first))
        for i in range(motion.dtheta.shape[1]):
            state, _ = mechanisation.advance(state, motion.dtheta[:, i], motion.dvel[:, i])
            error = attitude.multiply(state.nav.q_nb, attitude.conjugate(motion.state.q_nb[:, i]))
            worst_attitude = max(worst_attitude, attitude.rotation_angle(error).max())
            worst_velocity = max(worst_velocity, np.abs(state.nav.vel - motion.state.vel[:, i]).max())
    return worst_attitude, worst_velocity, state.nav


def test_sway_round_trip_for_600_seconds():
    angle, vel, _ = fly(Sway(SITE, 0.1, 30, THESIS), 6000)
    assert angle < 1e-4 * ARCSEC  # measured 3e-5; the house asks for 0.01
    assert vel < 2e-6  # measured 4e-7; the house asks for 1e-4


class Disturbed(Vehicle):
    """A parked car of the scene "mixed", six events a minute."""

    def reset(self, rngs):
        return super().reset(rngs, None, ["mixed"] * len(rngs))


@pytest.mark.parametrize(("n_sub", "arcsec", "mps"), [(10, 2e-3, 3e-6), (30, 2e-4, 1e-6)])
def test_disturbed_car_round_trip_for_300_seconds(n_sub, arcsec, mps):
    """Two samples at 100 Hz: measured 1.1e-3 arcsec and 1.6e-6 m/s; three at 300 Hz: 6e-5 and 2e-7."""
    angle, vel, _ = fly(Disturbed(SITE, 0.1, n_sub, 300.0, 6.0), 3000)
    assert angle < arcsec * ARCSEC
    assert vel < mps


def test_static_round_trip_for_one_hour_with_free_position():
    angle, vel, nav = fly(Sway(SITE, 0.2, 3, STILL), 18000, hold_position=False, runs=1)
    assert angle < 1e-3 * ARCSEC
    assert vel < 1e-4
    R = 6.4e6
    assert np.abs(nav.pos - SITE.pos)[..., :2].max() * R < 0.1
    assert np.abs(nav.pos - SITE.pos)[..., 2].max() < 0.1


@pytest.mark.parametrize(
    ("n_sub", "arcsec", "mps"), [(30, 1e-4, 1e-6), (10, 1e-4, 1e-6), (5, 0.01, 1e-5), (1, 1.5, 1e-3)]
)
def test_every_form_follows_the_sway(n_sub, arcsec, mps):
    """Three-, two- and one-sample forms over 60 s; a single sample per 0.1 s is what is left of the accuracy then."""
    angle, vel, _ = fly(Sway(SITE, 0.1, n_sub, THESIS), 600)
    assert angle < arcsec * ARCSEC
    assert vel < mps


def test_free_position_follows_the_sway_of_centimetres():
    trajectory = Sway(SITE, 0.1, 30, THESIS)
    _, vel, nav = fly(trajectory, 600, hold_position=False)
    truth = trajectory.chunk(599, 1).state
    start = trajectory.reset([np.random.default_rng(i) for i in range(2)])
    moved = (truth.pos[:, 0] - start.pos) - (nav.pos - SITE.pos)
    assert np.abs(moved[:, :2]).max() * 6.4e6 < 1e-4
    assert np.abs(moved[:, 2]).max() < 1e-4
    assert vel < 5e-6


def test_a_batch_is_its_runs():
    trajectory = Sway(SITE, 0.1, 30, THESIS)
    trajectory.reset([np.random.default_rng(i) for i in range(6)])
    motion = trajectory.chunk(0, 1)
    mechanisation = S.Strapdown(MODEL, 0.1, 30, SITE.pos, False)
    rng = np.random.default_rng(3)
    nav = NavState(
        attitude.normalize(rng.standard_normal((6, 4))), rng.standard_normal((6, 3)), np.tile(SITE.pos, (6, 1))
    )
    whole, _ = mechanisation.advance(mechanisation.start(nav), motion.dtheta[:, 0], motion.dvel[:, 0])
    shaped = NavState(*(part.reshape(2, 3, -1) for part in nav))
    block, _ = mechanisation.advance(
        mechanisation.start(shaped), motion.dtheta[:, 0].reshape(2, 3, 30, 3), motion.dvel[:, 0].reshape(2, 3, 30, 3)
    )
    for part, other in zip(whole.nav, block.nav, strict=True):
        np.testing.assert_allclose(other.reshape(part.shape), part, rtol=1e-14, atol=1e-15)
    for i in range(6):
        one, _ = mechanisation.advance(
            mechanisation.start(NavState(*(part[i] for part in nav))), motion.dtheta[i, 0], motion.dvel[i, 0]
        )
        for part, other in zip(one.nav, whole.nav, strict=True):
            np.testing.assert_allclose(other[i], part, rtol=1e-14, atol=1e-15)


class Coning:
    """Classical coning: the body's axis sweeps a cone; 5 Hz, half angle 1 deg."""

    omega = 2 * np.pi * 5

    def at(self, t):
        """q, body rate and specific force at times t."""
        a, w, zero = np.deg2rad(0.5), self.omega, np.zeros_like(t)
        q = np.stack([zero + np.cos(a), np.sin(a) * np.cos(w * t), np.sin(a) * np.sin(w * t), zero], -1)
        dq = np.stack([zero, -np.sin(a) * w * np.sin(w * t), np.sin(a) * w * np.cos(w * t), zero], -1)
        return q, 2 * attitude.multiply(attitude.conjugate(q), dq)[..., 1:], np.zeros((*t.shape, 3))

    def run(self, h, samples, duration=0.4):
        """Attitude and velocity errors after ``duration`` of intervals of length h."""
        intervals = round(duration / h)
        edges = np.linspace(0, duration, intervals * samples + 1)
        nodes, weights = np.polynomial.legendre.leggauss(12)
        half = 0.5 * (edges[1] - edges[0])
        t = (edges[:-1] + half)[:, None] + half * nodes
        q, rate, f = self.at(t)
        dtheta, dvel = half * np.einsum("q,tqi->ti", weights, rate), half * np.einsum("q,tqi->ti", weights, f)
        truth = half * np.einsum("q,tqi->i", weights, np.einsum("tqij,tqj->tqi", attitude.to_dcm(q), f))
        _, rate0, f0 = self.at(edges[:1] - half)
        last = np.concatenate([2 * half * rate0[0], 2 * half * f0[0]])
        rotation, dvel_b = S.interval_increments(dtheta, dvel, last)
        ends, steps = S.chain(rotation, dvel_b)
        q0 = self.at(np.zeros(1))[0][0]
        vel = attitude.to_dcm(q0) @ steps.sum(axis=0)
        end = attitude.multiply(q0, ends[-1])
        true_end = self.at(np.array([duration]))[0][0]
        return attitude.rotation_angle(attitude.multiply(end, attitude.conjugate(true_end))), np.linalg.norm(
            vel - truth
        )


class Sculling(Coning):
    """Classical sculling: rotation about x and force along y in phase. The angle is so small that only the term of first
    order in it, which the sculling correction is made for, is left."""

    def at(self, t):
        a, w, zero = 1e-4, self.omega, np.zeros_like(t)
        q = attitude.from_rotvec(np.stack([a * np.sin(w * t), zero, zero], -1))
        return q, np.stack([a * w * np.cos(w * t), zero, zero], -1), np.stack([zero, 10 * np.sin(w * t), zero], -1)


FORMS = [(3, 6), (2, 4), (1, 4)]


@pytest.mark.parametrize(("samples", "order"), FORMS)
@pytest.mark.parametrize(("motion", "part"), [(Coning, 0), (Sculling, 1)])
def test_order_of_coning_and_sculling(monkeypatch, samples, order, motion, part):
    """The rectified errors fall with the claimed power of the update interval (one sample with carry-over: two samples' order)."""
    monkeypatch.setattr(S, "samples_per_interval", lambda n_sub: samples)
    coarse, fine = (motion().run(0.4 / d, samples)[part] for d in (20, 40))
    assert abs(np.log2(coarse / fine) - order) < 0.3


def test_printed_sculling_coefficients_are_of_second_order(monkeypatch):
    """000 (2.2.33) as printed (27/20, erratum 6): the test above can fail."""
    printed = S.COUPLING[3].copy()
    for i, j in ((0, 1), (1, 2)):
        printed[i, j], printed[j, i] = 27 / 20, -27 / 20
    monkeypatch.setattr(S, "samples_per_interval", lambda n_sub: 3)
    monkeypatch.setitem(S.COUPLING, 3, printed)
    coarse, fine = (Sculling().run(0.4 / d, 3)[1] for d in (20, 40))
    assert abs(np.log2(coarse / fine) - 2) < 0.3


@pytest.mark.filterwarnings("ignore:The copy keyword is deprecated")  # raised inside pyins 1.0.1
def test_pyins_on_the_same_increments():
    """ENU/RFU -> NED/FRD: both integrate 60 s of sway and end in the same place."""
    trajectory = Sway(SITE, 0.1, 30, THESIS)
    truth = trajectory.reset([np.random.default_rng(5)])
    motion = trajectory.chunk(0, 600)
    frd = np.array([1, 0, 2]), np.array([1.0, 1.0, -1.0])

    def to_frd(v):
        return v[..., frd[0]] * frd[1]

    dtheta, dvel = (to_frd(part[0].reshape(-1, 3)) for part in (motion.dtheta, motion.dvel))
    time = np.arange(len(dtheta) + 1) / 300
    before = np.zeros((1, 3))  # pyins wants one sample before the first
    imu = pd.DataFrame(
        np.hstack([np.vstack([before, dtheta]), np.vstack([before, dvel])]),
        index=time,
        columns=["gyro_x", "gyro_y", "gyro_z", "accel_x", "accel_y", "accel_z"],
    )
    heading, pitch, roll = (np.degrees(a[0]) for a in attitude.to_euler(attitude.to_dcm(truth.q_nb)))
    vel = to_frd(truth.vel[0])
    pva = pd.Series(
        [np.degrees(SITE.latitude), np.degrees(SITE.longitude), SITE.height, *vel, roll, pitch, heading],
        index=["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"],
        name=0.0,
    )
    result = (
        pyins_strapdown.Integrator(pva)
        .integrate(pyins_strapdown.compute_increments_from_imu(imu, "increment"))
        .iloc[-1]
    )
    _, _, nav = fly(trajectory_again(), 600, hold_position=False, runs=1)
    ours = np.degrees(np.array(attitude.to_euler(attitude.to_dcm(nav.q_nb[0]))))
    theirs = result[["heading", "pitch", "roll"]].to_numpy(dtype=float)
    assert np.abs(attitude.wrap(np.radians(ours - theirs))).max() < 0.02 * ARCSEC
    assert np.abs(to_frd(nav.vel[0]) - result[["VN", "VE", "VD"]].to_numpy(dtype=float)).max() < 1e-3
    assert abs(np.degrees(nav.pos[0, 0]) - result["lat"]) * 111e3 < 0.02


def trajectory_again():
    class Fixed(Sway):
        def reset(self, rngs):
            return super().reset([np.random.default_rng(5)])

    return Fixed(SITE, 0.1, 30, THESIS)
