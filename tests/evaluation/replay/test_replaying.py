"""``convert``, ``replay`` and ``describe`` of recordings, as they are typed."""

import json
import math

import matplotlib.figure
import numpy as np
import pytest
from evaluation.replay.followers import Fixed
from numpy.testing import assert_allclose
from oracles import made

from sins_env import recordings
from sins_env.attitude import from_euler
from sins_env.evaluation.estimators.guard import EstimatorError
from sins_env.evaluation.replay import replaying
from sins_env.evaluation.replay.angles_figure import replay_figure
from sins_env.evaluation.replay.replaying import Replay, replay
from sins_env.recordings import Recording, Reference

PLUGIN, FOLLOWERS = "evaluation.plugins:", "evaluation.replay.followers:"
RATE = 100.0


@pytest.fixture(autouse=True)
def _here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "140")


@pytest.fixture
def still(tmp_path):
    """60 s at rest, heading 350 deg; its reference is 10 Hz."""
    n = round(60 * RATE)
    t = 100.0 + 0.1 * np.arange(1, 601)
    q = np.tile(from_euler(np.radians(350.0), 0.0, 0.0), (600, 1))
    dvel = np.tile([0.0, 0.0, 9.79 / RATE], (n, 1))
    one = Recording("still", RATE, 100.0, np.zeros((n, 3)), dvel, made.SITE, reference=Reference(t, q, None, None))
    recordings.save(one, tmp_path / "still.npz")
    bare = Recording("bare", RATE, 100.0, one.dtheta, one.dvel, made.SITE)
    recordings.save(bare, tmp_path / "bare.csv")
    return one


class Single(Fixed):
    batched = False

    def step(self, obs):
        assert obs["dtheta"].ndim == 2
        return from_euler(np.radians(350.0), 0.0, 0.0)


def test_replay_of_windows(still):
    seen = []
    found = replay("still.npz", Fixed, [(100.0, 20.0)], 10.0, env={"coarse": 5.0}, progress=lambda *a: seen.append(a))
    assert_allclose(found.starts, [100, 110, 120, 130, 140])
    assert (found.recording, found.coarse_s, len(found.t), found.t[-1]) == ("still", 5.0, 200, pytest.approx(20.0))
    assert_allclose(np.degrees(found.angles[3, -1]), [350.3, 1.0, -2.0])
    assert_allclose(np.degrees(found.reference[:, :, 0]), 350.0)
    assert_allclose(np.degrees(found.scatter[2, -1]), [0.2, 1.0, -2.0], atol=1e-12)
    assert_allclose(np.degrees(found.spread[-1]), [0.1 * np.sqrt(2.5), 0, 0], atol=1e-12)
    assert found.failed == ("",) * 5
    assert seen[-1][:2] == (pytest.approx(100.0), pytest.approx(100.0))
    assert "heading  350.000 deg" in seen[-1][2]


def test_replay_of_single_windows_and_estimators(still):
    found = replay("still.npz", Fixed, [(105.0, 20.0), (130.0, 20.0)], env={"coarse": 5.0})
    assert_allclose(found.starts, [105, 130])
    assert_allclose(np.degrees(found.angles[:, -1, 0]), 350.0)  # two environments of one row
    one = replay("still.npz", Single, [(100.0, 20.0)], 10.0, env={"coarse": 5.0})
    assert_allclose(one.starts, [100, 110, 120, 130, 140])
    assert_allclose(np.degrees(one.angles[:, -1, 0]), 350.0)
    whole = replay("bare.csv", Fixed, env={"coarse": 5.0})
    assert (len(whole.starts), whole.reference, len(whole.t)) == (1, None, 600)
    assert np.isnan(whole.spread).all()


class Reads(Fixed):
    """The heading, deg, that the first increment of an epoch holds in urad."""

    def step(self, obs):
        return from_euler(np.radians(1e6 * obs["dtheta"][..., 0, 0]), 0.0, 0.0)


