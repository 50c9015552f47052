"""Coarse and fine alignment of a real car that was disturbed; without the recording these tests are skipped."""

import gymnasium
import numpy as np
import pytest

import sins_env  # noqa: F401
import solvers

CAR = pytest.mark.parametrize("recorded", ["rlg_parked_car.npz"], indirect=True)


def windows(recording, seconds, coarse, stride, solver, settings, **more):
    """phi (windows, 3) deg at the end of every window of the parked car."""
    kwargs = {"recording": recording, "window": (0.0, seconds), "stride": stride, "coarse": coarse, **more}
    num = int((1230 - seconds) // stride) + 1
    env = gymnasium.make_vec("SINS/Replay-v0", num_envs=num, **kwargs)
    obs, _ = env.reset(options={"window": list(range(num))})
    estimator = solvers.make(solver, **settings)
    estimator.reset(env.unwrapped.task, [np.random.default_rng(i) for i in range(num)], num)
    over = False
    while not over:
        obs, _, _, done, info = env.step(estimator.step(obs))
        over = done[0]
    return np.degrees(info["errors"]["phi"])


def rms(x):
    return np.sqrt(np.mean(x**2))


@CAR
@pytest.mark.parametrize(
    ("solver", "settings", "seconds", "limit", "worst"),
    [
        ("coarse_inertial", {"method": "svd"}, 90.0, 0.15, 0.35),  # measured 0.122, 0.325
        ("coarse_inertial", {"method": "svd"}, 300.0, 0.05, 0.06),  # 0.017, 0.044
        ("coarse_inertial", {"method": "two_vector"}, 90.0, 0.30, 0.60),  # 0.216, 0.464
        ("coarse_oba", {}, 90.0, 0.07, 0.15),  # 0.040, 0.124: zero-velocity windows
        ("coarse_oba", {}, 300.0, 0.03, 0.05),  # 0.014, 0.035
    ],
)
def test_heading_in_the_inertial_frame(recorded, solver, settings, seconds, limit, worst):
    """All windows that begin at a multiple of 30 s, against the reference; deg."""
    heading = windows(recorded, seconds, seconds - 0.1, 30.0, solver, settings)[:, 2]
    assert len(heading) == {90.0: 39, 300.0: 32}[seconds]
    assert rms(heading) < limit
    assert np.abs(heading).max() < worst


@CAR
@pytest.mark.parametrize("form", [1, 2, 3])
def test_averages_are_off_by_degrees_where_the_car_was_disturbed(recorded, form):
    """Windows of 90 s, one after the other: heavy sway up to 300 s, at rest from 550 s to 980 s (../shared/data/README.md)."""
    heading = windows(recorded, 90.0, 89.9, 90.0, f"coarse_analytic{form}", {})[:, 2]
    assert np.abs(heading[:3]).min() > 5.0
    assert np.abs(heading[7:10]).max() < 0.5  # from 630 s to 900 s


@CAR
@pytest.mark.parametrize(("method", "solver"), [("svd", "kf"), ("aided", "ekf"), ("svd", "ckf"), ("aided", "ckf")])
def test_fine_heading(recorded, solver, method):
    """90 s coarse, 210 s fine with zero-velocity updates at 5 Hz, from every 150 s."""
    phi = windows(recorded, 300.0, 90.0, 150.0, solver, {"coarse": method}, epoch=0.2)
    assert np.abs(phi[:, 2]).max() < 0.1  # measured 0.037
    assert np.abs(phi[:, :2]).max() < 0.01
