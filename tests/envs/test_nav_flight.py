import json

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.testing import assert_allclose, assert_array_equal
from oracles.courses import actions_of, leaves, play, truths

import solvers
from sins_env import attitude, earth
from sins_env.units import DEG_PER_H, UG
from sins_env.worlds.profiles import PROFILES

FLIGHT = "SINS/NavFlight-v0"
OWN = {"latitude_deg": 50.0, "longitude_deg": 8.0, "speed_mps": 60.0, "segments": [["cruise", 2], ["turn", 3, 4.0]]}
WGS84 = earth.EARTHS["wgs84"]


def make(**settings):
    return gymnasium.make(FLIGHT, **{"duration": 2.5, **settings}).unwrapped


def vector(rows, **settings):
    return gymnasium.make_vec(FLIGHT, rows, **{"duration": 2.5, **settings})


def flights(rows, steps, seed=0):
    """Actions within the space."""
    rng = np.random.default_rng(seed)
    pos = rng.normal([0.6, 1.9, 400.0], [1e-4, 1e-4, 50.0], (steps, rows, 3))
    return np.concatenate([actions_of(rows, steps, seed), rng.normal(0, 20, (steps, rows, 3)), pos], axis=-1)


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized.*")  # of Box(10) alone
@pytest.mark.parametrize(
    "settings",
    [
        *({"profile": name} for name in PROFILES),
        {"profile": OWN, "n_sub": 10, "reveal_truth": True},
        {"start": "unknown", "coarse": 1.0},
        {"render_mode": "rgb_array", "gps": {"rate_hz": 10.0, "velocity": False}},
    ],
    ids=str,
)
def test_check_env(settings):
    check_env(make(**settings))


@pytest.mark.parametrize("name", PROFILES)
def test_defaults(name):
    env = gymnasium.make(FLIGHT, profile=name).unwrapped
    task, profile = env.task, PROFILES[name]
    assert (task.navigate, task.n_sub, task.epoch_s) == (True, 1, 0.1)
    assert task.duration_s == profile.plan.duration_s
    assert env.action_space.shape == (10,)
    json.dumps(env.spec.kwargs)
    P = np.sqrt(np.diag(task.prior.P0))
    assert_allclose(np.degrees(P[:3]), profile.attitude_std_deg)
    assert_allclose(P[3:9], [profile.velocity_std_mps] * 3 + [profile.position_std_m] * 3)
    assert_allclose(P[9:12] / DEG_PER_H, profile.imu.gyro_bias_deg_h)
    assert_allclose(P[12:] / UG, profile.imu.accel_bias_ug)


#: docs/mathematics/simulation.md#flight-profiles: the sensors, P0 and R of each, in deg, m/s, m, deg/h, ug,
#: deg/sqrt(h), ug/sqrt(Hz)
TOLD = {
    "sun2012": ((3, 3, 10), 0.1, 10, 1, 1000, 0.1, 100, (10, 10, 10), 1),
    "sun2012-fixed": ((3, 3, 10), 0.1, 10, 1, 1000, 0.1, 100, (10, 10, 10), 1),
    "sun2012-physical": ((3, 3, 10), 0.1, 10, 1, 1000, 0.1, 100, (10, 10, 10), 1),
    "lu-gauss": ((1, 1, 1), 0.5, 10, 0.1, 100, 0.01, 50, (10, 10, 3), 10),
    "lu-mixture": ((1, 1, 1), 0.5, 10, 0.1, 100, 0.01, 50, (10, 10, 3), 10),
    "zhao2010": ((2, 2, 2), 0.5, 10, 0.1, 10000, 0.05 / 600, 1000, (10, 10, 10), 1),
    "hotstart30": ((5, 5, 30), 0.1, 10, 1, 1000, 0.1, 100, (10, 10, 10), 1),
    "hotstart60": ((10, 10, 60), 0.1, 10, 1, 1000, 0.1, 100, (10, 10, 10), 1),
    "hotstart90": ((20, 20, 90), 0.1, 10, 1, 1000, 0.1, 100, (10, 10, 10), 1),
    "car": ((0.5, 0.5, 1), 0.1, 3, 1, 1000, 0.1, 100, (3, 3, 3), 1),
    "ship": ((0.5, 0.5, 1), 0.1, 3, 1, 1000, 0.1, 100, (3, 3, 3), 1),
}


