import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sins_env.cli.describe.figures import allan_figure, simulate_at_rest
from sins_env.recordings import load
from sins_env.sensors.allan import Allan, allan_deviation, expected_allan, gauss_markov, quantisation, white_noise
from sins_env.sensors.imu import GaussMarkov, Imu
from sins_env.specs import IMU_PRESETS, ImuSpec
from sins_env.units import ARCSEC, DEG_PER_H, UG

TAUS = np.array([0.01, 0.03, 0.1, 0.5, 2.0, 10.0, 60.0])


def at_rest(spec, runs, seconds, dt=0.01, seed=0):
    """Errors of gyros and accelerometers as independent records (3 runs, N, 1)."""
    imu = Imu(spec, dt)
    imu.reset([rng.spawn(6) for rng in np.random.default_rng(seed).spawn(runs)])
    still = np.zeros((runs, 1, round(seconds / dt), 3))
    return [np.moveaxis(x[:, 0], -1, 1).reshape(3 * runs, -1, 1) for x in imu.measure(still, still)]


def test_against_the_definition():
    """Differences of neighbouring averages of the rate, at every place they fit: by loops."""
    rng = np.random.default_rng(0)
    increments, dt = rng.standard_normal((2, 40, 3)), 0.5
    result = allan_deviation(increments, dt, np.array([0.5, 1.5, 5.0]))
    assert isinstance(result, Allan)
    assert result.adev.shape == result.standard_error.shape == (2, 3, 3)
    for i, m in enumerate((1, 3, 10)):
        rate = increments / dt
        means = np.stack([rate[:, k : k + m].mean(axis=1) for k in range(40 - m + 1)], axis=1)
        differences = means[:, m:] - means[:, :-m]
        assert_allclose(result.adev[:, i], np.sqrt(np.mean(differences**2, axis=1) / 2), rtol=1e-12)


def test_default_averaging_times():
    result = allan_deviation(np.ones((1000, 3)), 0.01)
    assert result.tau[0] == 0.01
    assert_allclose(result.tau[-1], 1.25)
    assert np.all(np.diff(result.tau) > 0)
    assert_allclose(result.adev, 0.0, atol=1e-10)  # a constant rate has none


def test_a_drifting_rate_has_its_slope():
    """rate = c t gives c tau / sqrt(2)."""
    t = np.arange(2001) * 0.01
    angle = 0.5 * 3.0 * t**2
    result = allan_deviation(np.diff(angle)[:, None], 0.01, np.array([0.1, 1.0]))
    assert_allclose(result.adev[:, 0], 3.0 * np.array([0.1, 1.0]) / np.sqrt(2), rtol=1e-9)


@pytest.mark.parametrize("walk", [False, True])
def test_the_standard_error_is_on_the_safe_side(walk):
    increments = np.random.default_rng(1).standard_normal((600, 1000, 1))
    if walk:
        increments = np.cumsum(increments, axis=1)
    result = allan_deviation(increments, 1.0, np.array([1, 4, 20, 100.0]))
    ratio = result.standard_error.mean(axis=0)[:, 0] / result.adev.std(axis=0)[:, 0]
    assert np.all(ratio > 0.9)
    assert np.all(ratio < 1.8)


