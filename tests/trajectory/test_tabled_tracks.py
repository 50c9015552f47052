"""A motion through a table: it meets the rows, its derivatives are exact, and the strapdown brings it back."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from trajectory.test_flight import flown, round_trip

from sins_env import attitude, earth
from sins_env.evaluation import get_task
from sins_env.evaluation.planning.compute import forecast
from sins_env.trajectory.track import ANGLES, METRES, TrackPlan, plan_of
from sins_env.units import DEG

WGS84 = earth.get("wgs84")


def car():
    """A row a second: 20 s at rest, corners in town, a halt, and at rest again in the end."""
    t = np.arange(0.0, 301.0)
    fine = np.arange(0.0, 300.01, 0.1)
    speed = np.interp(fine, [20, 30, 90, 100, 120, 125, 140, 200, 205], [0, 12, 12, 0, 0, 12, 12, 12, 0])
    course = np.interp(fine, [40, 50, 150, 160, 170, 180], [0.5, 1.8, 1.8, 0.2, 0.2, -1.4])
    speed, course = gaussian_filter1d(speed, 15), gaussian_filter1d(course, 15)
    east, north = (np.cumsum(speed * part)[::10] * 0.1 for part in (np.sin(course), np.cos(course)))
    return {"t": t, "east_m": east, "north_m": north, "up_m": np.zeros(len(t))}


def aircraft():
    """A row every two seconds: an S-turn that climbs and descends."""
    t = np.arange(0.0, 301.0, 2.0)
    course = 0.7 * np.sin(np.arange(0, 300.01, 0.1) / 25)
    east, north = (np.cumsum(8.0 * part)[::20] for part in (np.sin(course), np.cos(course)))
    return {"t": t, "east_m": east, "north_m": north, "up_m": 500 + 100 * np.sin(t / 60)}


def ship():
    """Two rows a second, with the attitude."""
    t = np.arange(0.0, 300.1, 0.5)
    course = 0.5 + 0.3 * np.sin(t / 40)
    waves = {"heading_deg": (1.5, 10.3), "pitch_deg": (2.0, 6.7), "roll_deg": (6.0, 8.9), "up_m": (0.4, 7.3)}
    swing = {name: a * np.sin(2 * np.pi * t / period) for name, (a, period) in waves.items()}
    swing["heading_deg"] = swing["heading_deg"] + np.degrees(course) + 360.0 * (t > 100)  # a jump that is none
    return {"t": t, "east_m": np.cumsum(3 * np.sin(course)), "north_m": np.cumsum(3 * np.cos(course)), **swing}


TABLES = {"car": (car(), "level"), "aircraft": (aircraft(), "coordinated"), "ship": (ship(), "coordinated")}
PLANS = {name: TrackPlan.of({"track": table, "bank": bank}) for name, (table, bank) in TABLES.items()}


def test_round_trips():
    """Issue 23: 0.1 m and 0.1 arcsec over 300 s with increments at 100 Hz."""
    worst = round_trip(list(PLANS.values()), n_sub=10)
    assert (worst[:, 0] < 0.1).all()
    assert (worst[:, 1] < 1e-3).all()
    assert (worst[:, 2] < 0.1).all()


@pytest.mark.parametrize("name", TABLES)
def test_the_motion_meets_the_table(name):
    table, plan = TABLES[name][0], PLANS[name]
    _, _, _, state, _ = flown(plan, n_sub=2)
    k = np.round(table["t"][1:] / 0.1).astype(int) - 1
    R_M, R_N = earth.radii(WGS84, 39.96 * DEG)  # at the origin
    off = (state.pos[k] - np.array([39.96 * DEG, 116.3 * DEG, 0.0])) * [R_M, R_N * np.cos(39.96 * DEG), 1.0]
    np.testing.assert_allclose(off[:, [1, 0, 2]], np.stack([table[name][1:] for name in METRES], -1), atol=1e-4)
    if name == "ship":
        angles = np.degrees(attitude.to_euler(attitude.to_dcm(state.q_nb[k])))
        given = np.stack([table[name][1:] for name in ANGLES])
        np.testing.assert_allclose((np.array(angles) - given + 180) % 360 - 180, 0, atol=1e-9)
        assert np.abs(plan.kinematics(np.linspace(95, 105, 99), np.zeros(1, dtype=int)).rates).max() < 0.1


@pytest.mark.parametrize("name", TABLES)
def test_velocity_acceleration_and_rates_are_derivatives(name):
    plan, h = PLANS[name], 1e-3
    t = np.linspace(1.0, 299.0, 200)
    before, now, after = (plan.kinematics(t + d, np.zeros(1, dtype=int)) for d in (-h, 0.0, h))
    np.testing.assert_allclose((after.vel - before.vel) / (2 * h), now.accel, atol=2e-5)
    np.testing.assert_allclose((after.angles - before.angles) / (2 * h), now.rates, atol=2e-5)
    latitude, longitude, height = ((plan.path.place(t + h) - plan.path.place(t - h)) / (2 * h)).T
    at = plan.path.place(t)
    R_M, R_N = earth.radii(WGS84, at[:, 0])
    along = [(R_N + at[:, 2]) * np.cos(at[:, 0]) * longitude, (R_M + at[:, 2]) * latitude, height]
    np.testing.assert_allclose(np.stack(along, axis=-1), now.vel, atol=1e-4)


def test_an_attitude_that_is_not_given_follows_from_the_motion():
    """Course, climb, and a bank without a force to the side; a vehicle at rest keeps its heading, and corners are taken once."""
    now = PLANS["aircraft"].kinematics(np.linspace(5, 295, 200), np.zeros(1, dtype=int))
    heading, pitch, roll = now.angles.T
    np.testing.assert_allclose(heading, np.arctan2(now.vel[:, 0], now.vel[:, 1]), atol=1e-4)
    np.testing.assert_allclose(pitch, np.arcsin(now.vel[:, 2] / np.linalg.norm(now.vel, axis=1)), atol=1e-4)
    C = attitude.to_dcm(attitude.from_euler(heading, pitch, roll))
    force = (C.mT @ (now.accel + np.array([0, 0, 9.80]))[..., None])[..., 0]
    assert np.abs(now.accel[:, :2]).max() > 2.0
    assert np.abs(force[:, 0]).max() < 0.02
    at_rest = PLANS["car"].kinematics(np.array([0.0, 5.0, 15.0, 105.0, 115.0]), np.zeros(1, dtype=int)).angles
    np.testing.assert_allclose(at_rest[:3, 0], 0.5, atol=0.02)
    np.testing.assert_allclose(at_rest[3:, 0], 1.8, atol=0.02)
    np.testing.assert_array_equal(at_rest[:, 2], 0.0)
    assert 15 <= PLANS["car"].rest_s <= 20


def rows():
    """Seven rows over the date line, in degrees."""
    t = np.arange(7.0)
    return {"t": t + 100, "lat": 10 + 1e-4 * t, "Longitude": (179.9997 + 1e-4 * t + 180) % 360 - 180, "alt": 3 + 0 * t}


def test_files_and_dicts_are_one_track(tmp_path):
    table = rows()
    lines = [",".join(table), *(",".join(map(repr, row)) for row in np.stack(list(table.values()), -1).tolist())]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    np.savez(tmp_path / "a.npz", **table, other=np.zeros((3, 3)))
    (tmp_path / "a.yaml").write_text("track: a.csv\nbank: level\n")
    lists = {name: values.tolist() for name, values in table.items()}
    plans = [
        plan_of(given) for given in (tmp_path / "a.csv", tmp_path / "a.npz", {"track": lists}, str(tmp_path / "a.yaml"))
    ]
    t = np.linspace(0, 6, 50)
    for plan in plans:
        assert plan.duration_s == 6.0
        np.testing.assert_allclose(
            plan.kinematics(t, np.zeros(1, dtype=int)).vel, plans[0].kinematics(t, np.zeros(1, dtype=int)).vel
        )
    assert 10.9 < plans[0].kinematics(t, np.zeros(1, dtype=int)).vel[:, 0].min() < 11.0


def test_noisy_places_are_smoothed():
    """Places of 1 m: acceleration without smoothing is that of the noise."""
    table = aircraft()
    noisy = {**table, **{name: table[name] + np.random.default_rng(0).normal(size=len(table["t"])) for name in METRES}}
    t, zero = np.linspace(20, 280, 300), np.zeros(1, dtype=int)
    true, raw, smooth = (
        TrackPlan.of({"track": one, **more}).kinematics(t, zero).accel
        for one, more in ((table, {}), (noisy, {}), (noisy, {"smooth_m": 1.0}))
    )
    assert np.std(smooth - true) < 0.2 < 0.5 < np.std(raw - true)


@pytest.mark.parametrize(
    ("change", "said"),
    [({"t": None}, "no column t among"), ({"lat": [10.0] * 6}, "as many of each"), ({"t": [0, 1, 2]}, "as many"),
     ({"t": [0, 1, 1, 2, 3, 4, 5]}, "row 3: t = 1 s"), ({"lat": [10.0] * 6 + [np.nan]}, "numbers"),
     ({"lat": [10.0] * 6 + [95.0]}, "row 7: latitude 95"), ({"pitch": [0.0] * 6 + [88]}, "row 7: pitch 88"),
     ({"lat": [10.0, 11, 12, 13, 14, 15, 16]}, "rows 6 and 7, 5 to 6 s: a speed"),
     ({"time": [0] * 7}, "a second t"), ({"lat": None}, "no column latitude_deg")],
)  # fmt: skip
def test_refused_tables(change, said):
    table = {name: value for name, value in {**rows(), **change}.items() if value is not None}
    with pytest.raises(ValueError, match=said):
        TrackPlan.of({"track": table})


@pytest.mark.parametrize(
    ("given", "said"),
    [({"track": 3}, "path of a CSV"), ({"track": rows(), "banks": "level"}, "did you mean 'bank'"),
     ({"track": rows(), "bank": "flat"}, "unknown bank"), ({"track": rows(), "smooth_m": -1}, "smooth_m"),
     ({"track": {n: v[:5] for n, v in rows().items()}}, "5 rows; allowed: 6 to"), ("a.csw", "unknown profile")],
)  # fmt: skip
def test_refused_tracks(given, said):
    with pytest.raises(ValueError, match=said):
        gymnasium.make("SINS/NavFlight-v0", profile=given)


def test_a_file_at_fault_is_named(tmp_path):
    (tmp_path / "a.csv").write_text(
        "t,lat,lon,h\n" + "\n".join(f"{i},10,20,{'nan' if i == 4 else 0}" for i in range(8))
    )
    with pytest.raises(ValueError, match=r"a\.csv.*(line 6|row 5)"):
        TrackPlan.of(tmp_path / "a.csv")
    for name, bad in {
        "c": np.arange(8) * 1j,
        "d": np.array(["a"] * 8),
        "e": np.arange(8) * 1e-9,
        "f": np.arange(8) * 1e9,
    }.items():
        np.savez(tmp_path / f"{name}.npz", t=bad, lat=np.ones(8), lon=np.ones(8), h=np.ones(8))
        with pytest.raises(
            ValueError, match=rf"{name}\.npz: (t holds values of type|row 2: t = 1e-09 s|7e\+09 s from)"
        ):
            TrackPlan.of(tmp_path / f"{name}.npz")
    (tmp_path / "b.csv").write_text("\n".join(f"{i},10,20,0" for i in range(8)))
    with pytest.raises(ValueError, match=r"b\.csv: no header"):
        TrackPlan.of(tmp_path / "b.csv")


def test_places_count_more_than_metres_beside_them():
    """Metres have an origin that the table does not tell; it may be given only if there are no places."""
    n = np.arange(8.0)
    places = {"t": n, "lat": 50 + 1e-5 * n, "lon": 8 + 1e-5 * n, "height": 0 * n}
    plan = plan_of({"track": {**places, "east": n, "north": n, "up": n}})
    assert (plan.latitude_deg, plan.longitude_deg) == pytest.approx((50, 8))
    with pytest.raises(
        ValueError, match=r"latitude_deg = 10; allowed: for a table of metres; this one has latitude_deg"
    ):
        plan_of({"track": places, "latitude_deg": 10})


def test_an_environment_and_a_bound_on_a_track():
    """The world's fixes and the bound are those of the track."""
    table = {name: values.tolist() for name, values in TABLES["aircraft"][0].items()}
    kwargs = {"profile": {"track": table}, "duration": 30.0, "gps": {"vel_std_mps": 1e-6, "pos_std_m": 1e-6}}
    env = gymnasium.make("SINS/NavFlight-v0", **kwargs).unwrapped
    obs, _ = env.reset(seed=0)
    for _ in range(19):
        obs, *_ = env.step(np.r_[1.0, np.zeros(9)])
    vel = PLANS["aircraft"].kinematics(np.array([2.0]), np.zeros(1, dtype=int)).vel[0]
    np.testing.assert_allclose(obs["gps_vel"], vel, atol=1e-4)
    task = dataclasses.replace(get_task("flight-sun2012-v0"), name="track-v0", kwargs=kwargs)
    assert forecast(task, budget=False).final("azimuth") < 1 * DEG