@pytest.mark.parametrize("name", TOLD)
def test_what_is_told_is_the_table_of_the_specification(name):
    task = make(profile=name).task
    p, g = task.prior, task.gps
    found = (p.attitude_std_deg, p.velocity_std_mps, p.position_std_m, p.gyro_bias_std_deg_h, p.accel_bias_std_ug)
    found += (p.arw_deg_sqrt_h, p.vrw_ug_sqrt_hz, p.gps_pos_std_m, g.rate_hz)
    for mine, wanted in zip(found, TOLD[name], strict=True):
        assert_allclose(mine, wanted, rtol=1e-12)
    assert_allclose(p.gps_vel_std_mps, 0.1)
    assert g.contamination == (0.2 if name == "lu-mixture" else 0.0)


def start_errors(settings, runs=400):
    """Of the told start: phi deg, velocity m/s, position m."""
    env = vector(runs, reveal_truth=True, **settings)
    _, info = env.reset(seed=0)
    start, truth = info["start"], info["truth"]
    phi = attitude.misalignment(start["q_nb"], truth["q_nb"])
    return env, (np.degrees(phi), start["vel"] - truth["vel"], earth.offset(WGS84, truth["pos"], start["pos"]))


def assert_drawn(values, sigma):
    """Normal with that 1 sigma: standard deviation and mean within four standard errors."""
    n = len(values)
    assert_allclose(values.std(axis=0) / sigma, 1.0, atol=4 / np.sqrt(2 * n))
    assert_allclose(values.mean(axis=0) / sigma, 0.0, atol=4 / np.sqrt(n))


@pytest.mark.parametrize("name", [*PROFILES, "own"])
def test_the_site_of_a_told_start_is_a_region(name):
    """Who takes it for the place of the start is off by more than the told start is; within 0.01 deg and 100 m."""
    env = make(profile=OWN if name == "own" else name, reveal_truth=True)
    _, info = env.reset(seed=0)
    off = np.abs(earth.offset(WGS84, info["truth"]["pos"], env.task.site.pos))
    assert np.all(off > [300.0, 500.0, 25.0])
    assert np.all(off < [600.0, 600.0, 60.0])
    unknown = make(profile="sun2012", start="unknown", coarse=1.0)
    assert_array_equal(unknown.task.site.pos, PROFILES["sun2012"].plan.site.pos)


@pytest.mark.parametrize("name", ["sun2012", "lu-gauss", "hotstart30"])
def test_start_and_biases_are_drawn_from_the_told_prior(name):
    env, (phi, vel, pos) = start_errors({"profile": name})
    prior, imu = env.unwrapped.task.prior, env.unwrapped.episode.world.imu
    assert_drawn(phi, prior.attitude_std_deg)
    assert_drawn(vel, prior.velocity_std_mps)
    assert_drawn(pos, prior.position_std_m)
    assert_drawn(imu.gyro.bias / DEG_PER_H, prior.gyro_bias_std_deg_h)
    assert_drawn(imu.accel.bias / UG, prior.accel_bias_std_ug)


@pytest.mark.parametrize(("name", "mean"), [("sun2012-fixed", (0, 0)), ("zhao2010", (0.01, 1000))])
def test_fixed_errors_are_plus_one_sigma_in_every_run(name, mean):
    env, (phi, vel, pos) = start_errors({"profile": name})
    prior, imu = env.unwrapped.task.prior, env.unwrapped.episode.world.imu
    assert_allclose(phi, np.tile(prior.attitude_std_deg, (400, 1)), rtol=1e-9)
    assert_allclose(imu.gyro.bias / DEG_PER_H, prior.gyro_bias_std_deg_h + mean[0])
    assert_allclose(imu.accel.bias / UG, prior.accel_bias_std_ug + mean[1])
    assert_drawn(vel, prior.velocity_std_mps)
    assert_drawn(pos, prior.position_std_m)


def test_errors_can_be_fixed_or_drawn_on_any_profile():
    _, (phi, _, _) = start_errors({"profile": "sun2012", "errors": "fixed", "attitude_std_deg": [1, 2, 3]}, 3)
    assert_allclose(phi, [[1, 2, 3]] * 3, rtol=1e-9)
    _, (phi, _, _) = start_errors({"profile": "zhao2010", "errors": "drawn"}, 3)
    assert np.ptp(phi[:, 0]) > 0.1
    _, (phi, vel, pos) = start_errors(
        {"misalignment_deg": (-1, 0, 20), "velocity_std_mps": 1e-9, "position_std_m": 1e-9}
    )
    assert_allclose(phi, [[-1, 0, 20]] * 400, atol=1e-9)
    assert np.abs(vel).max() < 1e-7
    assert np.abs(pos).max() < 1e-6


