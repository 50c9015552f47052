import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.testing import assert_allclose, assert_array_equal
from oracles import recorded as files

import sins_env  # noqa: F401  registers the ids
from sins_env import attitude
from sins_env.recordings import load
from sins_env.specs import IMU_PRESETS

REPLAY = "SINS/Replay-v0"
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


@pytest.fixture
def parked(tmp_path):
    """10 s at 100 Hz without GNSS; the reference begins at 0.1 s."""
    return files.counts(tmp_path / "parked.npz")


@pytest.fixture
def driven(tmp_path):
    """12 s at 200 Hz with fixes at 0.95 s + n."""
    return files.increments(tmp_path / "driven.npz")


def make(recording, **settings):
    return gymnasium.make(REPLAY, recording=recording, **{"coarse": 0.0, **settings}).unwrapped


def vector(recording, num_envs, **settings):
    return gymnasium.make_vec(REPLAY, num_envs, recording=recording, **{"coarse": 0.0, **settings})


def play(env, action=IDENTITY, **reset):
    """Every observation, reward and info of an episode."""
    obs, info = env.reset(**reset)
    observations, rewards, infos = [obs], [], [info]
    over = False
    while not over:
        obs, reward, terminated, over, info = env.step(action)
        assert not np.any(terminated)
        observations.append(obs)
        rewards.append(reward)
        infos.append(info)
        over = bool(np.all(over))
    return observations, rewards, infos


def stacked(observations, key):
    return np.stack([o[key] for o in observations])


def test_all_of_a_recording_is_delivered_once(parked):
    env = make(parked)
    observations, _, _ = play(env, seed=0)
    recording = load(parked)
    assert len(observations) == 101
    assert_array_equal(stacked(observations[:-1], "dtheta").reshape(-1, 3), recording.dtheta)
    assert_array_equal(stacked(observations[:-1], "dvel").reshape(-1, 3), recording.dvel)
    assert_allclose(stacked(observations, "t")[:, 0], [*(0.1 * np.arange(1, 101)), 10.0])
    last = observations[-1]
    assert not last["dtheta"].any()
    assert last["gps_valid"] == 0


def test_windows_and_strides(parked):
    recording = load(parked)
    env = make(parked, window=(1.0, 4.0), stride=1.5)
    assert_allclose(env.episode.world.windows.starts, [1.0, 2.5, 4.0, 5.5])  # the last ends at 9.5 s
    for i, first in enumerate((100, 250, 400, 550)):
        observations, _, _ = play(env, seed=0, options={"window": i})
        assert_array_equal(
            stacked(observations[:-1], "dtheta").reshape(-1, 3), recording.dtheta[first : first + 400]
        )
        assert observations[0]["t"] == pytest.approx(0.1)  # a window's own time begins at 0
    assert make(parked, window=(1.0, 9.0), stride=0.1).episode.world.windows.starts == [1.0]
    assert_allclose(
        make(parked, window=(0.018, 1.0)).episode.world.windows.starts, [0.02]
    )  # the nearest edge


def test_the_seed_draws_the_window(parked):
    env = make(parked, window=(0.0, 1.0), stride=1.0)
    first = [env.reset(seed=seed)[0]["dtheta"][0, 0] for seed in range(40)]
    assert_array_equal(first, [env.reset(seed=seed)[0]["dtheta"][0, 0] for seed in range(40)])
    assert 7 <= len(set(first)) <= 10
    assert len({env.reset()[0]["dtheta"][0, 0] for _ in range(30)}) > 5  # and draws on


