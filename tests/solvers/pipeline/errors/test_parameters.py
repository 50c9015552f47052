"""Parameters of aids behind the states of an error model: everything else is as it is without them."""

import dataclasses

import gymnasium
import numpy as np
import pytest

import solvers
from sins_env import attitude, earth
from sins_env.prior import matched_prior
from sins_env.specs import GpsSpec, ImuSpec
from sins_env.types import NavState
from sins_env.units import DEG_PER_H, UG
from solvers.pipeline import feedback
from solvers.pipeline.aiding.gps import Fix
from solvers.pipeline.errors.alignment import AlignmentErrors
from solvers.pipeline.errors.invariant import Invariant
from solvers.pipeline.errors.model import Parameter
from solvers.pipeline.errors.navigation import NavigationErrors
from solvers.pipeline.strapdown import EpochMotion
from solvers.types import Gaussian

MODEL = earth.get("wgs84")
SITE = np.array([0.6, 1.9, 300.0])
MORE = (Parameter("wheel.scale", 1, "1e-3", 1e-3, std=3e-3), Parameter("wheel.mounting", 2, "mrad", 1e-3, std=5e-3))
MODELS = (AlignmentErrors(), AlignmentErrors(False, False), NavigationErrors(), NavigationErrors(position=False))
PAIRS = [(model, dataclasses.replace(model, parameters=MORE)) for model in MODELS]
PRIOR = matched_prior(ImuSpec(), GpsSpec(), 0.1, (1, 1, 15))
pairs = pytest.mark.parametrize(("plain", "longer"), PAIRS)


def an_epoch(batch):
    rng = np.random.default_rng(1)
    vel, T = 20 * rng.standard_normal((*batch, 3)), earth.transport_matrix(MODEL, 0.6)
    C = attitude.to_dcm(attitude.normalize(rng.standard_normal((*batch, 4))))
    force = 0.1 * (np.array([0.3, -0.2, 9.8]) + rng.standard_normal((*batch, 3)))
    slope = earth.gravity_slope(MODEL, np.full(batch, 0.6))
    return EpochMotion(0.1, C, force, vel, earth.rate_n(MODEL, 0.6), np.matmul(T, vel[..., None])[..., 0], T, slope)


def errors_of(n, *batch):
    return 0.3 * np.random.default_rng(2).standard_normal((*batch, n))


def test_they_stand_behind():
    for plain, longer in PAIRS:
        assert longer.states.names == (*plain.states.names, "wheel.scale", "wheel.mounting")
        assert longer.states.size == plain.states.size + 3


@pairs
def test_start_and_noise(plain, longer):
    prior = matched_prior(ImuSpec(arw_deg_sqrt_h=0.01, vrw_ug_sqrt_hz=5), GpsSpec(), 0.5, (1, 2, 15))
    n = plain.states.size
    (mean, P), (_, P_plain) = longer.prior(prior.P0, (4,)), plain.prior(prior.P0, (4,))
    assert mean.shape == (4, n + 3)
    np.testing.assert_array_equal(P[:, :n, :n], P_plain)
    np.testing.assert_allclose(P[1, n:, n:], np.diag([9.0, 25.0, 25.0]))  # in units of 1e-3
    assert not P[:, :n, n:].any()
    Q = longer.noise(prior)
    np.testing.assert_array_equal(Q[:n, :n], plain.noise(prior))
    assert not Q[n:].any()
    assert not Q[:, n:].any()


@pairs
@pytest.mark.parametrize("shape", [(4,), (4, 7)])
def test_an_epoch_leaves_them_and_moves_the_rest_alike(plain, longer, shape):
    n, m = plain.states.size, an_epoch((4,))
    x = errors_of(n + 3, *shape)
    moved = longer.transition(m, longer.noise(PRIOR)).f(x)
    np.testing.assert_array_equal(moved[..., :n], plain.transition(m, plain.noise(PRIOR)).f(x[..., :n].copy()))
    np.testing.assert_array_equal(moved[..., n:], x[..., n:])


