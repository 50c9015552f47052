"""Coarse alignment: exact where nothing disturbs, and with the spread that its error analysis predicts on the sway."""

import gymnasium
import numpy as np
import pytest

import sins_env  # noqa: F401
import solvers
from sins_env import attitude
from solvers.pipeline import coarse
from solvers.pipeline.coarse import METHODS
from solvers.pipeline.coarse_only import CoarseAligner

DVL = {"aids": {"dvl": {}}}  #: for the method that needs a velocity along the body
INERTIAL = [method for method in METHODS if not method.startswith("analytic")]
NAMES = {
    "coarse_inertial": "svd",
    "coarse_oba": "oba",
    **{f"coarse_analytic{form}": f"analytic{form}" for form in (1, 2, 3)},
}


def align_all(methods, seconds, runs, seed=5, env="SINS/AlignSway-v0", epoch=0.1, **kwargs):
    """phi (epochs, runs, 3) rad of each coarse attitude, in the same episode."""
    usual = {"start": "unknown", "coarse": seconds, "duration": seconds + epoch, "epoch": epoch, "reveal_truth": True}
    env = gymnasium.make_vec(env, num_envs=runs, **usual, **kwargs)
    obs, _ = env.reset(seed=seed)
    aligners = [CoarseAligner(method) for method in methods]
    for solver in aligners:
        solver.reset(env.unwrapped.task, None, runs)
    errors = []
    for _ in range(round(seconds / epoch)):
        found = [solver.step(obs) for solver in aligners]
        obs, _, _, _, info = env.step(found[0])
        errors.append([attitude.misalignment(q_nb, info["truth"]["q_nb"]) for q_nb in found])
    return dict(zip(methods, np.moveaxis(errors, 1, 0), strict=True))


def align(method, seconds, runs, **kwargs):
    """phi (epochs, runs, 3) rad of one coarse attitude."""
    return align_all([method], seconds, runs, **kwargs)[method]


def test_exact_on_a_still_base():
    exact = {"aids": {"dvl": {"noise_mps": 0.0, "scale_ppm": 0.0, "mounting_mrad": 0.0}}}
    still = {"env": "SINS/AlignStatic-v0", "imu": "perfect", "gps": "perfect", "n_sub": 3, "heading_deg": None, **exact}
    for method, phi in align_all(METHODS, 60.0, 2, **still).items():
        assert np.degrees(np.abs(phi[-1])).max() * 3600 < 1.0, method


def test_gps_velocity_removes_the_sway():
    phi = align_all(["aided", "svd"], 120.0, 4, imu="perfect", gps="perfect")
    assert np.degrees(np.abs(phi["aided"][-1])).max() * 3600 < 60.0  # what is left: trapezoid-free sums at 10 Hz
    assert np.degrees(np.abs(phi["svd"][-1, :, 2])).max() > 0.1


# 50 runs: a standard deviation of 0.53 deg has a standard error of 0.05 deg, one of 1.2 deg 0.12 deg.
def test_spread_after_180_seconds_of_sway():
    spreads = {"svd": (0.4, 0.7), "two_vector": (0.8, 1.4), "aided": (0.25, 0.47)}
    found = align_all(list(spreads), 180.0, 50, epoch=0.2, gps={"rate_hz": 5.0})
    for method, (low, high) in spreads.items():
        phi = np.degrees(found[method][-1])
        assert low < phi[:, 2].std(ddof=1) < high, method
        assert np.abs(phi[:, 2].mean()) < 4 * high / np.sqrt(50), method
        assert phi[:, :2].std(axis=0).max() < 0.02, method
        assert np.abs(phi[:, :2]).max() < 0.05, method


def test_level_from_the_first_seconds():
    methods = [method for method in INERTIAL if method != "motion_position"]  # ten metres tell no level so soon
    for method, phi in align_all(methods, 30.0, 8, **DVL).items():
        assert np.degrees(np.abs(phi[50:, :, :2])).max() < 1.0, method


def test_the_longitude_does_not_matter_and_a_batch_is_its_runs():
    env = gymnasium.make_vec("SINS/AlignSway-v0", num_envs=3, start="unknown", coarse=20.0, duration=30.0, **DVL)
    obs, _ = env.reset(seed=1)
    whole = [coarse.start(m, env.unwrapped.task, (3,)) for m in METHODS]
    alone = [coarse.start(m, env.unwrapped.task, ()) for m in METHODS]
    for _ in range(200):
        for many, one in zip(whole, alone, strict=True):
            many.add(obs)
            one.add({key: value[1] for key, value in obs.items()})
        obs, *_ = env.step(np.tile([1.0, 0, 0, 0], (3, 1)))
    for many, one in zip(whole, alone, strict=True):
        error = attitude.multiply(many.attitude()[1], attitude.conjugate(one.attitude()))
        assert attitude.rotation_angle(error) < 1e-9


