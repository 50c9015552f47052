"""Aiding sensors in a world: their readings against own formulas, their fields, and that they leave each other alone."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import sins_env  # noqa: F401
from sins_env import attitude, earth
from sins_env.checks import classes
from sins_env.sensors.aids import Sensor, specs

#: At 15 m/s through turns of 12 deg/s, from the first second on.
SEGMENTS = [[1, 1], [2, 0, 1, 0, 0, 12], [17, 0, 0, 0, 12]]
TURNS = {"latitude_deg": 34.0, "longitude_deg": 108.0, "height_m": 50.0, "speed_mps": 15.0, "segments": SEGMENTS}
FLIGHT = {"id": "SINS/NavFlight-v0", "profile": TURNS}
ALL = {name: {} for name in classes("sins_env.sensors", Sensor)}
QUIET = {
    "odometer": {"noise_mps": 0.0, "scale_ppm": 0.0, "mounting_mrad": 0.0, "lever_arm_m": [0.5, -1.0, 0.3]},
    "dvl": {"noise_mps": 0.0, "scale_ppm": 0.0, "mounting_mrad": 0.0, "lever_arm_m": [0.5, -1.0, 0.3]},
    "heading": {"noise_m": 0.0, "mounting_deg": 0.0, "baseline_m": [0.2, 1.0, 0.1]},
    "magnetometer": {"noise_ut": 0.0, "hard_iron_ut": 0.0, "declination_deg": 0.0, "field_ut": [-2.0, 30.0, -40.0]},
    "height": {"noise_m": 0.0, "bias_m": 0.0},
    "depth": {"noise_m": 0.0, "bias_m": 0.0},
}


def play(aids, epochs=20, runs=3, **more):
    """Observations and true states of the first epochs, (epochs, runs, ...) by name."""
    env = gymnasium.make_vec(num_envs=runs, reveal_truth=True, aids=aids, **{**FLIGHT, **more})
    obs, info = env.reset(seed=4)
    seen, truth, action = [obs], [info["truth"]], np.zeros((runs, 10))
    for _ in range(epochs - 1):
        obs, _, _, _, info = env.step(action)
        seen.append(obs)
        truth.append(info["truth"])
    truth.append(env.step(action)[4]["truth"])
    stack = lambda parts: {name: np.stack([part[name] for part in parts]) for name in parts[0] if name[0] != "_"}  # noqa: E731
    return stack(seen), stack(truth), env


def test_readings_without_errors():
    """From the true states alone, with rotations and rates by differences of attitudes; the reading of an odometer is a mean."""
    obs, truth, env = play(QUIET, epochs=80, runs=1)
    C, (vel, pos) = attitude.to_dcm(truth["q_nb"]), (truth[name] for name in ("vel", "pos"))
    T, model = env.unwrapped.task.epoch_s, earth.get("wgs84")
    through = np.einsum("...ji,...j", C, vel)
    turned = C[:-1].mT @ C[1:]  # by the rate over the epoch, in n as good as at rest
    rate = np.stack([turned[..., 2, 1], turned[..., 0, 2], turned[..., 1, 0]], axis=-1) / T
    transport = np.matmul(earth.transport_matrix(model, pos[:-1, :, 0]), vel[:-1, ..., None])[..., 0]
    arm = np.cross(rate + np.einsum("...ji,...j", C[:-1], transport), [0.5, -1.0, 0.3])
    middle = 0.5 * (through[1:] + through[:-1]) + arm
    np.testing.assert_allclose(obs["odometer"][..., 0] / T, middle[..., 1], atol=2e-3)
    late = 0.5 * (arm[1:] + arm[:-1])  # at the end of an epoch
    still = slice(35, None)  # the rates of this flight jump before
    np.testing.assert_allclose(obs["dvl"][:-1][still], (through[1:-1] + late)[still], atol=1e-3)
    np.testing.assert_allclose(obs["heading"], C[1:] @ [0.2, 1.0, 0.1], atol=1e-12)
    np.testing.assert_allclose(obs["magnetometer"] * 1e6, C[1:].mT @ [-2.0, 30.0, -40.0], atol=1e-9)
    np.testing.assert_allclose(obs["height"][..., 0], pos[1:, :, 2], atol=1e-9)
    np.testing.assert_array_equal(obs["depth"], -obs["height"])
    assert np.ptp(C[:, 0, 1, 1]) > 0.3  # it did turn


def test_ranges_are_distances_in_ecef_and_their_derivatives():
    """With places by the textbook formula, rates by differences of ranges, and orbits by differences of places."""
    quiet = {"range_m": 1e-4, "rate_mps": 1e-4, "clock_m": 0.0, "clock_mps": 0.0, "clock_h0": 0.0, "clock_h2": 0.0}
    receiver = {**quiet, "satellites": 8, "mask_deg": 0.0, "few_s": [[1.0, 1.5]], "few": 2}
    obs, truth, _ = play({"ranges": receiver}, epochs=30, runs=1, epoch=0.05, n_sub=1)
    model, (L, l, h) = earth.get("wgs84"), np.moveaxis(truth["pos"][1:, 0], -1, 0)
    across = model.a / np.sqrt(1.0 - model.e2 * np.sin(L) ** 2)
    out, up = (across + h) * np.cos(L), (across * (1.0 - model.e2) + h) * np.sin(L)
    place = np.stack([out * np.cos(l), out * np.sin(l), up], axis=-1)
    sats, seen, rates = (obs[name][:, 0] for name in ("satellites", "ranges", "range_rates"))
    full = slice(0, 20)
    away = sats[full, :, :3] - place[full, None]
    np.testing.assert_allclose(seen[full], np.linalg.norm(away, axis=-1), atol=0.03)  # 1e-4 m by the sine of 5 deg
    middle = 0.5 * (rates[1:] + rates[:-1])[:19]
    np.testing.assert_allclose(np.diff(np.linalg.norm(away, axis=-1), axis=0) / 0.05, middle, atol=0.02)
    np.testing.assert_allclose(np.linalg.norm(sats[full, :, :3], axis=-1), 26_560e3, rtol=1e-12)
    speed = 0.5 * (sats[1:, :, 3:] + sats[:-1, :, 3:])[:19]
    np.testing.assert_allclose(np.diff(sats[full, :, :3], axis=0) / 0.05, speed, atol=1e-3)
    valid = obs["ranges_valid"][:, 0]
    assert valid[full].all()
    np.testing.assert_array_equal(valid[20:], np.broadcast_to(np.arange(8) < 2, (10, 8)))
    assert not seen[20:, 2:].any()


def test_the_clock_of_a_receiver_wanders_as_its_spec_says():
    """Variances of clock and rate after a second, over 400 runs, within four standard errors."""
    quiet = {"range_m": 1e-4, "rate_mps": 1e-4, "satellites": 1, "mask_deg": 0.0, "clock_m": 0.0, "clock_mps": 0.0}
    rows = []
    for clock in ({}, {"clock_h0": 0.0, "clock_h2": 0.0}):
        obs, *_ = play({"ranges": {**quiet, **clock}}, epochs=10, runs=400, duration=1.0, imu="perfect")
        rows.append(np.stack([obs["ranges"][-1, :, 0], obs["range_rates"][-1, :, 0]], axis=-1))
    expected = specs({"ranges": {}})[0].clock_noise(1.0)
    found = np.cov((rows[0] - rows[1]).T)
    np.testing.assert_allclose(np.diag(found), np.diag(expected), rtol=4 * np.sqrt(2 / 400))


def test_the_car_keeps_to_its_constraint_in_axes_that_the_imu_does_not_have():
    obs, truth, _ = play({"odometer": {"mounting_mrad": 20.0, "noise_mps": 0.0, "scale_ppm": 0.0}})
    y = np.einsum("...ji,...j", attitude.to_dcm(truth["q_nb"]), truth["vel"])
    angles = y[1:, :, [0, 2]] / y[1:, :, 1:2]
    assert np.abs(angles[0]).max() > 1e-3
    np.testing.assert_allclose(angles, np.broadcast_to(angles[:1], angles.shape), atol=1e-6)
    speed = np.linalg.norm(y, axis=-1)
    np.testing.assert_allclose(obs["odometer"][..., 0] / 0.1, 0.5 * (speed[1:] + speed[:-1]), rtol=1e-6)


def test_a_sensor_changes_nothing_of_another():
    few, many = {"dvl": "water", "height": {}}, {**ALL, "dvl": "water", "odometer": {"mounting_mrad": 0.0}}
    alone, together, without = (play(aids)[0] for aids in (few, many, ()))
    fields = {f"{name}{mark}" for name in {*ALL} - {*few} for mark in ("", "_valid")}
    assert {*together} - {*alone} == fields | {"range_rates", "satellites"}
    for name, value in without.items():
        np.testing.assert_array_equal(value, alone[name])
    for name in set(alone) - {"dtheta", "dvel"}:  # whose last bit the turn by zero angles may change
        np.testing.assert_array_equal(alone[name], together[name])


def test_rates_outages_and_rows():
    """A row of the vector environment has the bits of the environment alone, whether there is a reading or not."""
    aids = {**ALL, "dvl": {"rate_hz": 5.0, "outages_s": [[0.5, 1.0]]}, "odometer": "abs-48"}
    obs, _, env = play(aids)
    valid = obs["dvl_valid"][:, 0, 0]
    np.testing.assert_array_equal(valid, [t % 2 == 0 and not 5 < t <= 10 for t in range(1, 21)])
    assert not obs["dvl"][valid == 0].any()
    assert obs["dvl"][valid == 1].all()
    pulses = obs["odometer"] / (1.95 / 48)
    np.testing.assert_allclose(pulses, np.round(pulses), atol=1e-9)
    assert [spec.outages_s for spec in env.unwrapped.task.aids] == [()] * len(aids)
    one = gymnasium.make(aids=aids, **FLIGHT)
    first, _ = one.reset(seed=6)
    for name, value in first.items():
        np.testing.assert_array_equal(value, obs[name][0, 2])


def difference(name, fault, plain, **more):
    """Readings of a sensor with a fault, those without it, and the task; what is not the sensor's has the same bits."""
    (obs, truth, env), (before, *_) = (play({name: {**plain, **given}}, **more) for given in (fault, {}))
    for field in set(obs) - {name, f"{name}_valid"}:
        np.testing.assert_array_equal(obs[field], before[field])
    (told,), (without,) = env.unwrapped.task.aids, specs({name: {}})
    assert [getattr(told, field) for field in told.faults] == [getattr(without, field) for field in told.faults]
    return obs, before, truth


