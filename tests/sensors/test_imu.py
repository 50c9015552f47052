import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sins_env.sensors.imu import GaussMarkov, Imu, Script, Wave, standard_normal
from sins_env.specs import ImuSpec
from sins_env.units import ARCSEC, DEG_PER_H, PPM, UG

EVERYTHING = ImuSpec(
    gyro_bias_deg_h=1.0,
    arw_deg_sqrt_h=0.1,
    gyro_markov_deg_h=0.3,
    gyro_markov_s=60.0,
    accel_bias_ug=1000.0,
    vrw_ug_sqrt_hz=100.0,
    accel_markov_ug=50.0,
    accel_markov_s=60.0,
    scale_ppm=300.0,
    misalignment_arcsec=60.0,
    gyro_lsb_arcsec=0.1,
    accel_lsb_mps=1e-3,
)
PLAIN_ACCEL = ImuSpec(
    gyro_bias_deg_h=1.0, arw_deg_sqrt_h=0.1, gyro_markov_deg_h=0.3, gyro_lsb_arcsec=0.1, vrw_ug_sqrt_hz=50.0
)


def rngs(count, seed=0):
    return np.random.default_rng(seed).spawn(count)


def streams(runs, seed=0):
    return [rng.spawn(6) for rng in rngs(runs, seed)]


def std_within(samples, sigma, independent):
    """The sample standard deviation is sigma within 3 standard errors (``independent`` values)."""
    assert abs(np.std(samples) / sigma - 1) < 3 / np.sqrt(2 * independent)


@pytest.mark.parametrize("dt", [0.01, 1.0, 30.0, 400.0])
def test_gauss_markov_is_stationary_from_the_first_sample_on(dt):
    process = GaussMarkov(2.0, 100.0, dt)
    process.reset(rngs(3000))
    x = process.samples(40)
    assert x.shape == (3000, 40, 3)
    for k in (0, 1, 20, 39):
        std_within(x[:, k], 2.0, 9000)
        assert abs(x[:, k].mean()) < 3 * 2.0 / np.sqrt(9000)


@pytest.mark.parametrize("dt", [0.01, 1.0, 30.0, 400.0])
def test_gauss_markov_autocorrelation_is_exact(dt):
    """exp(-dt/T) for any dt, where x' = (1 - dt/T) x would be wrong or unstable."""
    process = GaussMarkov(1.0, 100.0, dt)
    process.reset(rngs(20000, 1))
    x = process.samples(4)
    for lag in (1, 3):
        expected = np.exp(-lag * dt / 100.0)
        error = np.sqrt((1 - expected**2) ** 2 / x[:, 0].size)  # of a correlation coefficient
        measured = np.corrcoef(x[:, 0].ravel(), x[:, lag].ravel())[0, 1]
        assert abs(measured - expected) < 3 * error + 1e-12


def test_gauss_markov_driving_noise_has_the_exact_variance():
    dt, T = 30.0, 100.0
    process = GaussMarkov(1.0, T, dt)
    process.reset(rngs(2000, 2))
    x = process.samples(50)
    drive = x[:, 1:] - np.exp(-dt / T) * x[:, :-1]
    std_within(drive, np.sqrt(1 - np.exp(-2 * dt / T)), drive.size)


@pytest.mark.parametrize("spec", [EVERYTHING, ImuSpec(arw_deg_sqrt_h=0.01), ImuSpec()], ids=["all", "white", "none"])
def test_errors_do_not_depend_on_chunks(spec):
    true = np.random.default_rng(5).standard_normal((2, 2, 60, 3, 3)) * [[[[1e-3]]], [[[0.03]]]]
    whole = Imu(spec, 0.01)
    whole.reset(streams(2))
    parts = Imu(spec, 0.01)
    parts.reset(streams(2))
    expected = whole.measure(true[0], true[1])
    cuts = [parts.measure(true[0][:, a:b], true[1][:, a:b]) for a, b in ((0, 10), (10, 11), (11, 60))]
    # equal but for the rounding of the cumulative sums, whose pulses are whole
    for i, lsb in enumerate((0.1 * ARCSEC, 1e-3)):
        assert_allclose(np.concatenate([c[i] for c in cuts], axis=1), expected[i], rtol=0, atol=1e-6 * lsb)