@pytest.mark.parametrize("batched", [True, False])
def test_each_window_has_its_own_data_and_reference(tmp_path, monkeypatch, batched):
    monkeypatch.setattr(Reads, "batched", batched)
    n = round(60 * RATE)
    t = 100.0 + np.arange(1, n + 1) / RATE
    dtheta = 1e-6 * np.floor((t - 100.0 - 0.5 / RATE) * 10)[:, None] * [1.0, 0, 0]  # the number of the epoch
    dvel = np.tile([0.0, 0.0, 9.79 / RATE], (n, 1))
    q = from_euler(np.radians(0.5 * (t - 100.0)), np.zeros(n), np.zeros(n))
    recordings.save(
        Recording("told", RATE, 100.0, dtheta, dvel, made.SITE, reference=Reference(t, q, None, None)), "told.npz"
    )
    found = replay("told.npz", Reads, [(105.0, 10.0)], 5.0, env={"coarse": 1.0})
    assert len(found.starts) == 10
    expected = 10 * (found.starts[:, None] - 100.0) + np.arange(100)
    apart = found.angles[:, :, 0] - np.radians(expected)
    assert_allclose(np.cos(apart), 1.0, atol=1e-12)
    assert_allclose(np.degrees(found.reference[:, :, 0]), 0.5 * (found.starts[:, None] - 100.0 + found.t), atol=1e-9)


@pytest.mark.parametrize("solver", ["DeadReckoning", "OneByOne", "Noisy", "Vandal"])
def test_apart_the_replay_is_the_same(still, solver):
    """To the last bit."""
    given = ("still.npz", PLUGIN + solver, [(105.0, 20.0)], 20.0)
    here = replay(*given, env={"start": "told"}, seed=3)
    there = replay(*given, env={"start": "told"}, seed=3, epoch_timeout_s=math.inf)
    for name in ("starts", "t", "angles", "reference"):
        np.testing.assert_array_equal(getattr(here, name), getattr(there, name))
    assert here.failed == there.failed
    assert repr(here) == f"<Replay of {PLUGIN}{solver} on still: 2 windows of 20 s>"


def test_each_environment_has_a_new_estimator(still):
    windows = [(105.0, 20.0), (130.0, 20.0)]
    found = replay("still.npz", PLUGIN + "Once", windows, settings={"epoch": 0}, env={"start": "told"})
    assert found.failed == ("", "")


def test_a_solver_that_ends_its_process_or_hangs(still):
    with pytest.raises(EstimatorError, match=r"step ended its process \(exit code 7\)"):
        replay("still.npz", PLUGIN + "Leaves", env={"coarse": 5.0}, epoch_timeout_s=math.inf)
    with pytest.raises(EstimatorError, match=r"step took longer than 1 s"):
        replay("still.npz", PLUGIN + "At", settings={"how": "hang"}, env={"start": "told"}, epoch_timeout_s=1.0)


def test_without_a_reference_the_angles_scatter(still):
    found = replay("bare.csv", Fixed, [(100.0, 20.0)], 20.0, env={"coarse": 5.0})
    assert_allclose(np.degrees(found.scatter[:, -1, 0]), [-0.1, 0.0, 0.1], atol=1e-9)
    assert_allclose(np.degrees(found.spread[-1]), [0.1, 0, 0], atol=1e-9)


def test_angles_across_north():
    angles = np.radians([[[359.0, 1, 0]], [[1.0, 3, 0]]])
    one = Replay("x", "y", np.zeros(2), np.ones(1), 0.0, angles, None, ("", ""))
    assert_allclose(np.degrees(one.scatter[:, 0, 0]), [-1, 1])
    assert_allclose(np.degrees(one.spread[0]), [np.sqrt(2), np.sqrt(2), 0], atol=1e-12)
    assert_allclose(np.degrees(replaying.mean_angle(angles))[0], [0, 2, 0], atol=1e-12)
    held = Replay("x", "y", np.zeros(2), np.ones(1), 0.0, angles, angles[::-1], ("", ""))
    assert_allclose(np.degrees(held.scatter[:, 0, 0]), [-2, 2])


def test_failed_windows_do_not_count(still):
    found = replay("still.npz", Fixed, [(100.0, 20.0)], 20.0, settings={"bad": True}, env={"coarse": 5.0})
    assert found.failed == ("", "200 failed epochs", "")
    assert_allclose(np.degrees(found.spread[-1, 0]), 0.1 * np.sqrt(2))
    assert np.isnan(found.angles[1]).all()
    replay_figure(found).canvas.draw()


@pytest.mark.parametrize("name", ["still.npz", "bare.csv"])
@pytest.mark.parametrize("windows", [[], [(100.0, 20.0)], [(100.0, 20.0), (120.0, 20.0)]])
def test_figures(still, name, windows):
    figure = replay_figure(replay(name, Fixed, windows, env={"coarse": 5.0}))
    assert isinstance(figure, matplotlib.figure.Figure)
    figure.canvas.draw()
    titles = [axes.get_title(loc="left") for axes in figure.axes]
    assert sum("spread of its" in title for title in titles) == (3 if len(windows) > 1 else 0)
    assert "heading   at the end 350.000 deg" in titles[0]
    low, high = figure.axes[0].get_ylim()
    assert low < 350 < high
    assert high - low < 1