@pytest.mark.parametrize("rows", [1, 2, 7])
@pytest.mark.parametrize(
    "settings", [{}, {"start": "told", "window": (0.2, 1.0), "reveal_truth": True}], ids=str
)
def test_rows_equal_single_runs(driven, rows, settings):
    settings = {"window": (0.1, 1.0), "stride": 0.35, "epoch": 0.05, **settings}
    many, one = vector(driven, rows, **settings), make(driven, **settings)
    actions = np.random.default_rng(0).standard_normal((rows, 4))
    batch = play(many, actions, seed=11)
    for row in range(rows):
        observations, rewards, infos = play(one, actions[row], seed=11 + row)
        for key in observations[0]:
            assert_array_equal(stacked(batch[0], key)[:, row], stacked(observations, key))
        assert_array_equal(np.stack(batch[1])[:, row], rewards)
        assert_array_equal(
            [i["errors"]["phi"][row] for i in batch[2][1:]], [i["errors"]["phi"] for i in infos[1:]]
        )
        for key in ("q_nb", "vel", "pos", "known"):
            assert_array_equal(batch[2][0]["start"][key][row], infos[0]["start"][key])


def test_window_options_of_a_batch(parked):
    env = vector(parked, 3, window=(0.0, 1.0), stride=1.0)
    single = make(parked, window=(0.0, 1.0), stride=1.0)

    def window(i):
        return single.reset(options={"window": i})[0]["dtheta"]

    for given, expected in ((4, (4, 5, 6)), ([8, 0, 3], (8, 0, 3)), (np.array([1, 1, 1]), (1, 1, 1))):
        found = env.reset(seed=0, options={"window": given})[0]["dtheta"]
        assert_array_equal(found, [window(i) for i in expected])


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (10, "window 10 does not exist; allowed: 0 to 9"),
        (-1, "window -1 does not exist"),
        (8, "window 10 does not exist"),  # rows 8, 9, 10
        ([0, 1, 12], "window 12 does not exist"),
        ([0, 1], "one whole number, or a list of 3"),
        (1.5, "one whole number"),
        ("first", "one whole number"),
    ],
)
def test_bad_window_options(parked, given, message):
    with pytest.raises(ValueError, match=message):
        vector(parked, 3, window=(0.0, 1.0), stride=1.0).reset(options={"window": given})


def test_unknown_reset_option(parked):
    with pytest.raises(ValueError, match="unknown reset option 'windw'; did you mean 'window'"):
        make(parked).reset(options={"windw": 0})


def test_zero_velocity_updates(parked):
    env = make(parked)
    observations, _, _ = play(env, seed=0)
    task = env.task
    assert stacked(observations[:-1], "gps_valid").all()
    assert not stacked(observations, "gps_vel").any()
    assert_array_equal(stacked(observations[:-1], "gps_pos"), np.broadcast_to(task.site.pos, (100, 3)))
    assert (task.gps.vel_std_mps, task.gps.rate_hz, task.gps.lever_arm_m) == (0.03, 10.0, (0.0, 0.0, 0.0))
    assert_allclose(np.diag(task.prior.R)[:3], 0.03**2)
    assert task.site == load(parked).site
    assert task.imu == IMU_PRESETS["rlg-car"]


def test_told_fixes(parked, driven):
    assert make(parked, gps={"vel_std_mps": 0.01}).task.gps.vel_std_mps == 0.01
    assert make(parked, gps="dgps").task.gps.rate_hz == 10.0
    thinned = make(parked, gps={"rate_hz": 2.0})
    valid = stacked(play(thinned, seed=0)[0][:-1], "gps_valid")[:, 0]
    assert_array_equal(np.flatnonzero(valid), np.arange(4, 100, 5))
    told = make(driven, epoch=0.05).task.gps
    assert told.rate_hz == pytest.approx(1.0)
    assert_allclose(told.lever_arm_m, [-0.528, -0.985, 2.021])
    named = make(driven, epoch=0.05, gps="thesis").task.gps
    assert (named.vel_std_mps, named.rate_hz) == (0.1, told.rate_hz)
    assert named.lever_arm_m == told.lever_arm_m


@pytest.mark.parametrize("settings", [{"epoch": 0.05}, {"epoch": 0.1, "window": (0.05, 10.0)}], ids=str)
def test_fixes_of_a_receiver(driven, settings):
    observations, _, _ = play(make(driven, **settings), seed=0)
    gnss = load(driven).gnss
    start = settings.get("window", (0.0,))[0]
    valid = stacked(observations, "gps_valid")[:, 0] == 1
    t = stacked(observations, "t")[valid, 0] + start
    covered = gnss.t_s <= start + observations[-1]["t"][0] + 1e-9
    assert_allclose(t, gnss.t_s[covered], atol=1e-9)
    assert_array_equal(stacked(observations, "gps_vel")[valid], gnss.vel[covered])
    assert_array_equal(stacked(observations, "gps_pos")[valid], gnss.pos[covered])
    assert not stacked(observations, "gps_pos")[~valid].any()