def test_a_run_does_not_depend_on_its_neighbours():
    true = np.full((5, 4, 3, 3), 1e-3)
    batch, alone = Imu(EVERYTHING, 0.01), Imu(EVERYTHING, 0.01)
    batch.reset(streams(5))
    alone.reset(streams(5)[3:4])
    expected, found = batch.measure(true, true), alone.measure(true[:1], true[:1])
    assert_array_equal(found[0][0], expected[0][3])
    assert_array_equal(found[1][0], expected[1][3])


def test_a_perfect_sensor_measures_the_truth():
    imu = Imu(ImuSpec(), 0.01)
    imu.reset(streams(2))
    true = np.random.default_rng(0).standard_normal((2, 3, 5, 3))
    assert_array_equal(imu.measure(true, 2 * true)[1], 2 * true)


def test_biases_have_their_sigma_and_are_constant():
    imu = Imu(ImuSpec(gyro_bias_deg_h=0.02, accel_bias_ug=100.0), 0.1)
    imu.reset(streams(2000))
    still = np.zeros((2000, 2, 3, 3))
    for increments, sigma in zip(imu.measure(still, still), (0.02 * DEG_PER_H, 100 * UG), strict=True):
        rate = increments / 0.1
        assert_allclose(rate, rate[:, :1, :1] * np.ones((2000, 2, 3, 3)), rtol=1e-12)
        std_within(rate[:, 0, 0], sigma, 6000)
        assert abs(rate[:, 0, 0].mean()) < 3 * sigma / np.sqrt(6000)


@pytest.mark.parametrize("axis", range(3))
def test_scale_and_misalignment(axis):
    """One unit along an axis: its own error has the scale factor's sigma, the others the misalignment's."""
    imu = Imu(ImuSpec(scale_ppm=300.0, misalignment_arcsec=60.0), 0.01)
    imu.reset(streams(2000))
    unit = np.zeros((2000, 1, 1, 3))
    unit[..., axis] = 1.0
    for measured in imu.measure(unit, unit):
        error = (measured - unit)[:, 0, 0]
        std_within(error[:, axis], 300 * PPM, 2000)
        for other in {0, 1, 2} - {axis}:
            std_within(error[:, other], 60 * ARCSEC, 2000)


def test_errors_add_up():
    """White noise, biases, Markov biases and coupling have streams of their own: together they are their sum."""
    kinds = [
        {"arw_deg_sqrt_h": 0.1, "vrw_ug_sqrt_hz": 100.0},
        {"gyro_bias_deg_h": 1.0, "accel_bias_ug": 1000.0},
        {"gyro_markov_deg_h": 30.0, "gyro_markov_s": 0.5, "accel_markov_ug": 500.0, "accel_markov_s": 0.2},
        {"scale_ppm": 300.0, "misalignment_arcsec": 60.0},
    ]
    true = np.random.default_rng(1).standard_normal((2, 3, 4, 5, 3)) * 1e-3

    def errors(settings):
        imu = Imu(ImuSpec(**settings), 0.01)
        imu.reset(streams(3))
        return np.stack(imu.measure(*true)) - true

    parts = [errors(kind) for kind in kinds]
    assert min(np.abs(part).max() for part in parts) > 1e-8
    assert_allclose(errors({k: v for kind in kinds for k, v in kind.items()}), sum(parts), rtol=0, atol=1e-17)


def test_white_noise_does_not_depend_on_the_rate():
    """Over a second the sums have the same variance at any sample rate."""
    spec = ImuSpec(arw_deg_sqrt_h=0.6, vrw_ug_sqrt_hz=100.0)
    for samples in (1, 30, 300):
        imu = Imu(spec, 1.0 / samples)
        imu.reset(streams(1000, samples))
        still = np.zeros((1000, 2, samples, 3))
        dtheta, dvel = imu.measure(still, still)
        std_within(dtheta.sum(axis=2), spec.arw, 6000)
        std_within(dvel.sum(axis=2), spec.vrw, 6000)


@pytest.mark.parametrize("motion", ["still", "slow", "fast"])
def test_quantisation_carries_its_remainder(motion):
    """The total is never off by more than half a pulse: the error does not accumulate."""
    spec = ImuSpec(gyro_lsb_arcsec=0.1, accel_lsb_mps=1.2e-3)
    imu = Imu(spec, 0.01)
    imu.reset(streams(2))
    size = {"still": 0.0, "slow": 0.013, "fast": 700.3}[motion]
    rng = np.random.default_rng(0)
    theta = size * 0.1 * ARCSEC * (1 + rng.random((2, 500, 10, 3)))
    vel = -size * 1.2e-3 * (1 + rng.random((2, 500, 10, 3)))
    chunks = [imu.measure(theta[:, a : a + 50], vel[:, a : a + 50]) for a in range(0, 500, 50)]
    for i, (true, lsb) in enumerate(((theta, 0.1 * ARCSEC), (vel, 1.2e-3))):
        measured = np.concatenate([c[i] for c in chunks], axis=1)
        pulses = measured / lsb
        assert_allclose(pulses, np.rint(pulses), atol=1e-6)
        error = np.cumsum((measured - true).reshape(2, -1, 3), axis=1)
        assert np.abs(error).max() <= 0.5 * lsb * (1 + 1e-6)
        assert np.ptp(error) > 0.9 * lsb or motion == "still"


