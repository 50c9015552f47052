"""Solutions: their files against independent readers, their judgement against laws, and the verbs that write them."""

import dataclasses
import itertools
import json
import math
from xml.etree import ElementTree

import gymnasium
import matplotlib.figure
import numpy as np
import pymap3d
import pytest
from evaluation.replay.followers import T0, motion, place
from numpy.testing import assert_allclose
from oracles import made
from rich.console import Console
from scipy.spatial.transform import Rotation

import sins_env
import solvers
from sins_env import attitude, recordings
from sins_env.cli.whole_tables import whole
from sins_env.evaluation.estimators.guard import EstimatorError
from sins_env.evaluation.play.errors import euler_errors
from sins_env.evaluation.replay.consistency import judge
from sins_env.evaluation.replay.replaying import replay
from sins_env.evaluation.replay.told import sigma_of_angles
from sins_env.evaluation.show.rich_tables import titled
from sins_env.evaluation.solution import aligning, navigating
from sins_env.recordings import Gnss, Recording, Reference
from sins_env.specs import IMU_PRESETS
from sins_env.types import Site
from sins_env.units import UG
from solvers import zoo
from solvers.pipeline.smoother import smooth_navigation

RATE, ENV = 100.0, {"coarse": 0.0}
BIAS, LEVER = np.array([1e-6, -2e-6, 3e-6]), np.array([0.5, -1.0, 2.0])


def bend():
    """60 s of a bend with a fix each second, whose estimators below know the truth; the antenna has a lever arm."""
    n = round(60 * RATE)
    fixes = T0 + np.arange(1.0, 61.0)
    vel = 3.0 * np.stack([np.sin(0.1 * (fixes - T0)), np.cos(0.1 * (fixes - T0)), np.full(60, 0.01)], axis=-1)
    force = np.tile([0.0, 0.0, 9.79 / RATE], (n, 1))
    q, enu = motion(fixes)
    gnss = Gnss(fixes, vel, place(enu + Rotation.from_quat(q, scalar_first=True).apply(LEVER)))
    return Recording("bend", RATE, T0, np.zeros((n, 3)), force, made.SITE, gnss, LEVER)


class Knows:
    """Returns the truth and tells innovations with the covariance I, from a generator with ``scale`` and ``memory``."""

    batched = False

    def __init__(self, scale=1.0, memory=0.0, drift=0.0):
        self.scale, self.memory, self.drift = scale, memory, drift

    def reset(self, task, rng, num_runs=1):
        self.rng, self.nu = np.random.default_rng(5), np.zeros(6)

    def step(self, obs):
        self.fixed, t = bool(obs["gps_valid"][0]), T0 + float(obs["t"][0])
        if self.fixed:
            new = self.rng.standard_normal(6)
            self.nu = self.memory * self.nu + math.sqrt(1 - self.memory**2) * new
        q, enu = motion(np.array([t]))
        vel = 3.0 * np.array([math.sin(0.1 * (t - T0)), math.cos(0.1 * (t - T0)), 0.01])
        off = [0.0, 0.0, self.drift * max(float(obs["t"][0]) - 30.0, 0.0)]
        return np.concatenate([q[0], vel, place(enu + off)[0]])

    def covariance(self):
        return np.diag([1e-4, 2e-4, 3e-4, 0.1, 0.2, 0.3, 1.0, 2.0, 3.0]) ** 2

    def diagnostics(self):
        found = {
            "gyro_bias": BIAS,
            "gyro_bias_sigma": 0.1 * BIAS,
            "odometer.scale": np.array([0.01]),
            "words": np.array(["x"]),
        }
        found["odometer.scale_sigma"] = np.array([0.001])
        if self.fixed:
            found |= {"gps_residual": self.scale * self.nu, "gps_covariance": np.eye(6), "gps_nis": np.array(7.0)}
        return found


@pytest.fixture(scope="module")
def solution():
    return sins_env.navigate(bend(), Knows, outages_s=[(40.0, 50.0)], **ENV)