def test_cli_replay(cli, still, tmp_path):
    base = ("--coarse", 5, "--window", 100, 20)
    code, out, err = cli("replay", "still.npz", FOLLOWERS + "Fixed", *base, "--stride", 10, "--plot", "r.png")
    assert err.pop(0).startswith("warning: earth_rate_at_rest: at rest the gyros turn by 0 deg/h, the earth by 15.04")
    assert err.pop(0).startswith("no first heading: gyros of 15 deg/h (measured at rest)")
    assert (code, err) == (0, ["figure: r.png"])
    for part in ("120 to 140", "350.200", "heading error, deg", "spread (1 sigma)", "0.15811", "RMS"):
        assert part in out
    assert (tmp_path / "r.png").stat().st_size > 30_000
    code, out, err = cli("replay", "bare.csv", FOLLOWERS + "Fixed", *base, "--window", 130, 20)
    assert (code, err[2:]) == (0, [])
    assert "error" not in out
    code, out, err = cli("replay", "still.npz", FOLLOWERS + "Fixed", *base, "--stride", 10, "--set", "bad=true")
    assert (code, "200 failed epochs" in out) == (1, True)
    assert err[2:] == [f"sins-env: {FOLLOWERS}Fixed on still, window from 110 s: 200 failed epochs"]
    code, out, err = cli("replay", "still.npz", FOLLOWERS + "Breaks", *base)
    assert (code, out) == (1, "")
    assert err == [f"sins-env: {FOLLOWERS}Breaks on still.npz: step raised ArithmeticError: no square root"]
    code, out, err = cli("replay", "still.npz", PLUGIN + "Ailing", *base)
    assert code == 1
    assert "gave up at" in err[-1]


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("replay", "stil.npz", PLUGIN + "Noisy"), "did you mean 'still.npz'?"),
        (("replay", "still.npz", PLUGIN + "Noizy"), "did you mean 'Noisy'?"),
        (("replay", "still.npz", PLUGIN + "Noisy", "--window", 100, 500), "allowed: within 100 to 160 s"),
        (("replay", "still.npz", PLUGIN + "Noisy", "--window", 100), "expected 2 arguments"),
        (("replay", "still.npz", PLUGIN + "Noisy", "--stride", 5), "allowed: a single window"),
        (("replay", "still.npz", PLUGIN + "Noisy", "--window", 100, 20, "--window", 120, 30), "one length for all"),
        (("replay", "still.npz", PLUGIN + "Noisy", "--imu", "mem", "--coarse", 5), "did you mean 'mems'?"),
        (
            ("replay", "still.npz", PLUGIN + "Noisy", "--imu", "mems,arw_deg_h=1"),
            "mean 'arw_deg_sqrt_h'|arw_deg_s_sqrt_hz",
        ),
        (("replay", "still.npz", PLUGIN + "Noisy", "--gps", "vel_std_cm_s=-1"), "given as vel_std_cm_s = -1"),
        (("describe", "mems", "--imu", "mems"), "allowed: for a recording"),
        (("replay", "still.npz", PLUGIN + "Noisy", "--bridge", -1), "bridge = -1.0; allowed: a number of seconds"),
        (("replay", "still.npz", PLUGIN + "Noisy", "--window", "+1", "+5"), "window = ['+1', '+5']; allowed: (start"),
        (("replay", "still.npz", PLUGIN + "Noisy", "--plot", "a.xyz"), "allowed: a file that ends in"),
        (("convert", "still.npz", "still.npz"), "exists already"),
        (("convert", "still.npz", "a.xyz"), "no format has the ending '.xyz'"),
        (("convert", "still.npz", "no/a.txt"), "the directory does not exist"),
        (("convert", "still.npz", "a.txt", "--format", "kfgin"), "did you mean 'kfgins'?"),
        (("convert", "still.npz", "a.txt", "--format", "csv"), "no axes"),
        (("convert", "still.npz", "a.txt", "--to", "pdf"), "unknown format 'pdf'"),
        (("convert", "bare.csv", "a.txt", "--axes", "FRU"), "axes = 'FRU'"),
        (("convert", "bare.csv", "a.txt", "--resample", "-5"), "resample_hz = -5.0"),
        (("convert", "bare.csv", "a.txt", "--mapping", "gone.json"), "gone.json"),
        (("describe", "gone.csv"), "did you mean|recordings there"),
    ],
)
def test_wrong_use(cli, still, tmp_path, arguments, part):
    before = sorted(tmp_path.iterdir())
    code, out, err = cli(*arguments)
    assert (code, out) == (2, "")
    assert len(err) == 1
    assert any(one in err[0] for one in part.split("|"))
    assert sorted(tmp_path.iterdir()) == before