@pairs
def test_fix_correction_and_feedback(plain, longer):
    n = plain.states.size
    x, hat = errors_of(n + 3, 4), errors_of(n + 3, 4) + 0.01
    nav = NavState(attitude.normalize(np.ones((4, 4))), np.ones((4, 3)), np.tile(SITE, (4, 1)))
    for with_more, without in zip(longer.corrected(MODEL, nav, x), plain.corrected(MODEL, nav, x[:, :n]), strict=True):
        np.testing.assert_array_equal(with_more, without)
    if plain.biases(x[:, :n]) is not None:
        np.testing.assert_array_equal(longer.biases(x), plain.biases(x[:, :n]))
    m = len(Fix(plain.states).measurement(np.zeros(6), np.eye(6)).h(x[:, :n])[0])
    for arm in (None, np.ones((4, 2, 3))):
        seen = [
            Fix(model.states).measurement(np.zeros((4, m)), np.eye(m), arm).h(state)
            for model, state in ((longer, x), (plain, x[:, :n]))
        ]
        np.testing.assert_array_equal(*seen)
    maps = [
        feedback.reset_maps(state, model.states["phi"], model.states.span(*model.fed))
        for model, state in ((longer, hat), (plain, hat[:, :n]))
    ]
    (g, jacobian), (g_plain, jacobian_plain) = maps
    np.testing.assert_array_equal(g(x)[:, :n], g_plain(x[:, :n]))
    np.testing.assert_array_equal(g(x)[:, n:], x[:, n:])  # the aid keeps them, not the INS
    np.testing.assert_array_equal(jacobian(x)[:, :n, :n], jacobian_plain(x[:, :n]))
    np.testing.assert_array_equal(jacobian(x)[:, n:], np.tile(np.eye(n + 3)[n:], (4, 1, 1)))


@pytest.mark.parametrize("position", [True, False])
@pytest.mark.parametrize("size", [0.0, 1.0])
def test_invariant_coordinates(position, size):
    """At zero, where the slope has a closed form, and away from it."""
    plain, longer = (NavigationErrors(position, parameters=more) for more in ((), MORE))
    n = plain.states.size
    nav = NavState(np.ones((4, 4)), 20 * errors_of(3, 4), earth.displace(MODEL, np.tile(SITE, (4, 1)), errors_of(3, 4)))
    a, b = (Invariant(MODEL, SITE, model.states) for model in (plain, longer))
    x = size * errors_of(n + 3, 4)
    np.testing.assert_array_equal(b.errors(x, nav)[:, :n], a.errors(x[:, :n], nav))
    np.testing.assert_array_equal(b.errors(x, nav)[:, n:], x[:, n:])
    P = np.tile(np.diag(np.arange(1.0, n + 4)), (4, 1, 1))
    for found, expected in (
        (b.prior(Gaussian(x, P), nav), a.prior(Gaussian(x[:, :n], P[:, :n, :n]), nav)),
        (b.gaussian(Gaussian(x, P), nav), a.gaussian(Gaussian(x[:, :n], P[:, :n, :n]), nav)),
    ):
        np.testing.assert_allclose(found.cov[:, :n, :n], expected.cov, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(found.cov[:, n:, n:], P[:, n:, n:])
        np.testing.assert_array_equal(found.mean[:, :n], expected.mean)


@pytest.mark.parametrize("name", ["ekf", "gsf_imm"])
def test_biases_wander_as_told(name):
    """After a tenth of a correlation time without fixes, as random walks of the growth of the told Gauss-Markov biases."""
    imu = {"gyro_markov_deg_h": 5.0, "gyro_markov_s": 20.0, "accel_markov_ug": 1000.0, "accel_markov_s": 40.0}
    env = gymnasium.make("SINS/NavFlight-v0", imu=imu, gps={"outages_s": [[0.0, 10.0]]}, duration=2.0)
    found = []
    for walk in (False, True):
        obs, _ = env.reset(seed=1)
        solver = solvers.make(name, bias_walk=walk)
        solver.reset(env.unwrapped.task, np.random.default_rng(1))
        for _ in range(20):
            obs = env.step(solver.step(obs))[0]
        found.append(np.square([solver.diagnostics()[bias + "_sigma"] for bias in ("gyro_bias", "accel_bias")]))
    told = np.square([5.0 * DEG_PER_H, 1000.0 * UG])
    grown = 2.0 * told * [2.0 / 20.0, 2.0 / 40.0]
    np.testing.assert_allclose(found[1] - found[0], np.broadcast_to(grown[:, None], (2, 3)), rtol=1e-6)