VARIANTS = {
    "sun2012": {},
    "mixture": {"profile": "lu-mixture", "n_sub": 5},
    "zhao2010": {"profile": "zhao2010", "imu": None},
    "mems": {"profile": "hotstart90", "imu": "mems", "gps": {"lever_arm_m": [1, 2, 3], "heavy_tail_dof": 3.0}},
    "unknown": {"start": "unknown", "coarse": 1.0, "gps": {"rate_hz": 10.0, "jump_mps": 1.0, "jump_s": 1.0}},
    "own": {"profile": OWN, "gps": {"outages_s": [[0.5, 1.5]], "rate_hz": 5.0}, "imu": {"gyro_markov_deg_h": 3.0}},
}


@pytest.mark.parametrize("variant", VARIANTS)
def test_a_row_equals_the_single_environment_bit_for_bit(variant):
    settings = {**VARIANTS[variant], "reveal_truth": True, "duration": 4.0}
    steps = flights(9, 40)
    course = play(vector(9, **settings), steps, seed=5)
    for row in (0, 4, 8):
        for (obs, reward, over, info), (obs1, reward1, over1, info1) in zip(
            course, play(make(**settings), steps[:, row], seed=5 + row), strict=True
        ):
            for key in obs1:
                assert_array_equal(obs[key][row], obs1[key], err_msg=key)
            if reward1 is not None:
                assert (reward[row], over[row]) == (reward1, over1)
            found, wanted = dict(leaves(info)), dict(leaves(info1))
            assert found.keys() == wanted.keys()
            for path, value in wanted.items():
                assert_array_equal(found[path][row], value, err_msg=str(path))


def test_observations_are_in_their_space_and_fresh():
    env = vector(3, profile="lu-mixture", gps={"heavy_tail_dof": 1.0, "contamination": 0.0, "pos_std_m": 1e6})
    for obs, *_ in play(env, flights(3, 25), seed=0):
        assert env.observation_space.contains(obs)
        assert all(array.flags.owndata and array.flags.writeable for array in obs.values())


def test_the_truth_scores_full_marks_in_flight():
    settings = {"profile": "lu-gauss", "reveal_truth": True}
    _, *states = truths(make(**settings), flights(1, 1)[0, 0], 25, seed=1)
    env = make(**settings)
    env.reset(seed=1)
    for truth in states:
        _, reward, _, _, info = env.step(np.concatenate([truth[part] for part in ("q_nb", "vel", "pos")]))
        assert reward > -1e-6
        assert_array_equal(info["truth"]["vel"], truth["vel"])
        assert all(np.abs(part).max() < 1e-7 for part in info["errors"].values())


def test_the_sensors_leave_start_and_fixes_as_they_were():
    for imu in ("mems", {"gyro_lsb_arcsec": 1.0}):
        plain, other = (play(make(imu=i), flights(1, 25)[:, 0], seed=7) for i in (None, imu))
        assert any(np.any(a[0]["dtheta"] != b[0]["dtheta"]) for a, b in zip(plain, other, strict=True))
        for (obs, *_), (obs1, *_) in zip(plain, other, strict=True):
            assert_array_equal(obs["gps_pos"], obs1["gps_pos"])
            assert_array_equal(obs["gps_vel"], obs1["gps_vel"])
        assert_array_equal(plain[0][3]["start"]["pos"], other[0][3]["start"]["pos"])


def gps_errors(duration=30.0, runs=200, **settings):
    """Errors of the fixes against the truth, (runs, epochs, 6) m/s and m; NaN where there is none."""
    env = vector(runs, profile="lu-gauss", duration=duration, reveal_truth=True, **settings)
    obs, _ = env.reset(seed=0)
    action = np.tile([1.0, *[0.0] * 9], (runs, 1))
    out = []
    for _ in range(round(duration / 0.1)):
        (fix, (obs, *_, info)) = obs, env.step(action)
        vel, pos = info["truth"]["vel"], info["truth"]["pos"]
        error = np.concatenate([fix["gps_vel"] - vel, earth.offset(WGS84, pos, fix["gps_pos"])], axis=1)
        out.append(np.where(fix["gps_valid"] == 1, error, np.nan))
    return np.stack(out, axis=1)


def test_fixes_are_at_the_rate_and_sigma_of_the_profile():
    errors = gps_errors(10.0)
    assert np.isfinite(errors).all()
    assert_allclose(errors.std(axis=(0, 1)) / [0.1, 0.1, 0.1, 10, 10, 3], 1.0, atol=4 / np.sqrt(2 * 200 * 100))
    valid = [obs["gps_valid"][0] for obs, *_ in play(make(profile="sun2012"), flights(1, 25)[:, 0], seed=0)]
    assert np.flatnonzero(valid).tolist() == [9, 19]