def test_csv_has_the_columns_and_the_values(solution, tmp_path):
    solution.to_csv(tmp_path / "a.csv")
    names = (tmp_path / "a.csv").read_text().splitlines()[0].split(",")
    assert names[:10] == (
        [
            "time_s",
            "latitude_deg",
            "longitude_deg",
            "height_m",
            "v_east_mps",
            "v_north_mps",
            "v_up_mps",
            "heading_deg",
            "pitch_deg",
            "roll_deg",
        ]
    )
    assert {
        "gyro_bias_x_deg_h",
        "accel_bias_z_ug",
        "sigma_heading_deg",
        "sigma_up_m",
        "sigma_v_east_mps",
        "nis",
    } <= set(names)
    assert names[-2:] == ["odometer_scale", "sigma_odometer_scale"]
    rows = np.genfromtxt(tmp_path / "a.csv", delimiter=",", names=True)
    _q, enu = motion(rows["time_s"])
    assert_allclose(rows["time_s"][[0, -1]], [T0 + 0.1, T0 + 60.0])
    lat, lon, h = pymap3d.enu2geodetic(*enu.T, *np.degrees(made.SITE.pos[:2]), made.SITE.height)
    assert_allclose(
        np.column_stack([rows["latitude_deg"], rows["longitude_deg"]]), np.column_stack([lat, lon]), atol=2e-9
    )
    assert_allclose(rows["height_m"], h, atol=2e-4)
    assert_allclose(rows["gyro_bias_x_deg_h"], np.degrees(BIAS[0]) * 3600, rtol=1e-5)
    assert np.isnan(rows["accel_bias_x_ug"]).all()  # blank
    assert np.isfinite(rows["nis"]).sum() == 50
    assert_allclose(rows["sigma_north_m"], 2.0)
    solution.to_csv(tmp_path / "n.csv", frame="ned", rate_hz=1.0)
    ned = np.genfromtxt(tmp_path / "n.csv", delimiter=",", names=True)
    assert_allclose(np.diff(ned["time_s"]), 1.0)
    every = rows[::10]
    for one, other, sign in (
        ("v_down_mps", "v_up_mps", -1),
        ("v_north_mps", "v_north_mps", 1),
        ("heading_deg", "heading_deg", 1),
    ):
        assert_allclose(ned[one], sign * every[other])
    assert_allclose(ned["gyro_bias_x_deg_h"], every["gyro_bias_y_deg_h"])
    assert_allclose(ned["sigma_down_m"], every["sigma_up_m"])
    with pytest.raises(ValueError, match="up to 10 Hz"):
        solution.to_csv(tmp_path / "n.csv", rate_hz=11.0)
    solution.to_npz(tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as arrays:
        assert list(arrays) == names
        assert_allclose(arrays["height_m"], rows["height_m"], atol=1e-4)


def test_tum_and_nav_in_either_frame(solution, tmp_path):
    """A rotation of scipy, and the reader of KF-GINS' truth."""
    for frame, turn in (("enu", np.eye(3)), ("ned", made.SWAP)):
        solution.to_tum(tmp_path / "a.tum", frame=frame)
        rows = np.loadtxt(tmp_path / "a.tum")
        q, enu = motion(rows[:, 0])
        assert_allclose(rows[:, 1:4], (enu - enu[0]) @ turn.T, atol=2e-3)
        expected = turn @ Rotation.from_quat(q, scalar_first=True).as_matrix() @ turn
        assert_allclose(Rotation.from_quat(rows[:, 4:]).as_matrix(), expected, atol=1e-7)
    solution.to_nav(tmp_path / "a.nav")
    week, t, lat, _, h, *_, down, roll, pitch, yaw = np.loadtxt(tmp_path / "a.nav").T
    assert_allclose(
        np.column_stack([t, np.radians(lat), h]),
        np.column_stack([solution.time, solution.position[:, [0, 2]]]),
        atol=1e-6,
    )
    assert_allclose(np.radians(np.column_stack([yaw, pitch, roll])), solution.angles, atol=1e-9)
    assert_allclose(down, -0.03)
    assert (week == 0).all()
    with pytest.raises(ValueError, match="its own frame"):
        sins_env.evaluation.solution.files.save(solution, tmp_path / "a.nav", frame="ned")


#: Order of the elements in the OGC schema of KML 2.2 (ogckml22.xsd), of those that are written.
ORDER = {
    "Document": ["name", "open", "description", "Style", "Folder", "Placemark"],
    "Folder": ["name", "Placemark"],
    "Placemark": ["name", "description", "styleUrl", "Point", "LineString"],
    "LineStyle": ["color", "width"],
    "LineString": ["tessellate", "altitudeMode", "coordinates"],
}


def test_kml_keeps_the_order_of_the_schema_and_the_whole_track(solution, tmp_path):
    wide = dataclasses.replace(solution, sigma_position=solution.sigma_position * np.linspace(0.1, 9, 600)[:, None])
    wide.to_kml(tmp_path / "a.kml")
    space = "{http://www.opengis.net/kml/2.2}"
    top = ElementTree.parse(tmp_path / "a.kml").getroot()
    assert top.tag == space + "kml"
    for element in top.iter():
        names = [child.tag.removeprefix(space) for child in element]
        order = ORDER.get(element.tag.removeprefix(space), names)
        assert [order.index(name) for name in names] == sorted(order.index(name) for name in names)
    lines = [line.text.split() for line in top.iterfind(f".//{space}LineString/{space}coordinates")]
    assert len(lines) == 4  # classes up to 0.5, 2, 10 and above 10 m
    assert all(one[-1] == other[0] for one, other in itertools.pairwise(lines))
    track = np.array([place_.split(",") for i, line in enumerate(lines) for place_ in line[i > 0 :]], dtype=float)
    assert_allclose(track[:, :2], np.degrees(solution.position[:, [1, 0]]), atol=1e-8)
    styles = {style.get("id") for style in top.iter(space + "Style")}
    assert {url.text[1:] for url in top.iter(space + "styleUrl")} <= styles


def test_sigmas_of_angles_are_those_of_small_turns():
    rng = np.random.default_rng(1)
    angles = np.radians([[200.0, 30.0, -60.0]])
    P = np.array([[4.0, 1.0, 0.5], [1.0, 2.0, -0.3], [0.5, -0.3, 3.0]]) * 1e-8
    phi = rng.multivariate_normal(np.zeros(3), P, 20_000)
    drawn = euler_errors(np.tile(attitude.from_euler(*angles[0]), (len(phi), 1)), phi)
    assert_allclose(sigma_of_angles(angles, P[None])[0], drawn.std(axis=0), rtol=0.03)


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        ({}, []),
        ({"scale": 2.0}, ["nis_velocity", "nis_position"]),
        ({"scale": 0.3}, ["nis_velocity", "nis_position"]),
        ({"memory": 0.8}, ["whiteness_velocity", "whiteness_position"]),
        ({"memory": 0.8, "scale": 0.3}, ["nis_velocity", "whiteness_velocity", "nis_position", "whiteness_position"]),
        ({"drift": 1.0}, ["withheld_fixes"]),
    ],
)
def test_what_leaves_its_band_is_told(settings, names):
    one = replay(bend(), Knows, settings=settings, env={"mode": "navigate", "gps": {"outages_s": [[40, 50]]}, **ENV})
    found = judge(one)
    assert judge(one) is found
    assert not dataclasses.replace(one).judged
    assert [w.name for w in found.warnings if not w.name.startswith("nis") or "scale" in settings] == names
    assert all((w.value > w.limit) != ("smaller than told" in w.text) for w in found.warnings)
    assert found.consistent == (not names)
    too_small = "scale" not in settings  # what the warnings say of the sigmas must not contradict each other
    assert all(("too small" in w.text) == too_small for w in found.warnings if w.name.startswith("whiteness"))
    if "drift" in settings:  # 10 to 20 m at a sigma of 3.0 and 10 m of the fixes
        assert_allclose(found.withheld[0], [0.0, math.sqrt(np.mean(np.arange(11.0, 21.0) ** 2))], atol=0.02)
        assert_allclose(found.warnings[0].span_s, [T0 + 41, T0 + 50])
        assert found.inside[[399, 450, 599]].tolist() == [True, False, True]


