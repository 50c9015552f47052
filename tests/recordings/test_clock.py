"""Stamps to a clock, gaps, rates and resampling, over random cases; axes over all of them."""

import itertools

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from oracles import made

from sins_env.recordings import heading_pitch_roll, resample, to_rfu
from sins_env.recordings.clock import Samples, clocked, fitted_rate, resampled
from sins_env.recordings.recording import Gap

RATES = st.sampled_from([1.0, 12.5, 50.0, 66.6666, 100.0, 199.99, 200.0, 400.0, 2000.0])


def samples(t, values=None):
    values = np.arange(3.0 * len(t)).reshape(-1, 3) if values is None else values
    return Samples("file", "time", lambda i: f"line {i + 1}", np.asarray(t, dtype=float), values, -values)


@settings(max_examples=60, deadline=None)
@given(RATES, st.lists(st.booleans(), min_size=30, max_size=300), st.floats(0, 6e5), st.integers(0, 2**32 - 1))
def test_every_sample_finds_its_place(rate, kept, t0, seed):
    """Some samples are missing, every stamp is off by up to a fifth of a sample: the places come out right."""
    there = np.flatnonzero(np.array(kept) | (np.arange(len(kept)) % 4 < 3))
    noise = np.random.default_rng(seed).uniform(-0.2, 0.2, len(there))
    t = t0 + (there + 1 + noise) / rate
    found = clocked(samples(t), rate)
    assert_array_equal(np.flatnonzero(np.isfinite(found.dtheta[:, 0])), there - there[0])
    assert_array_equal(found.dtheta[there - there[0], 0], 3.0 * np.arange(len(there)))
    assert found.t0 == pytest.approx(t0 + there[0] / rate, abs=0.25 / rate)


@settings(max_examples=200, deadline=None)
@given(RATES, st.integers(20, 3000), st.floats(0, 6e5), st.integers(3, 9))
def test_the_rate_of_printed_stamps(rate, count, t0, digits):
    """Stamps rounded to so many digits: a whole rate is found exactly, any other to half a digit over the span."""
    step = 10.0**-digits
    if step * rate > 0.2:
        return
    t = np.round((t0 + np.arange(1, count + 1) / rate) / step) * step
    found = fitted_rate(samples(t))
    if rate == round(rate):
        assert found == rate
    else:
        assert found == pytest.approx(rate, abs=rate * rate * step / count + 1e-6 + 0.5 * rate / count)


def test_a_rate_that_is_not_whole_stays_so():
    t = np.arange(1, 200_001) / 199.99
    assert fitted_rate(samples(t)) == pytest.approx(199.99, rel=1e-9)
    assert fitted_rate(samples(t[:20])) == 200.0  # nobody can tell by 1 ms, and by 50 ppm it is meant to be 200 Hz
    assert fitted_rate(samples(np.arange(1, 101) / 66.6666)) == pytest.approx(66.6666, rel=1e-9)
    assert fitted_rate(samples(np.arange(1, 200_001) / 200.0001)) == 200.0  # a tenth of a sample in all
    assert fitted_rate(samples(np.arange(1, 2_000_001) / 200.0001)) == pytest.approx(200.0001, rel=1e-9)
    with pytest.raises(ValueError, match="1 sample; allowed: at least 2"):
        fitted_rate(samples(t[:1]))


@pytest.mark.parametrize(
    ("t", "message"),
    [
        (
            [1, 2, 3, 4, 4.1, 4.2, 5, 6],
            r"does not increase by one sample of 1 Hz at line 5: 4\.1 s after 4 s; allowed: a un",
        ),
        ([1, 2, 3, 3, 4, 4, 4, 5], r"at line 4: 3 repeated stamps, 3 s, 4 s, 4 s; allowed: each stamp once"),
        ([1, 2, 3, 2.5, 4], r"at line 4: 2\.5 s after 3 s$"),
        ([1, 2, 3, 4, 20], "spans 20 samples of 1 Hz; only 5 are there"),
        ([1, 2, 3, 4, 1e300], "spans .* samples of 1 Hz; only 5 are there"),
    ],
)
def test_no_clock(t, message):
    with pytest.raises(ValueError, match=rf"file: time {message}|file: time does not increase.*{message}"):
        clocked(samples(t), 1.0)


def test_irregular_stamps_are_refused_until_resampling_is_asked_for():
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.5, 1.5, 2000)) / 100
    values = np.diff(np.sin(np.concatenate([[t[0] - 0.01], t])))[:, None] * [1.0, 2.0, 3.0]
    with pytest.raises(ValueError, match="allowed: a uniform clock, or resampling"):
        clocked(samples(t, values), 100.0)
    found = clocked(samples(t, values), 100.0, resample_hz=50.0)
    ticks = found.t0 + np.arange(1, len(found.dtheta) + 1) / 50.0
    expected = np.sin(ticks) - np.sin(ticks - 0.02)
    assert_allclose(found.dtheta[5:-5, 0], expected[5:-5], atol=1e-8)
    assert_allclose(found.dvel, -found.dtheta, atol=1e-15)