def test_gyro_settings_leave_the_accelerometers_as_they_were():
    plain, other = Imu(ImuSpec(vrw_ug_sqrt_hz=50.0), 0.01), Imu(PLAIN_ACCEL, 0.01)
    plain.reset(streams(2))
    other.reset(streams(2))
    still = np.zeros((2, 4, 3, 3))
    assert_array_equal(plain.measure(still, still)[1], other.measure(still, still)[1])


def test_standard_normal_needs_no_common_stream():
    a = standard_normal(rngs(4), (3, 2))
    b = standard_normal(rngs(4)[::-1], (3, 2))
    assert_array_equal(a, b[::-1])


@pytest.mark.parametrize("field", [f.name for f in dataclasses.fields(ImuSpec)])
@pytest.mark.parametrize("value", [[1, 2, 3], "1", None, True, -1.0, np.nan, {}, np.ones(1)], ids=repr)
def test_bad_specs_name_the_field_the_value_and_what_is_allowed(field, value):
    with pytest.raises(ValueError) as error:  # noqa: PT011  the message is compared below
        ImuSpec(**{field: value})
    assert str(error.value).startswith(f"ImuSpec.{field} = {value!r}; allowed: a ")


@pytest.mark.parametrize("field", ["gyro_markov_s", "accel_markov_s"])
def test_a_correlation_time_is_positive(field):
    with pytest.raises(ValueError, match=f"ImuSpec.{field} = 0; allowed: a positive correlation time"):
        ImuSpec(**{field: 0})


def test_a_wave_is_the_root_mean_square_over_each_sample():
    """Against quadrature; also for samples as long as the wave."""
    wave = Wave(0.7, 0.3)
    for dt in (0.01, 2.0, 9.0):
        found = wave.rms(5, 4, dt)
        for i, value in enumerate(found):
            t = np.linspace((5 + i) * dt, (6 + i) * dt, 20001)
            assert value == pytest.approx(np.sqrt(np.trapezoid(np.cos(0.7 * t + 0.3) ** 2, t) / dt), rel=1e-7)


def test_a_script_departs_from_the_spec_and_leaves_the_draws():
    spec = ImuSpec(gyro_bias_deg_h=2.0, accel_bias_ug=300.0, arw_deg_sqrt_h=0.1, vrw_ug_sqrt_hz=50.0)
    script = Script(True, gyro_mean_deg_h=0.5, accel_mean_ug=40.0, gyro_wave=Wave(0.1), accel_wave=Wave(0.2, 1.0))
    plain, scripted, parts = Imu(spec, 0.5), Imu(spec, 0.5, script), Imu(spec, 0.5, script)
    still = np.zeros((3, 20, 2, 3))
    for imu in (plain, scripted, parts):
        imu.reset(streams(3))
    drawn, changed = plain.measure(still, still), scripted.measure(still, still)
    in_parts = [parts.measure(s, s) for s in (still[:, :7], still[:, 7:])]
    assert_allclose(scripted.gyro.bias, 2.5 * DEG_PER_H)
    assert_allclose(scripted.accel.bias, 340.0 * UG)
    t = (np.arange(40) + 0.5) * 0.5
    sensors = ((plain.gyro, scripted.gyro, 0.1, 0.0), (plain.accel, scripted.accel, 0.2, 1.0))
    for i, (a, b, rate, phase) in enumerate(sensors):
        white = drawn[i].reshape(3, 40, 3) - 0.5 * a.bias[:, None]
        found = changed[i].reshape(3, 40, 3) - 0.5 * b.bias[:, None]
        assert_allclose(found, white * np.abs(np.cos(rate * t + phase))[:, None], atol=2e-2 * np.abs(white).max())
        assert_array_equal(np.concatenate([part[i] for part in in_parts], axis=1), changed[i])