def test_fixes_between_epochs_are_refused_with_what_fits(driven):
    fits = r"begins at 0\.05 s modulo 0\.1 s or epochs of 0\.05 s"
    with pytest.raises(ValueError, match=rf"fix at 0\.95 s is 0\.05 s off .* {fits}"):
        make(driven)
    with pytest.raises(ValueError, match=r"begins at 0\.05 s modulo 0\.1 s"):
        make(driven, window=(0.02, 10.0))


@pytest.mark.parametrize(("shift", "fits"), [(0.0024, True), (0.0026, False)])
def test_half_a_sample_is_the_limit(tmp_path, shift, fits):
    t = np.arange(0.95, 11.9, 1.0)[:11]
    llh, vel = np.full((11, 3), 34.0), np.ones((11, 3))
    path = files.increments(
        tmp_path / "x.npz", gnss_t_imu_s=t + shift, gnss_llh_deg_m=llh, gnss_vel_enu_mps=vel
    )
    if fits:
        observations, _, _ = play(make(path, epoch=0.05), seed=0)
        assert stacked(observations, "gps_valid").sum() == 11
    else:
        with pytest.raises(ValueError, match=r"is 0\.0024 s off|is 0\.0026 s off"):
            make(path, epoch=0.05)


def test_truth_is_the_reference(driven):
    ref = load(driven).reference
    _, rewards, infos = play(make(driven, epoch=0.05, reveal_truth=True), seed=0)
    truth = [i["truth"] for i in infos]
    n = len(rewards)
    assert_array_equal([t["q_nb"] for t in truth[1:]], ref.q_nb[:n])  # at stamps: exactly
    assert_allclose([t["vel"] for t in truth[1:]], ref.vel[:n], rtol=1e-15)
    for k in (1, 50, n):
        phi = attitude.misalignment(IDENTITY, ref.q_nb[k - 1])
        assert_allclose(infos[k]["errors"]["phi"], phi, atol=1e-14)
        angle = np.degrees(files.attitudes(ref.t_s[k - 1 : k]).magnitude()[0])
        assert rewards[k - 1] == pytest.approx(-angle, rel=1e-12)


def test_truth_between_stamps_is_interpolated(driven):
    env = make(driven, epoch=0.01, window=(0.05, 2.0), reveal_truth=True)
    _, _, infos = play(env, seed=0)
    t = 0.05 + 0.01 * np.arange(len(infos))
    exact = files.attitudes(t).as_quat(scalar_first=True)
    found = np.array([i["truth"]["q_nb"] for i in infos])
    angle = attitude.rotation_angle(attitude.multiply(attitude.conjugate(exact), found))
    assert angle.max() < 1e-4  # h^2/8 of an acceleration of 0.2 rad/s^2
    assert angle[5::5].max() < 1e-14
    assert_allclose([i["truth"]["vel"][0] for i in infos], t, atol=1e-12)


def test_a_parked_reference_stands_still_at_its_site(parked):
    env = make(parked, window=(0.1, 1.0), reveal_truth=True)
    _, _, infos = play(env, seed=0)
    for info in infos:
        assert_array_equal(info["truth"]["vel"], 0.0)
        assert_array_equal(info["truth"]["pos"], env.task.site.pos)