@settings(max_examples=60, deadline=None)
@example(279.998046875, 40, 0, True)
@given(st.floats(20.0, 500.0), st.integers(40, 400), st.integers(0, 2**32 - 1), st.booleans())
def test_gaps_and_extent_of_what_is_resampled(hz, count, seed, gap):
    """New samples are missing where they touch a gap and nowhere else; they end where the last whole one fits."""
    rng = np.random.default_rng(seed)
    there = np.delete(np.arange(count), slice(15, 20)) if gap else np.arange(count)
    t, values = (there + 1) / 100.0, rng.standard_normal((len(there), 6))
    found = resampled(t, values, 100.0, hz)
    ends = found.t0 + np.arange(1, len(found.dtheta) + 1) / hz
    begins = ends - 1 / hz
    missing = np.isnan(found.dtheta[:, 0])
    inside = (ends > 0.15 + 2e-6) & (begins < 0.20 - 2e-6) if gap else np.zeros(len(ends), dtype=bool)
    told = (
        np.abs(np.stack([ends - 0.15, begins - 0.20])).min(axis=0) > 2e-6
    )  # nearer than that is rounding: either is right
    assert_array_equal(missing[told], inside[told])
    assert found.t0 == pytest.approx(0.0)
    assert (count / 100.0 - found.t0) * hz - len(found.dtheta) < 1 + 1e-5


def test_resampling_to_the_same_rate_and_by_a_whole_factor():
    first = made.recording(gaps=(slice(700, 710),))
    same = resample(first, 200.0)
    assert_allclose(same.dtheta, first.dtheta, atol=1e-15)
    assert (same.t0, same.rate_hz) == (first.t0, 200.0)
    half = resample(first, 100.0)
    assert_allclose(half.dvel, first.dvel.reshape(-1, 2, 3).sum(axis=1), atol=1e-12)
    assert half.gnss is first.gnss
    assert half.gaps == [Gap(pytest.approx(1003.5), pytest.approx(1003.55), 5)]
    for bad in (0.0, -1.0, np.nan, 0.01):
        with pytest.raises(ValueError, match="resample_hz = "):
            resample(first, bad)


def test_resampling_starts_on_a_tick():
    """Fixes at whole seconds then fall on samples."""
    found = resample(made.recording(t0=1000.003), 50.0)
    assert found.t0 * 50.0 == pytest.approx(round(found.t0 * 50.0), abs=1e-6)
    assert found.t0 >= 1000.003 - 1e-6


SIGNED = ["".join(s + a for s, a in zip(signs, order, strict=True)) for order in itertools.permutations("xyz")
          for signs in itertools.product("+-", repeat=3)]  # fmt: skip
LETTERS = ["".join(word) for word in itertools.product("RLFBUD", repeat=3)]


def test_all_signed_permutations():
    proper = []
    for axes in SIGNED:
        turn = np.zeros((3, 3))
        for row in range(3):
            turn[row, "xyz".index(axes[2 * row + 1])] = 1.0 if axes[2 * row] == "+" else -1.0
        if np.linalg.det(turn) > 0:
            assert_array_equal(to_rfu(axes), turn)
            proper.append(turn)
        else:
            with pytest.raises(ValueError, match="right-handed"):
                to_rfu(axes)
    assert len(proper) == 24


def test_all_letters():
    """The 24 right-handed ones are the signed permutations; everything else is refused."""
    found = []
    for axes in LETTERS:
        try:
            found.append(to_rfu(axes))
        except ValueError as error:
            assert f"axes = '{axes}'" in str(error)  # noqa: PT017  two kinds of outcome
    assert len({turn.tobytes() for turn in map(lambda m: m + 0.0, found)}) == 24 == len(found)
    assert_array_equal(to_rfu("frd"), to_rfu("+y+x-z"))
    assert_array_equal(to_rfu("BRU"), to_rfu("+y-x+z"))
    for bad in ("", "FR", "FRDX", "+x+y", "++x+y+z", None, 3):
        with pytest.raises(ValueError, match="allowed: where x, y, z point"):
            to_rfu(bad)


def test_headings_are_clockwise_from_north():
    t = np.linspace(0, 30, 500)
    angles = made.attitudes(t).as_euler("ZXY")
    found = heading_pitch_roll(made.attitudes(t).as_quat(scalar_first=True))
    assert_allclose(found[:, 0], -angles[:, 0] % (2 * np.pi), atol=1e-12)
    assert_allclose(found[:, 1:], angles[:, 1:], atol=1e-12)