@pytest.mark.parametrize(("svd", "davenport"), [("svd", "oba_unaided"), ("aided", "oba")])
def test_the_q_method_and_the_svd_agree_to_rounding(svd, davenport):
    """The pairs of 30 s span half a milliradian: the profile's second singular value is 1e-7 of the first."""
    ours, theirs = align_all([svd, davenport], 60.0, 4).values()
    assert np.abs(ours - theirs)[300:].max() < 1e-7
    assert np.abs(ours).max() > 1e-3


@pytest.mark.parametrize("name", NAMES)
def test_estimators_are_their_methods_and_settings_of_the_aligner(name):
    settings = {"duration": 20.0, "coarse": 10.0, "start": "unknown"}
    env = gymnasium.make_vec("SINS/AlignSway-v0", num_envs=2, **settings)
    obs, _ = env.reset(seed=2)
    both = solvers.make(name), solvers.make("ckf", coarse=NAMES[name])
    for solver in both:
        solver.reset(env.unwrapped.task, None, 2)
    for _ in range(100):
        alone, before_fine = (solver.step(obs) for solver in both)
        np.testing.assert_array_equal(alone, before_fine)
        obs, *_ = env.step(alone)
    assert np.abs(both[0].step(obs) - both[1].step(obs)).max() > 1e-9  # the filter has taken over


@pytest.mark.parametrize("method", METHODS)
def test_a_run_without_numbers_is_lost_alone(method):
    """Before the first epoch any attitude; increments that are not finite give NaN, which is a failed epoch, to one run only."""
    env = gymnasium.make_vec("SINS/AlignSway-v0", num_envs=2, start="unknown", coarse=20.0, duration=30.0, **DVL)
    obs, _ = env.reset(seed=1)
    found = []
    for broken in (False, True):
        aligner = coarse.start(method, env.unwrapped.task, (2,))
        np.testing.assert_allclose(np.linalg.norm(aligner.attitude(), axis=-1), 1.0)
        for k in range(20):
            dvel = obs["dvel"].copy()
            dvel[1, 0, 2] = np.nan if broken and k == 10 else dvel[1, 0, 2]
            aligner.add({**obs, "dvel": dvel})
        found.append(aligner.attitude())
    np.testing.assert_array_equal(found[0][0], found[1][0])
    assert np.isnan(found[1][1]).all()


@pytest.mark.parametrize("method", METHODS)
def test_no_force_is_no_error(method):
    env = gymnasium.make("SINS/AlignStatic-v0", start="unknown", coarse=20.0, duration=30.0, **DVL)
    obs, _ = env.reset(seed=1)
    aligner = coarse.start(method, env.unwrapped.task, ())
    for _ in range(5):
        aligner.add({**obs, "dvel": 0.0 * obs["dvel"]})
        np.testing.assert_allclose(np.linalg.norm(aligner.attitude()), 1.0)


def test_sparse_fixes_do_not_harm():
    """At 1 Hz only the epochs with a fix make windows: a tenth of the pairs, not stale velocities."""
    phi = align("aided", 120.0, 4, imu="perfect", gps={"preset": "perfect", "rate_hz": 1.0})
    assert np.degrees(np.abs(phi[-1])).max() * 3600 < 60.0


def test_two_vectors_without_a_coarse_phase_take_the_whole_episode():
    """The same attitude at each epoch as with a coarse phase as long as the episode, but for a told start."""
    still = {"duration": 60.0, "imu": "perfect", "gps": "perfect", "n_sub": 3}
    found = []
    for start in ({}, {"start": "unknown", "coarse": 60.0, "duration": 60.1}):
        env = gymnasium.make_vec("SINS/AlignStatic-v0", num_envs=1, **{**still, **start})
        obs, _ = env.reset(seed=1)
        solver = solvers.make("coarse_inertial", method="two_vector")
        solver.reset(env.unwrapped.task, None, 1)
        actions = []
        for _ in range(599):
            actions.append(solver.step(obs))
            obs, _, _, _, info = env.step(actions[-1])
        found.append(np.array(actions))
    assert np.degrees(np.abs(info["errors"]["phi"])).max() * 3600 < 1.0
    np.testing.assert_allclose(found[0][1:], found[1][1:], atol=1e-9)


def test_unknown_method():
    for name, settings, nearest in (
        ("coarse_inertial", {"method": "svdd"}, "svd"),
        (
            "coarse_inertial",
            {"method": "oba"},
            "allowed: aided, motion_body, motion_position, motion_velocity, svd, two_vector",
        ),
        ("ckf", {"coarse": "analytic4"}, "'analytic[123]'"),
        ("coarse_oba", {"aide": True}, "'aided'"),
        ("coarse_analytic", {}, "'coarse_analytic[123]'"),
    ):
        with pytest.raises(ValueError, match=nearest):
            solvers.make(name, **settings)