def test_bands_hold_at_their_chance():
    """At a chance of 0.1 %, at most 1 of 100 records of white innovations leave a band."""
    one = replay(bend(), Knows, env={"mode": "navigate", **ENV})
    rng, left = np.random.default_rng(2), 0
    values = one.told.values["gps_residual"]
    there = np.isfinite(values)
    for _ in range(100):
        values[there] = rng.standard_normal(there.sum())
        left += not judge(one).consistent
    assert left <= 1


def test_a_solver_that_tells_nothing_leaves_blanks(tmp_path):
    class Silent(Knows):
        covariance = diagnostics = property()  # hasattr says no

    found = sins_env.navigate(bend(), Silent, **ENV)
    found.to_csv(tmp_path / "a.csv")
    found.to_kml(tmp_path / "a.kml")
    assert (tmp_path / "a.csv").read_text().splitlines()[5].endswith(",,,1")
    assert "sigma unknown" in (tmp_path / "a.kml").read_text()
    assert found.consistency.summary == "no innovations are told"
    found.plot()
    assert json.dumps(found.summary(), allow_nan=False)


def test_summary_figure_and_words(solution, tmp_path):
    told = solution.summary()
    assert told["consistent"] is True
    assert (told["warnings"], told["epochs"], len(told["withheld_rms_m"])) == ([], 600, 1)
    assert_allclose(told["sigma_heading_deg"], np.degrees(3e-4), rtol=1e-3)  # at a small pitch
    assert len(repr(solution)) < 250
    assert "<table>" in solution._repr_html_()
    figure = solution.plot(tmp_path / "a.png")
    assert isinstance(figure, matplotlib.figure.Figure)
    titles = " ".join(axes.get_title(loc="left") for axes in figure.axes)
    for part in ("sigma of the heading", "innovations of velocity", "x: withheld fixes", "mean NIS in windows"):
        assert part in titles
    assert "nothing to compare with" not in titles