def test_cli_convert(cli, tmp_path):
    first = made.recording(gaps=(slice(700, 710),))
    recordings.save(first, tmp_path / "a.npz")
    code, out, err = cli("convert", "a.npz", "b.txt")
    assert (code, out.split()) == (0, ["b.txt", "b_gnss.txt", "b_truth.txt", "b.json"])
    assert err == ["missing: 1003.5 to 1003.55 s (10 samples)"]
    code, out, err = cli("convert", "b.txt", "c.imu")
    assert (code, out.split()) == (0, ["c.imu"])
    assert err[-1] == "psins-imu has no place for: fixes, reference, lever arm"
    assert cli("convert", "b.txt", "c.imu")[0] == 2
    assert cli("convert", "b.json", "c.imu", "--force", "--resample", 100)[0] == 0
    assert recordings.load("c.imu").rate_hz == 100.0
    code, out, _ = cli("convert", "b.txt", "d.dat", "--to", "csv", "--axes", "FLU")
    assert (code, out.split()) == (0, ["d.dat", "d_gnss.dat", "d_reference.dat", "d.json"])
    x, y, z = (first.dvel @ made.SWAP.T).T
    found = recordings.load("d.json", bridge_s=0.0)
    assert_allclose(found.dvel, np.stack([-y, x, z], axis=-1))
    code, out, err = cli("convert", "a.npz", "b.txt", "--force")
    assert code == 0


def test_cli_convert_drops_and_differences(cli, tmp_path):
    recordings.save(made.recording(velocity=False, reference=False), tmp_path / "a.txt")
    lines = (tmp_path / "a.txt").read_text().splitlines()
    (tmp_path / "a.txt").write_text("\n".join([*lines[:50], *lines[49:]]) + "\n")
    code, _, err = cli("convert", "a.txt", "b.npz")
    assert code == 2
    assert "line 51: 1 repeated stamp, 1000.25 s" in err[0]
    assert cli("convert", "a.txt", "b.npz", "--drop-duplicates")[0] == 0
    assert recordings.load("b.npz").gnss.vel is None
    code, _, err = cli("replay", "b.npz", PLUGIN + "Noisy", "--coarse", 1)
    assert (code, "its fixes are positions only" in err[0]) == (2, True)
    more = ("--drop-duplicates", "--velocity-from-positions", "--force")
    assert cli("convert", "a.txt", "b.npz", *more)[0] == 0
    assert recordings.load("b.npz").gnss.vel.shape == (10, 3)
    assert cli("replay", "b.npz", PLUGIN + "Noisy", "--coarse", 1)[0] == 0


def test_describe_says_what_is_there(cli, tmp_path):
    one = made.recording(samples=8000, gaps=(slice(6000, 6010), slice(7000, 7001)))
    recordings.save(one, tmp_path / "a.txt")
    for name in ("a.txt", "a.json"):
        code, out, err = cli("describe", name)
        text = " ".join(out.split())
        assert (code, err) == (0, [])
        for part in (
            "8000 at 200 Hz",
            "1000 to 1040 s",
            "11 samples: 10 from 1030 to 1030.05 s, 1 from 1035 to 1035.005 s",
            "40 fixes at 1 Hz; missing: no fix",
            "lever arm",
            "800 attitudes at 20 Hz",
            "|f|",
            "|w|",
            "at rest",
            "first heading",
        ):
            assert part in text
    recordings.save(made.recording(samples=1000, gnss=False, velocity=False), tmp_path / "b.mat")
    out = " ".join(cli("describe", "b.mat")[1].split())
    assert "none; a zero-velocity update stands in" in out
    assert "no 20 s without a gap" in out
    assert "no sample" in out


def test_describe_of_a_bad_file_is_one_line(cli, tmp_path):
    (tmp_path / "x.txt").write_text("1 2 3\n")
    (tmp_path / "x.json").write_text(json.dumps({"site": [1, 2, 3]}))
    code, out, err = cli("describe", "x.txt")
    assert (code, out) == (2, "")
    assert len(err) == 1
    assert "x.txt: line 1 has 3 columns; allowed: 7, 8 or 9" in err[0]


def test_allan_of_any_format(cli, tmp_path):
    recordings.save(made.recording(samples=4000, gnss=False), tmp_path / "a.imu")
    assert cli("describe", "a.imu", "--allan", "a.png")[0] == 0
    assert (tmp_path / "a.png").stat().st_size > 10_000
