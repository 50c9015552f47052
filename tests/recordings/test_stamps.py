"""Stamps of instruments: simulated clocks with known jitter, losses, batches and wraps; time scales; bridged gaps."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles import made

from sins_env.recordings import findings, load, on_clock, save, times
from sins_env.recordings.clock import Samples, clocked
from sins_env.recordings.recording import Stamping
from sins_env.recordings.stamps import scales, wraps
from sins_env.recordings.stamps.bridging import MOST_TRIALS, bridged, unbridged

RATE, T0, N = 104.0, 1000.0, 6000
RNG = np.random.default_rng(5)
TRUE = T0 + np.arange(1, N + 1) / RATE
HOST = TRUE + RNG.uniform(-0.6, 0.6, N) / RATE  #: stamps of a host, up to 60 % of a sample off


def samples(t, kept=None, **more):
    values = np.arange(3.0 * N).reshape(-1, 3)
    values = values if kept is None else values[kept]
    return Samples("file", "time", lambda i: f"line {i + 1}", np.asarray(t, dtype=float), values, -values, **more)


def places(clock):
    return np.flatnonzero(np.isfinite(clock.dtheta[:, 0]))


def test_jittered_stamps_are_evened_out():
    found = clocked(samples(HOST))
    assert found.rate_hz == RATE
    assert len(found.dtheta) == N
    assert found.t0 == pytest.approx(T0, abs=5 * 0.35 / RATE / np.sqrt(N))
    assert found.stamping.evened
    assert found.stamping.jitter_s == pytest.approx(1.2 / np.sqrt(12) / RATE, rel=0.03)
    shifted = clocked(replace(samples(HOST), gyro_rates=True), resample_hz=52.0)
    whole = samples(HOST).dtheta[:, 0] / RATE  # a rate that rises by 3 a sample
    assert_allclose(shifted.dtheta[10:20, 0], (whole[20:40:2] + whole[21:41:2]), rtol=2e-3)


@pytest.mark.parametrize("lost", [(3000,), (1500, 1501), tuple(range(2000, 2300)), (1000, 1400, 5000)])
def test_lost_samples_are_found_without_a_counter(lost):
    """Their number is right, and their place to a few samples, under jitter of 60 % of a sample."""
    kept = np.delete(np.arange(N), lost)
    found = places(clocked(samples(HOST[kept], kept)))
    assert found[-1] == N - 1
    assert (found != kept).sum() <= 8 * len(set(lost))


@pytest.mark.parametrize("bits", [8, 16, 32])
def test_a_counter_tells_each_lost_sample(bits):
    kept = np.sort(RNG.permutation(N)[: N - 200])
    counter = (kept + 2**bits - 100) % 2**bits
    found = clocked(samples(HOST[kept], kept, counter=counter.astype(float)))
    assert found.rate_hz == RATE
    assert_array_equal(places(found), kept - kept[0])


def test_what_is_no_counter_is_refused():
    for bad, message in ((np.full(N, 7.0), "from 7 to 7"), (np.arange(N) + 0.5, "whole numbers")):
        with pytest.raises(ValueError, match=message):
            clocked(samples(HOST, counter=bad))
    with pytest.raises(ValueError, match="does not follow the counter"):
        clocked(samples(np.cumsum(RNG.uniform(0, 30, N)), counter=np.arange(N) * 1.0))


@pytest.mark.parametrize("size", [2, 5, 8])
def test_batches_have_the_time_of_their_last_sample(size):
    """Samples that wait in a driver get one stamp; the last of them has waited the least."""
    stamps = TRUE[np.minimum(np.arange(N) // size * size + size - 1, N - 1)]
    found = clocked(samples(stamps))
    assert (found.rate_hz, len(found.dtheta), found.stamping.batch) == (RATE, N, size)
    assert found.t0 == pytest.approx(T0, abs=1e-5)


def test_delays_of_the_host_are_no_losses():
    late = TRUE.copy()
    for begin in (500, 2000, 3500):
        late[begin : begin + 15] = TRUE[begin + 15]
    found = clocked(samples(late))
    assert_array_equal(places(found), np.arange(N))


def test_rows_written_twice_are_not_evened_out():
    twice = np.repeat(np.arange(N // 2), 2)
    with pytest.raises(ValueError, match=r"repeated stamps.*drop_duplicates"):
        clocked(samples(TRUE[twice], twice))
    found = clocked(samples(TRUE[twice], twice), drop_duplicates=True)
    assert (len(found.dtheta), found.rate_hz, found.stamping.dropped) == (N // 2, RATE, N // 2)


def test_wraps():
    t = np.arange(100) * 0.01
    for period in (604_800.0, 86_400.0):
        assert_allclose(wraps.unrolled((period - 0.505 + t) % period), period - 0.505 + t, atol=1e-9 * period)
    backwards = np.array([0.0, 1.0, 2.0, 1.5, 3.0])
    assert_array_equal(wraps.unrolled(backwards), backwards)


def test_time_scales():
    """Second 1167264017 of GPS time is the leap second at the end of 2016; UTC lags by 18 s after it, by 17 s before."""
    assert scales.instant("2016-12-31T23:59:59Z") == 1167264016
    assert scales.instant("2017-01-01T01:00:00.25+01:00") == pytest.approx(1167264018.25, abs=1e-6)
    assert scales.instant("2026-06-01T10:00:00Z") == 1780308000 - 315964800 + 18
    assert scales.date_of(1464343218.0) == "2026-06-01T10:00:00.000Z"
    known = np.array([4.0e8, 8.0e8, 1167264016.5, 1.4e9])
    assert_array_equal(scales.from_utc(scales.to_utc(known)), known)
    assert_array_equal(times.told(np.array([1780308000.0]), "Unix").t, [1464343218.0])
    assert_array_equal(times.told(np.array([8.0e8]), "UTC").t, [8.0e8 + 13])  # in May 2005
    with pytest.raises(
        ValueError, match=r"time = '1\.6\.26'; allowed: a date with a time, such as 2026-06-01T10:00:00"
    ):
        scales.instant("1.6.26")


def test_fixes_and_samples_in_scales_of_their_own():
    """Samples in seconds of the week with fixes in absolute time, and a week that ends between both."""
    week, here = 2421 * 604_800.0, times.Times(np.arange(604_000.0, 604_900.0))
    absolute = times.Times(week + np.array([604_100.0, 604_850.0]), "GPS")
    assert_array_equal(times.on_scale_of(absolute, here, Path("x"), "fixes"), [604_100.0, 604_850.0])
    after = times.Times(np.array([10.0, 50.0]))
    assert_array_equal(times.on_scale_of(after, here, Path("x"), "fixes"), [604_810.0, 604_850.0])


def test_short_gaps_are_bridged():
    """A turn that starts and stops: the bridge is a straight line of the rate, and its angle that of the motion."""
    first = made.recording(samples=2000, rate=200.0)
    t = np.arange(2000) / 200.0
    smooth = np.column_stack([1e-3 * np.sin(0.5 * t), 1e-3 * np.cos(0.5 * t), 1e-4 * t])
    whole = replace(first, dtheta=smooth, dvel=smooth + np.array([0, 0, 0.049]))
    holes = [arrays.copy() for arrays in (whole.dtheta, whole.dvel)]
    for part in holes:
        part[400:410] = part[900:920] = part[1200:1230] = np.nan
    holed = replace(whole, dtheta=holes[0], dvel=holes[1])
    found = bridged(holed, 0.1)
    assert [gap.samples for gap in found.bridged] == [10, 20]
    assert [gap.samples for gap in found.gaps] == [30]
    assert_allclose(found.dtheta[:1200], whole.dtheta[:1200], atol=2e-6)
    assert_array_equal(unbridged(found).dtheta, holed.dtheta)
    assert bridged(holed, 0.0) is holed
    told = [str(one) for one in findings(found)]
    assert any(one.startswith("bridged: 30 samples are missing in 2 gaps of up to 100 ms") for one in told)
    assert len(bridged(holed, 0.2).gaps) == 0


def test_a_bridge_tells_what_it_is_off_by():
    """White noise in two axes, of which the ends of a bridge of n samples and these themselves have n variances each."""
    rng, n, N = np.random.default_rng(8), 10, 40_000
    first = made.recording(samples=N, rate=200.0)
    std = 1e-3 * np.array([1.0, 0.0, 2.0])
    dtheta, dvel = std * rng.standard_normal((N, 3)), 10.0 * rng.standard_normal((N, 3))
    holes = [slice(20_000, 20_000 + n), slice(21_000, 21_100)]
    for part in (dtheta, dvel):
        part[holes[0]] = part[holes[1]] = np.nan
    found = bridged(replace(first, dtheta=dtheta, dvel=dvel), 0.1)
    assert found.bridge_cov.shape == (1, 6, 6)  # the longer gap stays one
    want = np.zeros((6, 6))
    want[[0, 2, 3, 4, 5], [0, 2, 3, 4, 5]] = 2 * n * np.square([*std[[0, 2]], 10.0, 10.0, 10.0])
    want[1, 1] = want[:3, :3].trace() / 3 / (1 + (N - 130 - 60) / 20)  # one stretch more, whose axes are alike
    size = np.sqrt(np.diag(want))
    errors = found.bridge_cov[0] / np.outer(size, size) - np.eye(6)
    assert np.abs(errors).max() < 5 * np.sqrt(2 / (MOST_TRIALS / 2))  # neighbours share half of their samples at most
    again = bridged(found, 0.6)
    assert again.bridge_cov.shape == (2, 6, 6)
    assert_array_equal(again.bridge_cov[0], found.bridge_cov[0])
    assert unbridged(again).bridge_cov.shape == (0, 6, 6)
    short = replace(first, dtheta=dtheta[19_900:20_030], dvel=dvel[19_900:20_030])
    short.dtheta[5:100] = short.dvel[5:100] = np.nan
    assert bridged(short, 1.0).bridged == ()  # no stretch has the samples of such a bridge
    twice = made.recording(samples=100, gaps=[slice(40, 45), slice(60, 90)])
    assert len(bridged(bridged(twice, 0.03), 0.2).bridged) == 1  # nor if some of them are bridged themselves


def test_jitter_is_told():
    stamped = replace(made.recording(), stamping=Stamping(0.9e-3, 2e-3, 4, True, 3))
    told = [one for one in findings(stamped) if one.name in ("jitter", "repeated_stamps")]
    assert "jitter 0.9 ms RMS, at most 2 ms, evened out" in told[0].text
    assert "4 samples with one stamp" in told[0].text
    assert told[1].value == 3
    assert not any(one.wrong for one in told)


def test_a_counter_beside_stamps_in_a_table(tmp_path):
    """Host stamps in UTC with a counter that nobody names; the scale comes back from the package's own file."""
    kept = np.delete(np.arange(600), [200, 201, 202])
    at = np.datetime64("2026-06-01T10:00:00", "us") + (1e6 * (HOST[kept] - T0)).astype(np.int64)
    rows = [f"{t}Z,{(k + 65300) % 65536},1e-5,{k}e-9,2e-5,0.1,0.2,9.81" for t, k in zip(at, kept, strict=True)]
    (tmp_path / "imu.csv").write_text("\n".join(["time,PacketCounter,gx,gy,gz,ax,ay,az", *rows]) + "\n")
    gyro, accel = ({"columns": [f"{x}{axis}" for axis in "xyz"]} for x in "ga")
    found = load(
        tmp_path / "imu.csv",
        mapping={
            "axes": "RFU",
            "site": [48.1, 11.6, 520],
            "time": {"column": "time"},
            "gyro": {**gyro, "unit": "rad/s"},
            "accel": {**accel, "unit": "m/s2"},
            "bridge_s": 0.0,
        },
    )
    assert_array_equal(np.flatnonzero(found.missing), [200, 201, 202])
    assert (found.scale, found.t0) == ("GPS", pytest.approx(1464343218.0, abs=0.002))
    assert on_clock(found, "2026-06-01T10:00:05Z") == 1464343223.0
    assert on_clock(found, "+5") == found.t0 + 5.0
    for name in ("own.npz", "own.csv"):
        save(found, tmp_path / name)
        assert (load(tmp_path / name).scale, load(tmp_path / name).t0) == ("GPS", pytest.approx(found.t0, abs=1e-6))
