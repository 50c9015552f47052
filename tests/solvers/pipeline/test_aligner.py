"""The aligner: the scored alignment of the house, batches, missing fixes, lever arm, closed loop, bad input."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from scipy import stats

import sins_env  # noqa: F401
import solvers
from sins_env.units import ARCSEC
from solvers.filters.sigma.ckf import CKF
from solvers.pipeline.estimator import Aligner
from solvers.types import NoiseLaw

SWAY = "SINS/AlignSway-v0"
AT_5_HZ = {"epoch": 0.2, "gps": {"rate_hz": 5.0}}  #: half the work of the usual 10 Hz


def run(solver, runs, seed=1, spoil=None, settings=None, spoil_task=lambda task: task, **kwargs):
    """phi (epochs, runs, 3) rad and the estimator after an episode; ``spoil(k, obs)`` may change observations."""
    env = gymnasium.make_vec(SWAY, num_envs=runs, **kwargs)
    obs, _ = env.reset(seed=seed)
    estimator = solvers.make(solver, **(settings or {}))
    estimator.reset(spoil_task(env.unwrapped.task), [np.random.default_rng(i) for i in range(runs)], runs)
    errors, over = [], False
    while not over:
        if spoil:
            spoil(len(errors) + 1, obs)
        obs, _, _, done, info = env.step(estimator.step(obs))
        errors.append(info["errors"]["phi"])
        over = done[0]
    return np.array(errors), estimator


def test_invariant_filter_aligns_as_well():
    """Twelve states in invariant coordinates, closed loop: level to the accelerometers, errors that its covariance explains."""
    phi, estimator = run("inekf", 16, duration=60.0)
    assert np.all(np.sqrt(np.mean(phi[-1, :, :2] ** 2, axis=0)) < 30 * ARCSEC)  # 20.9 from 100 ug, +-3.7
    P = estimator.covariance()
    assert P.shape == (16, 3, 3)
    nees = np.sum(phi[-1] * np.linalg.solve(P, phi[-1][..., None])[..., 0], axis=-1).mean() / 3
    low, high = stats.chi2.ppf([0.0005, 0.9995], 48) / 48
    assert low < nees < 1.33 * high  # 1.33 is what a prototype of this filter had at 60 s
    assert np.abs(estimator.running.filter.estimate(estimator.running.belief).mean).max() < 1e-9


@pytest.mark.parametrize("solver", ["ekf", "ckf"])
def test_closed_loop_agrees_with_open_loop(solver):
    """The same filter with and without feedback: a tenth of its sigma (2500 arcsec at 120 s) apart."""
    open_loop, _ = run(solver, 8, duration=120.0, **AT_5_HZ)
    closed, estimator = run(solver, 8, duration=120.0, settings={"feedback": "closed"}, **AT_5_HZ)
    assert np.abs(closed[-1, :, 2] - open_loop[-1, :, 2]).max() < 250 * ARCSEC
    assert np.abs(closed[-1, :, :2] - open_loop[-1, :, :2]).max() < 1 * ARCSEC
    assert np.abs(estimator.filter.estimate(estimator.running.belief).mean[:, :5]).max() < 1e-12  # the INS has it all


@pytest.mark.parametrize("kwargs", [{}, {"start": "unknown", "coarse": 5.0}, {"imu": "thesis-markov"}])
@pytest.mark.parametrize("solver", ["kf", "ekf", "ckf"])
def test_a_batch_is_its_runs(solver, kwargs):
    """Of a batch of three the first and the last run alone."""
    phi, _ = run(solver, 3, seed=4, duration=10.0, **kwargs)
    for i in (0, 2):
        env = gymnasium.make(SWAY, duration=10.0, **kwargs)
        obs, _ = env.reset(seed=4 + i)
        estimator = solvers.make(solver)
        estimator.reset(env.unwrapped.task, np.random.default_rng(i))
        for k in range(100):
            obs, _, _, _, info = env.step(estimator.step(obs))
            if "start" not in kwargs:
                np.testing.assert_allclose(info["errors"]["phi"], phi[k, i], atol=1e-9)
            elif k > 30:  # the first epochs of a coarse alignment hold no azimuth, only rounding
                np.testing.assert_allclose(info["errors"]["phi"], phi[k, i], atol=1e-6)
        assert estimator.covariance().shape == (3, 3)


def test_filterpy_adapter_agrees_with_ours():
    """An independent code on the same model: filterpy's UKF against our ukf and ckf."""
    env = gymnasium.make(SWAY, duration=20.0)
    solvers_ = [solvers.make(name) for name in ("ukf", "ckf", "filterpy_ukf")]
    obs, _ = env.reset(seed=3)
    for s in solvers_:
        s.reset(env.unwrapped.task, np.random.default_rng(0))
    for _ in range(200):
        a, b, c = (s.step(obs) for s in solvers_)
        obs, *_ = env.step(a)
        np.testing.assert_allclose(c, a, atol=1e-8)
        np.testing.assert_allclose(b, a, atol=1e-10)
    np.testing.assert_allclose(solvers_[2].covariance(), solvers_[0].covariance(), rtol=1e-5)