def test_contamination_is_of_whole_fixes():
    errors = gps_errors(10.0, gps={"contamination": 0.2}) / [0.1, 0.1, 0.1, 10, 10, 3]
    variance = 0.8 + 0.2 * 10
    fourth = 3 * (0.8 + 0.2 * 100)
    n = errors[..., 0].size
    assert_allclose(np.mean(errors**2, axis=(0, 1)), variance, atol=4 * np.sqrt((fourth - variance**2) / n))
    cross = np.mean(errors[..., 0] ** 2 * errors[..., 5] ** 2)  # one factor for velocity and position
    assert cross == pytest.approx(0.8 + 0.2 * 100, rel=0.1)
    assert cross > 2 * variance**2


def test_outages_and_jumps():
    errors = gps_errors(6.0, 20, gps={"outages_s": [[1.0, 3.0]], "jump_mps": 5.0, "jump_s": [4.0, 5.0]})
    missing = np.isnan(errors[0, :, 0])
    assert np.flatnonzero(missing).tolist() == list(range(10, 30))
    speed = np.linalg.norm(errors[..., :3], axis=-1)
    inside = np.zeros(60, dtype=bool)
    inside[40:50] = True
    assert (speed[:, inside] > 4).all()
    assert (speed[:, ~inside & ~missing] < 1).all()
    assert make(gps={"outages_s": [[1.0, 3.0]], "jump_mps": 5.0}).task.gps.outages_s == ()


@pytest.mark.parametrize("n_sub", [1, 10])
def test_the_noise_of_zhao_swells_and_fades(n_sub):
    """Per 100 Hz sample 0.05 cos(0.1 t) deg/h and 10 sin(0.1 t) mg; here as the noise of increments of 0.1 s."""
    runs, seconds = 300, 40
    noisy, still = (
        vector(runs, profile="zhao2010", duration=float(seconds), n_sub=n_sub, imu=imu) for imu in (None, "perfect")
    )
    action = np.tile([1.0, *[0.0] * 9], (runs, 1))
    parts = []
    (a, _), (b, _) = noisy.reset(seed=0), still.reset(seed=0)
    for _ in range(seconds * 10):
        parts.append([(a[key] - b[key]).sum(axis=1) for key in ("dtheta", "dvel")])
        a, b = noisy.step(action)[0], still.step(action)[0]
    gyro, accel = np.moveaxis(np.array(parts), 1, 0)  # (epochs, runs, 3)
    t = (np.arange(seconds * 10) + 0.5) * 0.1
    per_epoch = 0.01 * np.sqrt(10)  # ten samples of 0.01 s
    for found, mean, amplitude in (
        (gyro, 0.11 * DEG_PER_H, 0.05 * DEG_PER_H * np.cos(0.1 * t)),
        (accel, 11e3 * UG, 10e3 * UG * np.sin(0.1 * t)),
    ):
        sigma = per_epoch * np.abs(amplitude)
        assert_allclose(
            found.mean(axis=(1, 2)), mean * 0.1, atol=5 * per_epoch * np.abs(amplitude).max() / np.sqrt(900)
        )
        large = sigma > 0.2 * sigma.max()
        ratio = found.std(axis=(1, 2))[large] / sigma[large]
        assert_allclose(ratio, 1.0, atol=5 / np.sqrt(2 * 900))
        assert (found.std(axis=(1, 2)) < 1.2 * sigma + 0.05 * sigma.max()).all()


@pytest.mark.parametrize("settings", [{"profile": "lu-gauss"}, {"coarse": 0.0}])
def test_an_unknown_start_in_motion_or_without_a_coarse_phase_tells_a_level_at_any_heading(settings):
    env = gymnasium.make(FLIGHT, start="unknown", **settings).unwrapped
    _, info = env.reset(seed=0)
    assert info["start"]["known"] is False
    assert env.task.start is None
    assert env.task.coarse_s == 0.0
    assert_allclose(env.task.prior.attitude_std_deg, [3.0, 3.0, 180.0 / np.sqrt(3.0)])