@pytest.mark.parametrize("phi", [(1.0, -2.0, 30.0), (0.0, 0.0, 0.0)])
def test_told_start(parked, phi):
    env = make(parked, start="told", misalignment_deg=phi, window=(0.5, 2.0), stride=1.0)
    _, info = env.reset(seed=1, options={"window": 2})
    q_true = load(parked).reference.q_nb[24]  # 2.5 s
    assert_allclose(attitude.misalignment(info["start"]["q_nb"], q_true), np.radians(phi), atol=1e-14)
    assert info["start"]["known"] is True
    assert_array_equal(env.task.start.q_nb, info["start"]["q_nb"])
    assert env.task.coarse_s == 0.0
    assert_allclose(np.sqrt(np.diag(env.task.prior.P0)[:3]), np.radians([1, 1, 15]))


def test_told_start_is_drawn_from_the_prior(parked):
    env = vector(parked, 1000, start="told", window=(0.5, 1.0))
    _, info = env.reset(seed=0)
    phi = attitude.misalignment(info["start"]["q_nb"], np.tile(load(parked).reference.q_nb[4], (1000, 1)))
    assert np.all(np.abs(phi.std(axis=0) / np.radians([1, 1, 15]) - 1) < 3 / np.sqrt(2000))
    assert np.all(np.abs(info["start"]["vel"].std(axis=0) / 0.2 - 1) < 3.5 / np.sqrt(2000))


def test_unknown_start(parked):
    env = make(parked, coarse=3.0)
    _, info = env.reset(seed=0)
    assert env.task.start is None
    assert env.task.coarse_s == 3.0
    assert_array_equal(info["start"]["q_nb"], IDENTITY)
    assert_array_equal(info["start"]["pos"], env.task.site.pos)
    assert info["start"]["known"] is False


def test_without_a_reference_nothing_is_scored(tmp_path):
    path = files.counts(tmp_path / "bare.npz", ref_q_b2n_wxyz=None, ref_t_s=None)
    _, rewards, infos = play(make(path), seed=0)
    assert not np.any(rewards)
    for info in infos[1:]:
        assert info["scored"] is False
        assert_array_equal(info["errors"]["phi"], 0.0)
        assert info["failed"] is False
    assert play(make(path), np.full(4, np.nan), seed=0)[2][1]["failed"] is True
    for settings in ({"start": "told"}, {"reveal_truth": True}):
        with pytest.raises(ValueError, match="has no reference"):
            make(path, **settings)


def test_gaps(tmp_path):
    tags = 0.005 * np.arange(2400)
    tags[1000:] += 0.05
    path = files.increments(tmp_path / "gap.npz", imu_t_s=tags)
    with pytest.raises(
        ValueError, match=r"IMU samples are missing from 4\.995 s on, inside the window from 4 s"
    ):
        make(path, epoch=0.05, window=(4.0, 2.0))
    assert make(path, epoch=0.05, window=(1.0, 3.0)).task.num_epochs == 60
    assert make(path, epoch=0.05, window=(5.05, 3.0)).task.num_epochs == 60


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"windw": (0, 1)}, "unknown setting of SINS/Replay-v0 'windw'; did you mean 'window'"),
        ({"start": "tld"}, "unknown start 'tld'; did you mean 'told'"),
        ({"mode": "navigate"}, "unknown mode 'navigate'; Allowed: align"),
        ({"prior": "machted"}, "did you mean 'matched'"),
        ({"imu": "rlg-kar"}, "did you mean 'rlg-car'"),
        ({"gps": {"vel_std": 0.1}}, "unknown setting of GpsSpec 'vel_std'; did you mean"),
        ({"gps": {"outages_s": [[1, 2]]}}, "outages_s or jump_mps in a replay"),
        ({"gps": {"rate_hz": 3.0}}, "fixes must fall on the ends of epochs"),
        ({"n_sub": 30}, "n_sub = 30; allowed: 10 for epochs of 0.1 s at 100 Hz"),
        (
            {"epoch": 0.105},
            "epoch = 0.105 s is 10.5 samples of 100 Hz; allowed: whole samples, for instance 0.1 s",
        ),
        ({"epoch": 0.001}, "for instance 0.01 s"),
        ({"epoch": "0.1"}, "epoch = '0.1'; allowed: a number"),
        ({"stride": [90]}, r"stride = \[90\]; allowed: a number"),
        ({"epoch": -1.0}, "epoch = -1.0; allowed: a positive number"),
        (
            {"window": (8.0, 3.0)},
            "window from 8 to 11 s of parked; allowed: within 0 to 10 s, which samples and",
        ),
        ({"window": (-1.0, 3.0)}, "allowed: within 0 to 10 s"),
        ({"window": (1.0, 0.25)}, "window length = 0.25 s with epochs of 0.1 s"),
        ({"window": (1.0, 0.2)}, "at least 3"),
        ({"window": 3.0}, r"window = 3.0; allowed: \(start, length\)"),
        ({"window": (0.0, np.nan)}, "allowed:"),
        ({"stride": 0.0}, "stride = 0.0; allowed: a positive number"),
        ({"coarse": 20.0}, "allowed: coarse shorter than the window length"),
        ({"coarse": 3.0, "start": "told"}, "coarse = 3.0 with start = 'told'; allowed: 0"),
        ({"misalignment_deg": (1, 1, 1)}, "misalignment_deg with start = 'unknown'"),
        ({"misalignment_deg": (1, 1), "start": "told"}, "allowed: three finite numbers"),
        ({"start": "told", "window": (0.0, 3.0)}, "allowed: within 0.1 to 10 s"),
    ],
)
def test_bad_settings(parked, settings, message):
    with pytest.raises(ValueError, match=message):
        make(parked, **settings)