def test_a_run_that_fails_is_an_error():
    class Lost(Knows):
        fixed = False

        def step(self, obs):
            return np.full(10, np.nan)

    with pytest.raises(EstimatorError, match="Lost on bend: 600 failed epochs"):
        sins_env.navigate(bend(), Lost, **ENV)


def test_verbs(cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recordings.save(dataclasses.replace(flown(), reference=None), tmp_path / "a.npz")
    given = ("a.npz", "--imu", "navigation", "--coarse", 8)
    code, out, err = cli(
        "navigate", *given, "--solver", "ekf", "--out", "a.csv", "--out", "a.tum", "--rate", 2, "--json"
    )
    told = json.loads(out)
    assert (code, told["files"], told["epochs"]) == (0, ["a.csv", "a.tum"], 300)
    assert len(np.loadtxt("a.tum")) == 60
    assert err[:2] == ["solution: a.csv", "solution: a.tum"]
    assert told["consistent"] == (not told["warnings"]) == (not any("nis_" in line for line in err))
    code, out, err = cli("replay", "a.npz", "ekf", *given[1:], "--mode", "navigate", "--out", "r.nav")
    assert (code, len(np.loadtxt("r.nav"))) == (0, 300)
    before = sorted(tmp_path.iterdir())
    for more, part in (
        (("--out", "a.xyz"), "allowed: a file that ends in .csv, .kml, .tum, .nav, .npz"),
        (("--out", "no/a.csv"), "the directory does not exist"),
        (("--out", "a.kml", "--frame", "ned"), "its own frame"),
        (("--figure", "a.xyz"), "allowed: a file that ends in"),
        (("--smooth",), "'gsf_imm' has no smoother; allowed: a filter with one Gaussian"),
    ):
        code, out, err = cli("navigate", *given, *more)
        assert (code, out, len(err)) == (2, "", 1)
        assert part in err[0]
    assert sorted(tmp_path.iterdir()) == before


FLIGHT = {
    "latitude_deg": 48.1,
    "longitude_deg": 11.6,
    "height_m": 520.0,
    "segments": [[10], [8, 1.0], [12, 0.5, 0, 0, 5]],
}


def flown(**more):
    """30 s of a flight with two samples an epoch, fixes at 1 Hz, and the truth as its reference."""
    given = {"profile": FLIGHT, "n_sub": 2, "imu": "navigation", "gps": FIXES, "reveal_truth": True, **more}
    env = gymnasium.make("SINS/NavFlight-v0", **given)
    obs, _ = env.reset(seed=4)
    seen, true, over = [], [], False
    while not over:
        seen.append(obs)
        obs, _, _, over, info = env.step(np.eye(10)[0])
        true.append(info["truth"])
    t = np.array([one["t"][0] for one in seen])
    fix = np.array([one["gps_valid"][0] == 1 for one in seen])
    every = {name: np.stack([one[name] for one in seen]) for name in seen[0]}
    truth = Reference(t, *(np.stack([one[name] for one in true]) for name in ("q_nb", "vel", "pos")))
    gnss = Gnss(t[fix], every["gps_vel"][fix], every["gps_pos"][fix])
    rows = (every[name].reshape(-1, 3) for name in ("dtheta", "dvel"))
    return Recording("flown", 20.0, 0.0, *rows, Site(*truth.pos[0]), gnss, None, truth)


FIXES = {"vel_std_mps": 0.05, "pos_std_m": 1.0, "rate_hz": 1.0}


def test_a_smoothed_solution_is_that_of_the_smoother_and_nowhere_less_certain():
    given = {"imu": "navigation", "gps": FIXES, "coarse": 8.0, "outages_s": [(18.0, 24.0)]}
    plain, found = (sins_env.navigate(flown(), "inekf", smooth=smooth, **given) for smooth in (False, True))
    env = gymnasium.make(
        "SINS/Replay-v0",
        recording=flown(),
        mode="navigate",
        imu="navigation",
        coarse=8.0,
        gps={**FIXES, "outages_s": [[18.0, 24.0]]},
    )
    both = smooth_navigation(solvers.make("inekf"), env)
    track = both.smoothed
    assert_allclose(found.time, track.t, atol=1e-9)
    for one, other in zip((found.attitude, found.velocity, found.position), track.nav, strict=True):
        np.testing.assert_array_equal(one, other)
    np.testing.assert_array_equal(found.gyro_bias, track.gyro_bias)
    sigma = np.sqrt(np.diagonal(track.cov, axis1=-2, axis2=-1))
    assert_allclose(found.sigma_accel_bias, sigma[:, track.states["accel_bias"]])
    n = len(found.time)
    assert_allclose(plain.gyro_bias[-n:], both.filtered.gyro_bias, atol=1e-12)
    assert_allclose(plain.accel_bias[-n:], both.filtered.accel_bias, atol=1e-12)
    for name in ("sigma_position", "sigma_velocity", "sigma_attitude", "sigma_gyro_bias"):
        assert (getattr(found, name) <= getattr(plain, name)[-n:] * (1 + 1e-9)).all()
    error = found.replay.track.pos_error[0, -n:]
    truth = flown().reference.pos[-n:]
    off = np.stack(pymap3d.geodetic2enu(*_degrees(found.position), *_degrees(truth)), axis=-1)
    assert_allclose(error, off, atol=1e-5)
    assert np.sqrt(np.mean(error**2)) < 0.8 * np.sqrt(np.mean(plain.replay.track.pos_error[0, -n:] ** 2))


def test_the_recommended_solver_tells_the_biases():
    """The vertical accelerometer has a bias of one sigma, which the fixes show."""
    true = 100 * IMU_PRESETS["navigation"].accel_bias_ug
    imu = {"preset": "navigation", "accel_bias_ug": true}
    one = sins_env.navigate(flown(errors="fixed", imu=imu), imu=imu, gps=FIXES, **ENV)
    up, sigma = one.accel_bias[-1, 2] / UG, one.sigma_accel_bias[-1, 2] / UG
    assert abs(up - true) < 4 * sigma < 0.5 * true
    assert "heading" in repr(one)


def test_the_recommended_solver_has_settings_for_recordings_that_the_user_may_change(monkeypatch):
    given = []
    monkeypatch.setattr(navigating.replaying, "replay", lambda *a, settings, **more: given.append(settings) or 1 / 0)
    for solver, settings in ((None, None), ("gsf_imm", {"stillness": False}), ("ckf", None)):
        with pytest.raises(ZeroDivisionError):
            sins_env.navigate(bend(), solver, settings=settings)
    assert given == [zoo.RECORDED, {**zoo.RECORDED, "stillness": False}, None]


def _degrees(pos):
    return np.degrees(pos[:, 0]), np.degrees(pos[:, 1]), pos[:, 2]


def at_rest():
    """45 s at rest without errors."""
    w_ie = 7.292115e-5 * np.array([0.0, np.cos(0.53), np.sin(0.53)])
    rates = np.tile(w_ie / 20, (900, 1)), np.tile([0.0, 0.0, 9.79 / 20], (900, 1))
    return Recording("rest", 20.0, 0.0, *rates, made.SITE)


def test_align_tells_how_it_converged(cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    one = sins_env.navigate(at_rest(), Converges, mode="align", **ENV)
    lines = aligning.course(one)
    assert [line["after_s"] for line in lines] == pytest.approx([10, 20, 40, 45])
    assert lines[1] == pytest.approx(
        {"after_s": 20, "heading_deg": 350, "pitch_deg": 1, "roll_deg": -2}
        | {"sigma_heading_deg": 5.0, "sigma_pitch_deg": 0.5, "sigma_roll_deg": 0.5},
        rel=5e-3,
    )
    assert one.summary()["latitude_deg"] == pytest.approx(np.degrees(0.53))
    assert one.summary()["velocity_enu_mps"] == [None] * 3
    recordings.save(at_rest(), tmp_path / "rest.npz")
    code, out, err = cli("align", "rest.npz", "--solver", "kf", "--coarse", 10, "--out", "a.csv")
    assert (code, err) == (0, ["solution: a.csv"])
    assert [line.split()[0] for line in out.split("how it converged")[1].splitlines()[4:-1]] == ["10", "20", "40", "45"]


class Converges:
    """Knows the angles; its sigma is 100 deg over the seconds, and for pitch and roll a tenth of that."""

    batched = False

    def reset(self, task, rng, num_runs=1):
        pass

    def step(self, obs):
        self.t = float(obs["t"][0])
        return attitude.from_euler(np.radians(350.0), np.radians(1.0), np.radians(-2.0))

    def covariance(self):
        return np.diag(np.radians([10.0 / self.t, 10.0 / self.t, 100.0 / self.t])) ** 2


@pytest.mark.parametrize("width", [40, 60, 80, 100, 160])
def test_a_wide_table_is_never_cut(width):
    table = titled("angles at the end of each window")
    table.add_column("window, s", no_wrap=True)
    cells = ["0.05 to 136.35", "2.017", "-1.633", "0.328", "-0.28403", "-0.01134", "-0.00838", "0.036  0.027"]
    for name in ("heading", "pitch", "roll", "heading error", "pitch error", "roll error", "velocity, m/s"):
        table.add_column(f"{name}, deg", justify="right")
    table.add_row(*cells)
    console = Console(width=width, color_system=None)
    with console.capture() as caught:
        for part in whole(table, console.width):
            console.print(part)
    text = caught.get()
    assert "…" not in text
    assert all(cell in text for cell in cells)
    assert max(map(len, text.splitlines())) <= console.width
    assert text.count(cells[0]) == len(whole(table, console.width)) > (width < 90)
