"""What is told, drawn from what is told, and refused."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles.courses import (
    IDENTITY,
    ONE_SECOND_UNKNOWN,
    STATIC,
    SWAY,
    actions_of,
    make,
    play,
    vector,
)
from scipy import stats

from sins_env import attitude


@pytest.mark.parametrize("phi", [(1.0, 1.0, 10.0), (-3.0, 2.0, 170.0), (0.0, 0.0, 0.0)])
def test_told_start_has_the_misalignment_asked_for(phi):
    env = vector(5, misalignment_deg=phi, heading_deg=None, reveal_truth=True)
    _, info = env.reset(seed=0)
    found = attitude.misalignment(info["start"]["q_nb"], info["truth"]["q_nb"])
    assert_allclose(found, np.tile(np.radians(phi), (5, 1)), atol=1e-13)


@pytest.mark.parametrize("env_id", [SWAY, STATIC])
def test_a_heading_that_is_not_told_is_drawn_over_the_circle_in_each_run(env_id):
    rows = 200
    _, info = vector(rows, env_id, heading_deg=None, reveal_truth=True).reset(seed=0)
    heading, _, _ = attitude.to_euler(attitude.to_dcm(info["truth"]["q_nb"]))
    assert stats.kstest(heading % (2 * np.pi), stats.uniform(0.0, 2 * np.pi).cdf).pvalue > 1e-3


def test_told_start_is_drawn_from_the_matched_prior():
    rows = 2000
    env = vector(rows, reveal_truth=True)
    _, info = env.reset(seed=0)
    P0 = env.unwrapped.task.prior.P0
    phi = attitude.misalignment(info["start"]["q_nb"], info["truth"]["q_nb"])
    dv = info["start"]["vel"] - info["truth"]["vel"]
    errors = np.concatenate([phi, dv], axis=1)
    sigma = np.sqrt(np.diag(P0)[:6])
    assert_allclose(sigma, [*np.radians([1, 1, 15]), 0.2, 0.2, 0.2])
    assert np.all(np.abs(errors.std(axis=0) / sigma - 1) < 3 / np.sqrt(2 * rows))
    assert np.all(np.abs(errors.mean(axis=0)) < 3 * sigma / np.sqrt(rows))
    assert np.abs(np.corrcoef(errors.T) - np.eye(6)).max() < 4 / np.sqrt(rows)


@pytest.mark.parametrize("prior", ["matched", "thesis"])
def test_any_heading_is_drawn_over_the_circle_and_told(prior):
    rows = 2000
    env, usual = vector(rows, any_heading=True, prior=prior, reveal_truth=True), vector(rows, prior=prior)
    (_, info), (_, other) = env.reset(seed=0), usual.reset(seed=0)
    phi = attitude.misalignment(info["start"]["q_nb"], info["truth"]["q_nb"])
    assert stats.kstest(phi[:, 2], stats.uniform(-np.pi, 2 * np.pi).cdf).pvalue > 0.01
    assert np.all(np.abs(phi[:, :2].std(axis=0) / np.radians(1.0) - 1) < 3 / np.sqrt(2 * rows))
    assert_array_equal(info["start"]["vel"], other["start"]["vel"])  # all else is drawn as before
    assert_allclose(np.sqrt(np.diag(env.unwrapped.task.prior.P0)[:3]), [*np.radians([1, 1]), np.pi / np.sqrt(3)])


def test_sensor_errors_are_drawn_from_the_matched_prior():
    """The mean increments of a still base less the truth are bias and averaged noise."""
    rows = 2000
    env = vector(rows, STATIC, imu={"gyro_bias_deg_h": 0.02, "accel_bias_ug": 100.0}, duration=0.3)
    perfect = vector(1, STATIC, imu="perfect", duration=0.3)
    obs, truth = env.reset(seed=0)[0], perfect.reset(seed=0)[0]
    P0 = np.diag(env.unwrapped.task.prior.P0)
    for key, variance in (("dtheta", P0[9:12]), ("dvel", P0[12:15])):
        bias = (obs[key] - truth[key]).sum(axis=1) / 0.1
        assert np.all(np.abs(bias.std(axis=0) / np.sqrt(variance) - 1) < 3 / np.sqrt(2 * rows))


def test_fixes_are_drawn_from_the_told_noise():
    env = vector(700, STATIC, duration=0.5)
    fixes = [c[0]["gps_vel"] for c in play(env, actions_of(700, 4), seed=0)]
    std = np.sqrt(np.diag(env.unwrapped.task.prior.R)[:3])
    assert_allclose(std, 0.1)
    assert np.all(np.abs(np.std(fixes, axis=(0, 1)) / std - 1) < 3 / np.sqrt(2 * 3500))


def test_told_process_noise_and_thesis_prior():
    matched, thesis = (make(imu="thesis-white", prior=p).task.prior for p in ("matched", "thesis"))
    arw, vrw = np.radians(0.01) / 60, 5e-6 * 9.80665
    assert_allclose(np.diag(matched.Q)[:6] / 0.1, [*[arw**2] * 3, *[vrw**2] * 3], rtol=1e-9)
    step = [np.radians(0.01 / 3600) ** 2] * 3 + [(5e-4 * 9.80665) ** 2] * 3  # added 100 times a second
    assert_allclose(np.diag(thesis.Q)[:6], 10 * np.array(step), rtol=1e-9)
    assert_allclose(np.diag(thesis.R)[:3], 0.01)
    spec = {"gyro_bias_deg_h": 3.0, "gyro_markov_deg_h": 4.0, "accel_bias_ug": 5.0, "accel_markov_ug": 12.0}
    markov = make(imu=spec).task.prior
    assert (markov.gyro_bias_std_deg_h, markov.accel_bias_std_ug) == (5.0, 13.0)  # constant plus stationary


@pytest.mark.parametrize("rows", [None, 3])
def test_task_start_is_the_start_of_info(rows):
    env = make() if rows is None else vector(rows)
    before = env.unwrapped.task
    _, info = env.reset(seed=0)
    start = env.unwrapped.task.start
    for name in ("q_nb", "vel", "pos"):
        assert_array_equal(getattr(start, name), info["start"][name])
        assert getattr(start, name).shape == (() if rows is None else (3,)) + ((4,) if name == "q_nb" else (3,))
    assert np.all(info["start"]["known"])
    assert before.start is None
    assert dataclasses.replace(env.unwrapped.task, start=None) == before


@pytest.mark.parametrize("rows", [None, 3])
def test_unknown_start(rows):
    env = make(**ONE_SECOND_UNKNOWN) if rows is None else vector(rows, **ONE_SECOND_UNKNOWN)
    _, info = env.reset(seed=0)
    task = env.unwrapped.task
    assert task.start is None
    assert task.coarse_s == 0.5
    assert not np.any(info["start"]["known"])
    assert_array_equal(np.atleast_2d(info["start"]["q_nb"])[0], IDENTITY)
    assert_array_equal(np.atleast_2d(info["start"]["vel"])[0], 0.0)
    assert_array_equal(np.atleast_2d(info["start"]["pos"])[0], task.site.pos)
    assert_allclose(task.prior.attitude_std_deg, (0.1, 0.1, 2.0))


def test_surprises_are_not_told():
    gps = {"outages_s": [[1.0, 2.0]], "jump_mps": 1.0, "jump_s": 1.0, "contamination": 0.1}
    told = make(gps=gps).task.gps
    assert told.outages_s == ()
    assert told.jump_mps == 0.0
    assert told.contamination == 0.1


def test_nothing_of_the_truth_is_in_the_info_unless_asked():
    for obs, _, _, info in play(make(), [IDENTITY] * 3, seed=0):
        assert "truth" not in info
        assert "truth" not in obs


BAD = [
    ({"imuu": "mems"}, "'imuu'; did you mean 'imu'"),
    ({"imu": "mens"}, "unknown IMU preset 'mens'; did you mean 'mems'"),
    ({"imu": {"gyro_bias": 1.0}}, "unknown setting of ImuSpec 'gyro_bias'; did you mean 'gyro_bias_deg_h'"),
    ({"imu": {"preset": "mens"}}, "did you mean 'mems'"),
    ({"imu": {"arw_deg_sqrt_h": -1.0}}, "ImuSpec.arw_deg_sqrt_h = -1.0; allowed: a finite number, not negative"),
    ({"imu": {"gyro_markov_s": 0.0}}, "allowed: a positive correlation time"),
    ({"imu": 3}, "IMU preset: 3; allowed: a preset's name"),
    ({"gps": "thesys"}, "unknown GPS preset 'thesys'; did you mean 'thesis'"),
    ({"gps": {"rate": 1.0}}, "unknown setting of GpsSpec 'rate'; did you mean 'rate_hz'"),
    ({"gps": {"rate_hz": 3.0}}, "GPS rate 3 Hz with epochs of 0.1 s"),
    ({"gps": {"vel_std_mps": [1, 2]}}, "GpsSpec.vel_std_mps = [1, 2]; allowed: one finite number or three"),
    ({"start": "tolt"}, "unknown start 'tolt'; did you mean 'told'"),
    ({"prior": "mached"}, "unknown prior 'mached'; did you mean 'matched'"),
    ({"motion": "randm"}, "unknown motion 'randm'; did you mean 'random'"),
    ({"earth": "wgs-84"}, "unknown earth model 'wgs-84'; did you mean 'wgs84'"),
    ({"latitude_deg": 89.95}, "latitude_deg = 89.95; allowed: -89.9 to 89.9"),
    ({"latitude_deg": float("nan")}, "allowed: -89.9 to 89.9"),
    ({"heading_deg": float("inf")}, "heading_deg = inf; allowed"),
    ({"duration": 0.25}, "duration = 0.25 s with epochs of 0.1 s; allowed: a whole number of epochs"),
    ({"duration": 0.2}, "at least 3, for instance 0.3 s"),
    ({"duration": -5.0}, "allowed: a whole number of epochs"),
    ({"duration": float("nan")}, "duration = nan; allowed: a finite number"),
    ({"epoch": 0.0}, "epoch = 0.0; allowed: a positive number"),
    ({"epoch": float("nan")}, "epoch = nan; allowed: a positive number"),
    ({"n_sub": 0}, "n_sub = 0; allowed: a whole number of IMU samples"),
    ({"n_sub": 2.5}, "n_sub = 2.5; allowed"),
    ({"n_sub": float("nan")}, "n_sub = nan; allowed"),
    ({"n_sub": True}, "n_sub = True; allowed"),
    ({"epoch": 10**400}, "allowed: a positive number"),
    ({"start": {}}, "unknown start {}"),
    ({"prior": {}}, "unknown prior {}; allowed: matched, thesis"),
    ({"motion": ["thesis"]}, "motion = ['thesis']; allowed: thesis, random, or a dict of yaw"),
    ({"reveal_truth": "x"}, "reveal_truth = 'x'; allowed: True or False"),
    ({"misalignment_deg": [[1], [2, 3]]}, "misalignment_deg = [[1], [2, 3]]; allowed: three finite numbers"),
    ({"misalignment_deg": [[1, 2, 3]] * 3}, "allowed: three finite numbers"),
    ({"coarse": 1.0}, "coarse = 1.0 with start = 'told'; allowed: 0"),
    ({"start": "unknown", "coarse": 2.5}, "allowed: coarse shorter than the duration"),
    ({"start": "unknown", "coarse": -1.0}, "coarse = -1.0"),
    (
        {"start": "unknown", "coarse": 1.0, "misalignment_deg": [1, 1, 1]},
        "misalignment_deg with start = 'unknown'",
    ),
    ({"any_heading": 1}, "any_heading = 1; allowed: True or False"),
    ({"any_heading": True, "start": "unknown", "coarse": 1.0}, "any_heading with start = 'unknown'"),
    ({"any_heading": True, "misalignment_deg": [1, 1, 1]}, "allowed: with start = 'told' and a drawn misalignment"),
    ({"misalignment_deg": [1, 1]}, "allowed: three finite numbers"),
    ({"misalignment_deg": [1, 1, float("nan")]}, "allowed: three finite numbers"),
    ({"misalignment_deg": 5.0}, "allowed: three finite numbers"),
    ({"misalignment_deg": "abc"}, "allowed: three finite numbers"),
    ({"render_mode": "ansi"}, "unknown render_mode 'ansi'; allowed: rgb_array"),
    ({"vibration": "no"}, "vibration = 'no'; allowed: True or False"),
    ({"duration": "long"}, "duration = 'long'; allowed"),
    ({"epoch": "0.1"}, "epoch = '0.1'; allowed"),
    ({"latitude_deg": "north"}, "latitude_deg = 'north'; allowed"),
    ({"heading_deg": "north"}, "heading_deg = 'north'; allowed"),
    ({"imu": {"arw_deg_sqrt_h": "small"}}, "ImuSpec.arw_deg_sqrt_h = 'small'; allowed"),
    ({"gps": {"rate_hz": "fast"}}, "GpsSpec.rate_hz = 'fast'; allowed"),
]


@pytest.mark.filterwarnings("ignore:.*not in the possible render_modes.*:UserWarning")
@pytest.mark.parametrize("env_id", [SWAY, STATIC])
@pytest.mark.parametrize(("settings", "message"), BAD, ids=lambda v: str(v) if isinstance(v, dict) else "")
def test_bad_settings_are_one_clear_error(env_id, settings, message):
    with pytest.raises(ValueError) as error:  # noqa: PT011  the message is compared below
        make(env_id, **settings)
    assert message in str(error.value)
