import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.testing import assert_allclose, assert_array_equal
from oracles import recorded as files
from oracles.replays import IDENTITY, REPLAY, make, play, stacked, vector

from sins_env import attitude
from sins_env.recordings import load
from sins_env.specs import IMU_PRESETS


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
        assert_array_equal(stacked(observations[:-1], "dtheta").reshape(-1, 3), recording.dtheta[first : first + 400])
        assert observations[0]["t"] == pytest.approx(0.1)  # a window's own time begins at 0
    assert make(parked, window=(1.0, 9.0), stride=0.1).episode.world.windows.starts == [1.0]
    assert_allclose(make(parked, window=(0.018, 1.0)).episode.world.windows.starts, [0.02])  # the nearest edge


def test_a_duration_is_a_window_from_the_first_epoch_on(parked, driven):
    assert make(parked, duration=4).task.duration_s == 4.0
    for path, settings in ((parked, {"start": "told"}), (driven, {"epoch": 0.05}), (parked, {"stride": 2.0})):
        whole, part = make(path, **settings).episode.world.windows, make(path, duration=3.0, **settings)
        assert part.task.num_epochs == round(3.0 / part.task.epoch_s)
        starts = part.episode.world.windows.starts
        assert starts[0] == whole.starts[0]
        assert len(starts) == (4 if "stride" in settings else 1)


def test_the_reset_of_its_own_accord_draws_the_windows(parked):
    env = vector(parked, 40, window=(0.0, 1.0), stride=1.0)
    first = env.reset(seed=0, options={"window": [3] * 40})[0]["dtheta"]
    assert_array_equal(first, first[:1].repeat(40, axis=0))
    for _ in range(11):
        obs, *_ = env.step(np.tile(IDENTITY, (40, 1)))
    assert obs["t"][0, 0] == pytest.approx(0.1)
    assert len(np.unique(obs["dtheta"][:, 0, 0])) > 5


def test_the_seed_draws_the_window(parked):
    env = make(parked, window=(0.0, 1.0), stride=1.0)
    first = [env.reset(seed=seed)[0]["dtheta"][0, 0] for seed in range(40)]
    assert_array_equal(first, [env.reset(seed=seed)[0]["dtheta"][0, 0] for seed in range(40)])
    assert 7 <= len(set(first)) <= 10
    assert len({env.reset()[0]["dtheta"][0, 0] for _ in range(30)}) > 5  # and draws on


@pytest.mark.parametrize("rows", [1, 2, 7])
@pytest.mark.parametrize("settings", [{}, {"start": "told", "window": (0.2, 1.0), "reveal_truth": True}], ids=str)
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
        assert_array_equal([i["errors"]["phi"][row] for i in batch[2][1:]], [i["errors"]["phi"] for i in infos[1:]])
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


@pytest.mark.parametrize(("shift", "exact"), [(0.002, True), (-0.002, True), (0.003, False)])
def test_stamps_within_half_a_sample_are_taken_as_they_are(tmp_path, shift, exact):
    t = 0.05 * np.arange(1, 240) + shift
    path = files.increments(tmp_path / "shifted.npz", ref_t_s=t)
    _, _, infos = play(make(path, epoch=0.05, window=(0.1, 8.0), reveal_truth=True), seed=0)
    truth = np.array([info["truth"]["q_nb"] for info in infos])
    assert np.array_equal(truth, load(path).reference.q_nb[1 : 1 + len(truth)]) == exact


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
    """Fixes at 0.95 s + n are 0.05 s old at the ends of epochs of 0.1 s from 0 s on, and none is lost."""
    observations, _, _ = play(make(recorded, window=(0.0, 10.0)), seed=0)
    valid = stacked(observations, "gps_valid")[:, 0] == 1
    assert_allclose(stacked(observations, "t")[valid, 0], np.arange(1.0, 10.5))
    assert_allclose(stacked(observations, "gps_age")[valid, 0], 0.05, atol=1e-9)