def test_a_wheel_that_slips_rolls_more_than_the_way():
    """By the stated share in an interval, and by one of the acceleration; a speed is differenced from true states."""
    plain = {"noise_mps": 0.0}
    obs, before, _ = difference("odometer", {"slip": -0.25, "slip_s": [[0.5, 1.0]]}, plain)
    share = np.where((np.arange(1, 21) > 5) & (np.arange(1, 21) <= 10), 0.75, 1.0)
    np.testing.assert_allclose(obs["odometer"] / before["odometer"], np.broadcast_to(share[:, None, None], (20, 3, 1)))
    rates = {"profile": {**TURNS, "segments": [[1, 2], [1, -3]]}}
    obs, before, truth = difference("odometer", {"slip_per_mps2": 0.01}, plain, **rates)
    speed = np.linalg.norm(truth["vel"], axis=-1)
    gained = np.diff(speed, axis=0)[..., None] / 0.1
    assert gained.min() < -2.5
    np.testing.assert_allclose(obs["odometer"] / before["odometer"] - 1.0, 0.01 * gained, atol=1e-5)


def test_tyres_slip_sideways_by_the_acceleration_of_a_turn():
    """The velocity across is -kappa a_right v, the increments lead to the true attitude, and the path is as without slip."""
    settings = {"noise_mps": 0.0, "scale_ppm": 0.0, "mounting_mrad": 0.0}
    more = {"epochs": 60, "runs": 1, "imu": "perfect", "n_sub": 10}
    slips = {"odometer": {**settings, "slip_mrad_per_mps2": 30.0}}
    fixes = {"vel_std_mps": 0.0, "pos_std_m": 0.0, "rate_hz": 10.0, "age_s": 0.05}
    obs, truth, env = play(slips, gps={**fixes, "lever_arm_m": [0.0, 200.0, 0.0]}, **more)
    plain, before, _ = play({}, gps=fixes, **more)
    for name in ("vel", "pos"):
        np.testing.assert_array_equal(truth[name], before[name])
    C, vel = attitude.to_dcm(truth["q_nb"][:, 0]), truth["vel"][:, 0]
    y = np.einsum("...ji,...j", C, vel)
    course = np.unwrap(np.arctan2(vel[:, 0], vel[:, 1]))  # to the right
    to_right = 0.5 * np.linalg.norm(vel, axis=-1)[1:-1] * (course[2:] - course[:-2]) / 0.1
    assert np.abs(to_right).max() > 2.0
    steady = np.abs(to_right[:-1] - to_right[1:]) < 0.02  # the rates of this flight jump
    np.testing.assert_allclose(y[1:-1, 0] / y[1:-1, 1], -np.tan(0.03 * to_right), atol=6e-3)
    np.testing.assert_allclose((y[1:-1, 0] / y[1:-1, 1])[1:][steady], -np.tan(0.03 * to_right)[1:][steady], atol=5e-4)
    middle = 0.5 * (y[1:, 1] + y[:-1, 1])
    np.testing.assert_allclose(obs["odometer"][:, 0, 0] / 0.1, middle, atol=1e-9)
    ie = earth.rate_n(earth.get("wgs84"), env.unwrapped.task.site.latitude)
    turn = lambda rotvec: attitude.to_dcm(attitude.from_rotvec(rotvec))  # noqa: E731
    R_M, R_N = earth.radii(earth.get("wgs84"), np.radians(34.0))
    per_rad, at_fix = [R_M + 50.0, (R_N + 50.0) * np.cos(np.radians(34.0)), 1.0], C[0]
    for k in range(60):
        pushed = []
        for seen, true in ((plain, before), (obs, truth)):
            made, push = attitude.to_dcm(true["q_nb"][k, 0]), np.zeros(3)
            for i, (step, gain) in enumerate(zip(seen["dtheta"][k, 0], seen["dvel"][k, 0], strict=True)):
                at_fix = made if i == 5 else at_fix  # fixes are made in the middle of an epoch
                push += made @ turn(0.5 * step) @ gain
                made = made @ turn(step - 0.01 * C[k].T @ ie)
            np.testing.assert_allclose(made, attitude.to_dcm(true["q_nb"][k + 1, 0]), atol=1e-5)
            pushed.append(push)
        np.testing.assert_allclose(*pushed, atol=2e-5)
        metres = per_rad * (obs["gps_pos"][k, 0] - plain["gps_pos"][k, 0])
        np.testing.assert_allclose(metres[[1, 0, 2]], at_fix @ [0.0, 200.0, 0.0], atol=0.1)
        rate = obs["dtheta"][k, 0, 4:6].mean(axis=0) / 0.01 - at_fix.T @ ie
        spun = at_fix @ np.cross(rate, [0.0, 200.0, 0.0])
        np.testing.assert_allclose(obs["gps_vel"][k, 0] - plain["gps_vel"][k, 0], spun, atol=0.3)