def test_a_rate_that_is_not_the_recordings(driven):
    with pytest.raises(ValueError, match=r"GpsSpec\.rate_hz = 5; allowed: 1, the recording's own"):
        make(driven, epoch=0.05, gps={"rate_hz": 5.0})


def test_a_recording_is_needed():
    with pytest.raises(ValueError, match="recording is missing"):
        gymnasium.make(REPLAY)
    with pytest.raises(FileNotFoundError, match=r"no recording 'nowhere\.npz'"):
        gymnasium.make(REPLAY, recording="nowhere.npz")


@pytest.mark.parametrize(
    "settings", [{}, {"start": "told", "window": (0.5, 3.0), "stride": 1.0, "reveal_truth": True}], ids=str
)
def test_check_env(parked, settings):
    check_env(make(parked, **settings))


def test_check_env_without_a_reference(tmp_path):
    check_env(make(files.counts(tmp_path / "bare.npz", ref_q_b2n_wxyz=None)))


def test_rows_share_the_recording(parked):
    env = vector(parked, 5)
    assert env.unwrapped.episode.world.recording is load(parked)


@pytest.mark.parametrize("recorded", ["rlg_parked_car.npz"], indirect=True)
def test_the_parked_car(recorded):
    env = gymnasium.make(REPLAY, recording=recorded, window=(0.0, 300.0), stride=90.0).unwrapped
    assert_allclose(env.episode.world.windows.starts, 90.0 * np.arange(11))
    assert (env.task.n_sub, env.task.coarse_s, env.task.num_epochs) == (10, 90.0, 3000)
    obs, _ = env.reset(seed=0, options={"window": 10})
    assert_array_equal(obs["dtheta"], load(recorded).dtheta[90000:90010])
    check_env(env)


@pytest.mark.parametrize("recorded", ["navgrade_car_gps.npz"], indirect=True)
@pytest.mark.parametrize("settings", [{"epoch": 0.05}, {"window": (0.05, 68.0)}], ids=str)
def test_the_driven_car(recorded, settings):
    env = make(recorded, **settings)
    observations, _, infos = play(env, seed=0)
    valid = stacked(observations, "gps_valid").sum()
    assert valid == (135 if "epoch" in settings else 67)  # one second has no fix
    assert env.task.n_sub == round(200 * env.task.epoch_s)
    assert "scored" not in infos[1]


@pytest.mark.parametrize("recorded", ["navgrade_car_gps.npz"], indirect=True)
def test_the_driven_car_with_epochs_that_miss_the_fixes(recorded):
    with pytest.raises(ValueError, match=r"begins at 0\.05 s modulo 0\.1 s or epochs of 0\.05 s"):
        make(recorded, window=(0.0, 68.0))