def test_missing_fixes_of_some_runs():
    """A run without fixes from 10 s to 20 s gets what it gets alone; the others do not notice."""

    def spoil(k, obs):
        if 100 < k <= 200:
            for key in ("gps_vel", "gps_pos", "gps_valid"):
                obs[key][1] = 0

    phi, _ = run("ckf", 3, spoil=spoil, duration=30.0)
    clean, _ = run("ckf", 3, duration=30.0)
    outage, _ = run("ckf", 3, duration=30.0, gps={"outages_s": [[10.0, 20.0]]})
    np.testing.assert_allclose(phi[:, [0, 2]], clean[:, [0, 2]], atol=1e-9)
    np.testing.assert_allclose(phi[:, 1], outage[:, 1], atol=1e-9)
    assert np.abs(phi[150, 1] - clean[150, 1]).max() > 1e-5


def test_a_lever_arm_is_taken_into_account():
    """Told of it, the filter does as well as without one; untold it must not."""
    usual = {"duration": 120.0, "epoch": 0.2, "gps": {"vel_std_mps": 0.01, "rate_hz": 5.0}}
    arm = {**usual, "gps": {**usual["gps"], "lever_arm_m": [1.0, -0.5, 2.0]}}

    def untell(task):
        return dataclasses.replace(task, gps=dataclasses.replace(task.gps, lever_arm_m=(0.0, 0.0, 0.0)))

    reference, told, untold = (
        np.sqrt(np.mean(run("ckf", 24, **settings)[0][-1] ** 2, axis=0)) / ARCSEC
        for settings in (usual, arm, {**arm, "spoil_task": untell})
    )
    assert np.all(told < 1.3 * reference)
    assert np.all(untold > 2 * told)


def test_a_lever_arm_in_the_coarse_phase_and_at_the_hand_over():
    """Errors right after the hand-over, when the first velocity decides, are what the filter says (NEES 3 expected)."""
    runs = 50
    arm = {"lever_arm_m": [5.0, 5.0, 5.0], "vel_std_mps": 0.01, "rate_hz": 5.0}
    phi, estimator = run("ckf", runs, start="unknown", coarse=98.8, duration=100.0, epoch=0.2, gps=arm)
    P = estimator.covariance()
    nees = np.sum(phi[-1] * np.linalg.solve(P, phi[-1][..., None])[..., 0], axis=-1).mean() / 3
    assert nees < stats.chi2.ppf(0.999, 3 * runs) / (3 * runs)
    aided = np.degrees(phi[492, :, 2])  # an antenna that swings tells the heading
    bare = {"vel_std_mps": 0.01, "rate_hz": 5.0}
    without, _ = run("ckf", runs, start="unknown", coarse=98.8, duration=100.0, epoch=0.2, gps=bare)
    assert aided.std() < 0.5 * np.degrees(without[492, :, 2]).std()