def test_a_log_without_lock_on_the_bottom():
    """Stated intervals have nothing, or the velocity through the water; drawn ones have the told means."""
    lost = {"lock_lost_s": [[0.5, 1.0]]}
    there = ~((np.arange(1, 21) > 5) & (np.arange(1, 21) <= 10))
    obs, before, _ = difference("dvl", lost, {})
    np.testing.assert_array_equal(obs["dvl_valid"], np.broadcast_to(there[:, None, None], (20, 3, 1)))
    np.testing.assert_array_equal(obs["dvl"], before["dvl"] * obs["dvl_valid"])
    quiet = {"noise_mps": 0.0, "scale_ppm": 0.0, "mounting_mrad": 0.0}
    water = {**lost, "without_lock": "water", "current_mps": 0.5, "current_s": 1e9}
    obs, before, truth = difference("dvl", water, quiet, runs=200, n_sub=1)
    np.testing.assert_array_equal(obs["dvl_valid"], 1)
    np.testing.assert_array_equal(obs["dvl"][there], before["dvl"][there])
    flow = np.einsum("...ij,...j", attitude.to_dcm(truth["q_nb"][1:]), before["dvl"] - obs["dvl"])[~there]
    np.testing.assert_allclose(flow, np.broadcast_to(flow[0], flow.shape), atol=1e-4)  # one current in each run
    np.testing.assert_allclose(flow[..., 2], 0.0, atol=1e-12)
    np.testing.assert_allclose(flow[0, :, :2].std(), 0.5, rtol=4 / np.sqrt(2 * 400))
    drawn = {"lock_lost_s": 0.5, "lock_held_s": 1.0}
    gone = difference("dvl", drawn, {}, epochs=100, runs=100, n_sub=1, duration=10.0)[0]["dvl_valid"][..., 0] == 0
    regained = ((~gone[1:]) & gone[:-1]).sum() / gone[:-1].sum()  # shares of epochs, of independent draws
    fell = (gone[1:] & ~gone[:-1]).sum() / (~gone[:-1]).sum()
    for found, mean, tries in ((regained, 0.5, gone[:-1].sum()), (fell, 1.0, (~gone[:-1]).sum())):
        p = 1.0 - np.exp(-0.1 / mean)
        assert abs(found - p) < 4 * np.sqrt(p * (1 - p) / tries)
    assert len({tuple(run) for run in gone.T}) > 90