def test_an_unknown_start_stands_still_and_is_told_what_coarse_alignment_leaves():
    env = gymnasium.make(FLIGHT, start="unknown").unwrapped
    _, info = env.reset(seed=0)
    assert info["start"]["known"] is False
    assert env.task.start is None
    assert env.task.coarse_s == 100.0
    # 1000 ug; 1 deg/h and 0.1 deg/sqrt(h) over 100 s against 15.04 deg/h cos(34.2 deg); 0.1, 0.1, 2 deg besides
    level = np.degrees(1e-3 * 9.80665 / 9.796)
    gyros = np.degrees(np.hypot(1.0, 0.1 / np.sqrt(100 / 3600)) / (15.041 * np.cos(np.radians(34.2))))
    # a line fitted to 100 s of a gravity that swings by 15.04 deg/h cos(34.2 deg), in noise of 100 ug/sqrt(Hz)
    t = np.arange(0.05, 100, 0.1)
    slope = 100e-6 / np.sqrt(0.1) / np.sqrt(np.sum((t - 50) ** 2)) / (7.292115e-5 * np.cos(np.radians(34.2)))
    parts = [gyros, np.degrees(slope), level * np.tan(np.radians(34.2))]
    expected = np.hypot([0.1, 0.1, 2.0], [level, level, np.linalg.norm(parts)])
    assert_allclose(env.task.prior.attitude_std_deg, expected, rtol=1e-3)


@pytest.mark.parametrize(("profile", "share"), [("sun2012", 1.0), ("zhao2010", 0.7)])
def test_what_is_told_after_coarse_alignment_is_what_comes_out(profile, share):
    """The heading of 200 runs; in the flight of Zhao the noise is at its told size for moments only, its mean square half of it."""
    env = vector(200, profile=profile, start="unknown", coarse=50.0, duration=51.0)
    obs, _ = env.reset(seed=0)
    task = env.unwrapped.task
    solver = solvers.make("ekf")
    solver.reset(task, list(np.random.default_rng(0).spawn(200)), 200)
    for _ in range(500):
        obs, _, _, _, info = env.step(solver.step(obs))
    rms = np.degrees(np.sqrt(np.mean(info["errors"]["phi"] ** 2, axis=0))) / task.prior.attitude_std_deg
    assert rms[2] == pytest.approx(share, rel=0.2)  # four standard errors, and the general allowance
    assert (rms[:2] < 1.1).all()


BAD = [
    ({"profile": "sun2013"}, "unknown profile 'sun2013'; did you mean 'sun2012'?"),
    ({"profile": 3}, "unknown profile 3; allowed: a YAML or JSON file, a dict of a flight, a table of a track, "),
    ({"profile": {"latitude_deg": 1.0}}, "the flight has no longitude_deg"),
    ({"profile": {**OWN, "segments": [["clmb", 3, 1]]}}, "did you mean 'climb'"),
    ({"duration": 901.0}, "duration = 901.0; allowed: at most 900 s, the length of the flight"),
    ({"duration": 2.55}, "duration = 2.55 s with epochs of 0.1 s; allowed: a whole number of epochs"),
    ({"epoch": 0.3, "duration": 3.0}, "segment 1 (cruise, 0 to 100 s) ends at 100 s, between IMU samples of 0.3 s"),
    (
        {"start": "unknown", "coarse": 201.0, "duration": 200.0},
        "coarse = 201 s, duration = 200 s; allowed: coarse shorter",
    ),
    ({"start": "unknown", "coarse": 1.0, "misalignment_deg": (1, 1, 1)}, "misalignment_deg with start = 'unknown'"),
    ({"errors": "random"}, "unknown errors 'random'"),
    ({"attitude_std_deg": [1, 2]}, "attitude_std_deg = [1, 2]; allowed: three positive numbers"),
    ({"velocity_std_mps": 0.0}, "velocity_std_mps = 0.0; allowed: a positive number or None"),
    ({"position_std_m": "10"}, "position_std_m = '10'; allowed: a positive number or None"),
    ({"imu": "tacticel"}, "unknown IMU preset 'tacticel'; did you mean 'tactical'?"),
    ({"imu": {"arw": 1.0}}, "unknown setting of ImuSpec 'arw'"),
    ({"gps": {"rate_hz": 3.0}}, "GPS rate 3 Hz with epochs of 0.1 s"),
    ({"profil": "sun2012"}, "unknown setting of SINS/NavFlight-v0 'profil'; did you mean 'profile'?"),
    ({"n_sub": 0}, "n_sub = 0; allowed: a whole number of IMU samples per epoch"),
]


def test_a_reset_has_no_options():
    with pytest.raises(ValueError, match=r"reset options = \{'window': 1\}; allowed: none in this environment"):
        make().reset(seed=0, options={"window": 1})


@pytest.mark.parametrize(("settings", "message"), BAD, ids=[str(b[0])[:50] for b in BAD])
def test_bad_settings_are_one_clear_error(settings, message):
    with pytest.raises(ValueError) as error:  # noqa: PT011  the message is compared below
        make(**settings)
    assert message in str(error.value)
    assert "\n" not in str(error.value)
