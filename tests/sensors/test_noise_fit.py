"""Noise fitted to data, against noise that plain sums and a Fourier series make."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import lfilter

from sins_env import earth, recordings
from sins_env.reading.datasheets import read_sensor, to_kalibr
from sins_env.recordings import Recording
from sins_env.sensors.allan import allan_deviation
from sins_env.sensors.noise_fit import MOST_MISFIT, fit_markov, fit_noise, terms
from sins_env.specs import IMU_PRESETS, ImuSpec, imu_spec
from sins_env.types import Site

DT = 0.1


def noise(rng, count, axes, Q=0.0, N=0.0, B=0.0, K=0.0):
    """Increments (count, axes): white angles, a white rate, a rate with spectrum B^2 / (2 pi f), a rate that walks."""
    rate = N / np.sqrt(DT) * rng.standard_normal((count, axes))
    rate += np.diff(Q * rng.standard_normal((count + 1, axes)), axis=0) / DT
    rate += K * np.sqrt(DT) * np.cumsum(rng.standard_normal((count, axes)), axis=0)
    if B:
        long = 4 * count
        f = np.fft.rfftfreq(long, DT)[1:]
        size = np.sqrt(B**2 / (2 * np.pi * f) * long / DT / 2)[:, None]
        line = size * (rng.standard_normal((len(f), axes)) + 1j * rng.standard_normal((len(f), axes)))
        rate += np.fft.irfft(np.vstack([np.zeros((1, axes)), line]), long, axis=0)[:count]
    return rate * DT


@pytest.mark.parametrize(("name", "column"), [("Q", 0), ("N", 1), ("B", 2), ("K", 3)])
def test_each_kind_of_noise_has_its_allan_variance(name, column):
    """At 0.8 to 12.8 s; the mean over 300 sensors has a standard error of some per cent."""
    tau = 0.8 * 2.0 ** np.arange(5)
    increments = noise(np.random.default_rng(4), 1024, 300, **{name: 1.0})
    v = allan_deviation(increments, DT, tau).adev ** 2
    error = v.std(axis=1) / np.sqrt(300)
    z = (v.mean(axis=1) - terms(tau)[:, column]) / error
    tolerance = 0.04 * terms(tau)[:, column] / error if name in "BK" else 0.0  # sums stand for integrals
    assert np.all(np.abs(z) < 4 + tolerance)


def test_intervals_hold_the_truth():
    """80 sensors of every kind at once. 95 % of 80 are 76 with a standard error of 2."""
    truth = np.array([0.05, 1.0, 0.25, 0.02])
    fit = fit_noise(noise(np.random.default_rng(5), 8192, 80, *truth), DT)
    held = ((fit.low <= truth) & (truth <= fit.high)).sum(axis=0)
    assert np.all(held >= 70)
    assert np.all(fit.low <= fit.coefficients)
    assert np.all(fit.coefficients <= fit.high)
    off = (fit.coefficients[:, 1] - 1.0).mean() / (fit.coefficients[:, 1].std() / np.sqrt(80))
    assert abs(off) < 4
    assert np.median(fit.high[:, 1] - fit.low[:, 1]) < 0.08  # N is known to 2 %, and no interval is idle
    assert fit.misfit.max() < MOST_MISFIT
    assert 0.7 < np.median(fit.misfit) < 1.3


def test_what_is_not_there_is_not_found():
    fit = fit_noise(noise(np.random.default_rng(6), 8192, 20, N=1.0), DT)
    assert (fit.low[:, [0, 2, 3]] == 0.0).mean() > 0.95
    assert np.median(fit.high[:, 3]) < 0.05
    shared = fit_markov(fit)
    assert shared.sigma == 0.0
    assert shared.white == pytest.approx(1.0, abs=0.005)


def test_a_gauss_markov_bias_comes_back():
    """Thirty sensors share a bias of 0.5 with 20 s."""
    rng = np.random.default_rng(7)
    a = np.exp(-DT / 20.0)
    drive = 0.5 * np.sqrt(1 - a * a) * rng.standard_normal((16384, 30))
    x = lfilter([1.0], [1.0, -a], drive, axis=0)
    found = fit_markov(fit_noise(x * DT + noise(rng, len(x), 30, N=1.0, Q=0.1), DT))
    assert found.sigma == pytest.approx(0.5, rel=0.06)
    assert found.time_constant_s == pytest.approx(20.0, rel=0.15)
    assert found.white == pytest.approx(1.0, rel=0.02)
    assert found.pulse == pytest.approx(0.1 * np.sqrt(12), rel=0.1)


def test_a_vibration_is_no_noise_but_leaves_long_times_alone():
    t = np.arange(16384) * DT
    shaken = noise(np.random.default_rng(8), len(t), 3, N=1.0) + 0.3 * np.sin(2 * np.pi * 1.7 * t)[:, None]
    assert fit_noise(shaken, DT).misfit.min() > 50
    calm = fit_noise(shaken, DT, 6.4)
    assert calm.misfit.max() < MOST_MISFIT
    assert_allclose(calm.coefficients[:, 1], 1.0, atol=0.2)
    with pytest.raises(ValueError, match="5 averaging times; allowed: at least 6, from about 3277 s"):
        fit_noise(shaken, DT, 12.8)


def test_kalibr_and_back():
    own = {name: getattr(IMU_PRESETS["tactical"], name) for name in ImuSpec.__dataclass_fields__}
    theirs = to_kalibr(own)
    assert theirs["gyroscope_noise_density"] == pytest.approx(np.radians(0.1) / 60)
    assert theirs["gyroscope_random_walk"] == pytest.approx(np.radians(0.3 / 3600) * np.sqrt(2 / 600))
    assert theirs["accelerometer_noise_density"] == pytest.approx(100e-6 * 9.80665)
    assert theirs["accelerometer_random_walk"] == pytest.approx(50e-6 * 9.80665 * np.sqrt(2 / 600))


@pytest.fixture
def resting(tmp_path, monkeypatch):
    """Forty minutes at 10 Hz at 48.1 deg north: gyros of 0.2 deg/sqrt(h), a bias of 3 deg/h up, 200 ug/sqrt(Hz)."""
    monkeypatch.chdir(tmp_path)
    site, model, rng = Site(np.radians(48.1), 0.2, 500.0), earth.get("wgs84"), np.random.default_rng(9)
    w = earth.rate_n(model, site.latitude) + np.array([0, 0, np.radians(3 / 3600)])
    dtheta = DT * w + noise(rng, 24000, 3, N=np.radians(0.2) / 60)
    dvel = DT * np.array([0, 0, float(earth.gravity(model, site.latitude, site.height))])
    dvel = dvel + noise(rng, 24000, 3, N=200e-6 * 9.80665)
    recordings.save(Recording("rest", 10.0, 50.0, dtheta, dvel, site), tmp_path / "rest.npz")
    shaken = dtheta + 2e-5 * np.sin(np.arange(24000))[:, None]
    recordings.save(Recording("shaken", 10.0, 50.0, shaken, dvel, site), tmp_path / "shaken.npz")


def test_the_verb(cli, resting, tmp_path):
    more = ("--out", "mine.json", "--kalibr", "imu.yaml", "--plot", "allan.png")
    code, out, err = cli("allan", "rest.npz", "--imu", "mems,gyro_bias_deg_h=0,accel_bias_ug=0", *more)
    assert code == 0
    assert not any("warning" in line for line in err)
    assert "rest, 50 to 2450 s at 10 Hz" in out
    found = json.loads((tmp_path / "mine.json").read_text())
    spec = imu_spec(found)
    assert spec.arw_deg_sqrt_h == pytest.approx(0.2, rel=0.02)
    assert spec.vrw_ug_sqrt_hz == pytest.approx(200.0, rel=0.02)
    assert spec.gyro_bias_deg_h == pytest.approx(3 / np.sqrt(2), rel=0.1)  # the one that shows, of two that could
    assert spec.scale_ppm == 1000.0  # that of mems
    assert imu_spec(read_sensor(tmp_path / "imu.yaml")).arw == pytest.approx(spec.arw)
    assert (tmp_path / "allan.png").stat().st_size > 30_000
    code, out, err = cli("allan", "shaken.npz", "--out", "shaken.yaml")
    assert code == 0
    assert err[0].startswith("warning: the gyros are not at rest")
    assert "--from" in err[0]
    assert "warning" in (tmp_path / "shaken.yaml").read_text()


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (("--window", 50, 20), "a window of 20 s; allowed: at least 60 s"),
        (("--window", 2400, 100), "allowed: within 50 to 2450 s"),
        (("--from", 100), "allowed: at least 6"),
        (("--out", "mine.txt"), "allowed: a file that ends in .json, .yaml"),
        (("--imu", "mesm"), "did you mean 'mems'"),
    ],
)
def test_wrong_use(cli, resting, arguments, part):
    code, out, err = cli("allan", "rest.npz", *arguments)
    assert (code, out, len(err)) == (2, "", 1)
    assert part in err[0]