@pytest.mark.filterwarnings("ignore:.*symmetric and normalized space.*:UserWarning")
def test_check_env():
    for env in (gymnasium.make("SINS/AlignSway-v0", duration=2.0, aids=ALL), gymnasium.make(aids=ALL, **FLIGHT)):
        check_env(env.unwrapped, skip_render_check=True)


@pytest.mark.parametrize(
    ("aids", "said"),
    [
        ({"odo": {}}, "unknown aid 'odo'; did you mean 'odometer'"),
        ({"dvl": "botom"}, "unknown dvl preset 'botom'; did you mean 'bottom'"),
        ({"dvl": {"noise": 1}}, "did you mean 'noise_mps'"),
        ({"dvl": {"rate_hz": 3.0}}, "dvl rate 3 Hz with epochs of 0.1 s"),
        ({"heading": {"baseline_m": [0, 0, 0]}}, "a vector of at least 0.01 m"),
        ("dvl", "aids = 'dvl'; allowed: a dict"),
        ({"dvl": {"track": "water", "lock_lost_s": 5}}, 'lock_lost_s = 5.0 with track = "water"; allowed: with track'),
        ({"dvl": {"lock_lost_s": [[2, 1]]}}, r"lock_lost_s = \[\[2, 1\]\]: interval"),
        ({"odometer": {"slip": -2, "slip_s": [[1, 2]]}}, "slip = -2; allowed: a share of the way, -1 to 10"),
    ],
)
def test_what_is_refused(aids, said):
    with pytest.raises(ValueError, match=said):
        gymnasium.make(aids=aids, **FLIGHT)


def test_presets():
    for cls in classes("sins_env.sensors", Sensor).values():
        for preset in cls.specification.presets:
            assert specs({cls.name: preset})[0].name == cls.name