@pytest.mark.parametrize("sensor", [0, 1], ids=["gyro", "accel"])
@pytest.mark.parametrize("name", sorted(IMU_PRESETS))
def test_every_preset_meets_its_datasheet(name, sensor):
    """Level at each averaging time and slope between neighbours, within 3 standard errors over 60 records."""
    spec = IMU_PRESETS[name]
    records = at_rest(spec, 20, 600.0)[sensor]
    measured = allan_deviation(records, 0.01, TAUS).adev[..., 0]
    expected = expected_allan(spec, TAUS)[sensor].total
    if name == "perfect":
        assert_array_equal(measured, 0.0)
        assert_array_equal(expected, 0.0)
        return
    error = np.std(measured**2, axis=0) / np.sqrt(len(measured))
    deviation = (np.mean(measured**2, axis=0) - expected**2) / error
    assert np.abs(deviation).max() < 3
    slopes = np.diff(np.log(measured), axis=1) / np.diff(np.log(TAUS))
    if not (spec.accel_lsb_mps and sensor == 1):  # there each record's slope hangs on its own bias: no mean slope
        slope_error = np.std(slopes, axis=0) / np.sqrt(len(slopes))
        bias_of_log = np.diff(-0.5 * np.var(measured, axis=0) / np.mean(measured, axis=0) ** 2)
        expected_slopes = (np.diff(np.log(expected)) + bias_of_log) / np.diff(np.log(TAUS))
        assert np.abs((slopes.mean(axis=0) - expected_slopes) / slope_error).max() < 3


@pytest.mark.parametrize("name", ["thesis-white", "navigation"])
def test_white_sensors_fall_with_the_square_root(name):
    gyro, accel = expected_allan(IMU_PRESETS[name], np.array([1.0, 100.0]))
    assert_allclose(gyro.total, IMU_PRESETS[name].arw_deg_sqrt_h * np.pi / 180 / 60 / np.array([1.0, 10.0]))
    assert_allclose(accel.total, IMU_PRESETS[name].vrw_ug_sqrt_hz * UG / np.array([1.0, 10.0]))


@pytest.mark.parametrize("name", ["thesis-markov", "tactical", "mems"])
def test_the_preset_with_a_markov_term_shows_it(name):
    """Without it, or with another correlation time, the simulation is out of the band."""
    spec = IMU_PRESETS[name]
    T = spec.gyro_markov_s
    dt = T / 40
    tau = np.array([0.5, 1.9, 6.0]) * T
    records = at_rest(spec, 60, 40 * T, dt)[0]
    measured = allan_deviation(records, dt, tau).adev[..., 0] ** 2
    error = measured.std(axis=0) / np.sqrt(len(measured))
    assert np.all(np.abs(measured.mean(axis=0) - expected_allan(spec, tau)[0].total ** 2) < 3 * error)
    assert np.any(np.abs(measured.mean(axis=0) - white_noise(spec.arw, tau) ** 2) > 6 * error)
    slow = white_noise(spec.arw, tau) ** 2 + gauss_markov(spec.gyro_markov_deg_h * DEG_PER_H, 2 * T, tau) ** 2
    assert np.any(np.abs(measured.mean(axis=0) - slow) > 3 * error)


def test_gauss_markov_closed_form_against_its_process():
    tau = np.array([0.2, 1.0, 2.0, 5.0, 20.0])
    process = GaussMarkov(1.5, 1.0, 0.02)
    process.reset(np.random.default_rng(0).spawn(100))
    records = np.moveaxis(process.samples(10000), -1, 1).reshape(300, -1, 1) * 0.02
    measured = allan_deviation(records, 0.02, tau).adev[..., 0] ** 2
    error = measured.std(axis=0) / np.sqrt(300)
    assert np.all(np.abs(measured.mean(axis=0) - gauss_markov(1.5, 1.0, tau) ** 2) < 3 * error)


def test_gauss_markov_closed_form_limits():
    x = np.array([1e-8, 1e-4, 0.00999, 0.01001, 1.0, 1.89, 1e6])
    value = gauss_markov(1.0, 1.0, x)
    assert_allclose(value[:2], np.sqrt(2 * x[:2] / 3), rtol=1e-4)  # short: rate random walk
    assert_allclose(value[2] / value[3], np.sqrt(0.00999 / 0.01001), rtol=1e-5)  # series meets closed form
    assert_allclose(value[-1], np.sqrt(2e-6), rtol=1e-5)  # long: white, N = sigma sqrt(2 T)
    assert_allclose(value[5], gauss_markov(1.0, 1.0, np.linspace(1.5, 2.5, 201)).max(), rtol=1e-5)