def test_the_ins_starts_with_the_velocity_of_the_imu_not_of_the_antenna():
    gps = {"lever_arm_m": [5.0, 5.0, 5.0], "vel_std_mps": 0.01}
    env = gymnasium.make_vec(SWAY, num_envs=4, start="unknown", coarse=61.0, duration=62.0, gps=gps, reveal_truth=True)
    obs, _ = env.reset(seed=2)
    estimator = solvers.make("ckf")
    estimator.reset(env.unwrapped.task, None, 4)
    for _ in range(610):
        obs, _, _, _, info = env.step(estimator.step(obs))
    apart = estimator.running.ins.nav.vel - info["truth"]["vel"]
    assert np.abs(apart).max() < 0.1  # five metres from the centre the antenna moves at up to 1.5 m/s


@pytest.mark.parametrize(
    ("gps", "law"),
    [
        ({}, None),
        ({"contamination": 0.2, "contamination_factor": 10.0}, NoiseLaw(0.2, 10.0, 0.0)),
        ({"heavy_tail_dof": 3.0}, NoiseLaw(0.0, 10.0, 3.0)),
    ],
)
def test_the_filter_is_told_how_the_fixes_err(gps, law):
    seen = []

    class Listener(CKF):
        def correct(self, b, me):
            seen.append(me.law)
            return super().correct(b, me)

    env = gymnasium.make("SINS/AlignSway-v0", duration=0.5, gps={"lever_arm_m": [1.0, 0.0, 0.0], **gps})
    obs, _ = env.reset(seed=0)
    aligner = Aligner(Listener())
    aligner.reset(env.unwrapped.task, None)
    aligner.step(obs)
    assert seen == [law]


def test_the_filter_says_whether_the_loop_is_closed():
    assert (
        solvers.make("kf").aligner.settings.feedback
        == solvers.make("filterpy_kf").aligner.settings.feedback
        == "closed"
    )
    assert solvers.make("ckf").aligner.settings.feedback == "open"
    assert solvers.make("kf", feedback="open").aligner.settings.feedback == "open"


def test_a_run_with_a_broken_sensor_fails_alone():
    def spoil(k, obs):
        if k == 50:
            obs["dvel"][2, 3] = np.nan

    phi, estimator = run("ckf", 4, spoil=spoil, duration=20.0)
    clean, _ = run("ckf", 4, duration=20.0)
    np.testing.assert_array_equal(phi[:, [0, 1, 3]], clean[:, [0, 1, 3]])
    assert estimator.health().failed_at.tolist() == [-1, -1, 50, -1]


def test_vertical_velocity_of_the_ins_stays_with_the_fixes():
    _, estimator = run("ckf", 4, duration=120.0, misalignment_deg=(3.0, -3.0, 20.0))
    assert np.abs(estimator.running.ins.nav.vel[:, 2]).max() < 0.2


@pytest.mark.parametrize(
    ("name", "settings", "near"),
    [
        ("ckff", {}, "ckf"),
        ("ckf", {"feedbck": "open"}, "feedback"),
        ("ckf", {"feedback": "opened"}, "open"),
        ("ckf", {"coarse": "sdv"}, "svd"),
        ("coarse_inertial", {"methd": "svd"}, "method"),
        ("ukf", {"alfa": 1.0}, "alpha"),
    ],
)
def test_wrong_names_offer_the_nearest(name, settings, near):
    with pytest.raises(ValueError, match=near):
        solvers.make(name, **settings)


@pytest.mark.parametrize("solver", ["ckf", "inekf", "gsf_imm"])
def test_a_fix_without_one_component_still_counts(solver):
    """Without the east velocity a filter levels on the other one, and the other runs are as they were."""
    missing = lambda k, obs: obs["gps_vel"].__setitem__((slice(None, 2), 0), np.nan)  # noqa: E731
    whole, _ = run(solver, 4, duration=20.0, **AT_5_HZ)
    partly, estimator = run(solver, 4, spoil=missing, duration=20.0, **AT_5_HZ)
    assert (estimator.health().failed_at == -1).all()
    np.testing.assert_allclose(partly[:, 2:], whole[:, 2:], atol=1e-9)
    assert np.abs(partly[-1, :2, :2]).max() < 0.05  # told: 1 deg (1 sigma), 0.017
    assert (partly[-1, :2] != whole[-1, :2]).all()