def test_pulses_of_a_moving_sensor():
    """The counter's convention: pulse / (2 tau), whatever the rate of samples."""
    spec = ImuSpec(gyro_lsb_arcsec=0.1)
    imu = Imu(spec, 0.01)
    imu.reset([rng.spawn(6) for rng in np.random.default_rng(0).spawn(10)])
    true = np.random.default_rng(1).uniform(-1, 1, (10, 1, 20000, 3)) * 1e-4  # 200 pulses
    error = (imu.measure(true, true)[0] - true)[:, 0]
    tau = np.array([0.01, 0.1, 1.0])
    measured = allan_deviation(error, 0.01, tau).adev ** 2
    standard_error = measured.std(axis=(0, 2)) / np.sqrt(30)
    assert np.all(np.abs(measured.mean(axis=(0, 2)) - (0.1 * ARCSEC / (2 * tau)) ** 2) < 3 * standard_error)
    assert_array_equal(expected_allan(spec, tau, moving=True)[0].total, quantisation(0.1 * ARCSEC, tau))


def test_pulses_at_rest_tend_to_those_of_a_moving_sensor():
    tau = np.array([0.01, 0.04, 10.0, 100.0])
    rest, moving = quantisation(1e-3, tau, (1e-3, 0.0)), quantisation(1e-3, tau)
    assert_allclose(rest[2:], moving[2:], rtol=2e-3)  # the harmonics left out
    assert np.all(rest[:2] < 0.9 * moving[:2])
    assert_array_equal(quantisation(0.0, tau), 0.0)


@pytest.mark.parametrize(
    ("count", "taus", "message"),
    [
        (8, None, "8 samples; allowed: at least 9"),
        (100, [0.51], "averaging time 0.51 s; allowed: up to half"),
    ],
)
def test_records_that_are_too_short(count, taus, message):
    with pytest.raises(ValueError, match=message):
        allan_deviation(np.zeros((count, 3)), 0.01, taus)


def picture(figure):
    figure.canvas.draw()
    return np.asarray(figure.canvas.buffer_rgba())


@pytest.mark.parametrize("name", ["rlg-car", "perfect"])
def test_figure_of_a_preset(name):
    figure = allan_figure(IMU_PRESETS[name], name, np.random.default_rng(0))
    assert picture(figure).std() > 5
    labels = [[line.get_label() for line in ax.lines] for ax in figure.axes]
    shown = ["right", "forward", "up", "white noise", "pulses", "datasheet"] if name == "rlg-car" else []
    assert labels == [shown, shown]
    if shown:
        gyro = simulate_at_rest(IMU_PRESETS[name], np.random.default_rng(0))[0]
        drawn = figure.axes[0].lines[1].get_ydata()  # deg/h, forward
        assert_allclose(drawn, allan_deviation(gyro, 0.01).adev[:, 1] / DEG_PER_H)


def test_figure_leaves_no_state_behind():
    from matplotlib import pyplot

    allan_figure(IMU_PRESETS["perfect"], "perfect", np.random.default_rng(0))
    assert pyplot.get_fignums() == []


@pytest.mark.parametrize("recorded", ["rlg_parked_car.npz"], indirect=True)
def test_figure_of_a_recording(recorded):
    recording = load(recorded)
    figure = allan_figure(recording, "quiet", window=(550.0, 100.0), datasheet=IMU_PRESETS["rlg-car"])
    assert picture(figure).std() > 5
    quiet = recording.dtheta[55000:65000]
    drawn = figure.axes[0].lines[0].get_ydata()
    assert_allclose(drawn, allan_deviation(quiet, 0.01).adev[:, 0] / DEG_PER_H)
    with pytest.raises(ValueError, match="allowed: within 0 to 1230 s"):
        allan_figure(recording, "beyond", window=(1200.0, 100.0))


def test_figure_of_a_preset_needs_a_generator():
    with pytest.raises(ValueError, match="rng is missing"):
        allan_figure(IMU_PRESETS["mems"], "mems")
