"""Checks of the inertial sensors against themselves, gravity and the turning earth."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sins_env import earth
from sins_env.arrays import Mask
from sins_env.recordings.column_units import block_means
from sins_env.recordings.findings.finding import Finding
from sins_env.recordings.recording import Recording
from sins_env.recordings.summary import spans_at_rest
from sins_env.units import DEG_PER_H

CHANNELS = ("gyro right", "gyro forward", "gyro up", "accelerometer right", "accelerometer forward", "accelerometer up")
HUNG_S, HUNG_SAMPLES = 0.5, 20  #: a sensor whose six values stay the same for longer hangs
ALL_HELD = 0.9  #: share of repeated samples from which on the data are without noise, and not those of a hung sensor
CLIPPED = 5  #: number of samples in a row at the end of a channel's range from which on it is saturated
FAR = 20.0  #: distance of that end from the median, in robust standard deviations of the channel
LEAST_RANGE = (0.8, 14.0)  #: ends of a range below which no sensor saturates, rad/s and m/s^2
GLITCH = 200.0  #: departure of a sample from its neighbours, in robust standard deviations of such departures
GLITCH_RATE, GLITCH_FORCE = 1.0, 20.0  #: departure that matters, rad/s and m/s^2
GRAVITY_MPS2 = 0.5  #: largest difference of the specific force at rest from gravity
UP_SHARE = 0.5  #: least share of gravity on the up axis at rest
EARTH_RATIO = 3.0  #: largest ratio, either way, of the rate at rest to the earth's
SLIP = 0.1  #: largest relative difference from the factor of a mistaken unit


def hung_sensor(recording: Recording) -> Iterator[Finding]:
    """Find spans in which all six values stay the same to the last bit: the sensor hangs, and its last sample is repeated."""
    same = np.logical_and(*((x[1:] == x[:-1]).all(axis=1) for x in (recording.dtheta, recording.dvel)))
    if not same.any() or same.mean() > ALL_HELD:
        return
    first, last = _longest(same)
    span = (last - first) / recording.rate_hz
    limit = max(HUNG_S, HUNG_SAMPLES / recording.rate_hz)
    if span > limit:
        text = f"all six values stay the same for {last - first} samples: the sensor hung, and its last sample was repeated"
        yield Finding("hung_sensor", span, limit, "s", _span(recording, first, last), text)


def saturated(recording: Recording) -> Iterator[Finding]:
    """Find channels that stay at the end of their range for several samples, far from their usual values."""
    for i, name in enumerate(CHANNELS):
        x = (recording.dtheta, recording.dvel)[i // 3][:, i % 3] * recording.rate_hz
        middle = float(np.nanmedian(x))
        spread = 1.4826 * float(np.nanmedian(np.abs(x - middle)))
        for end in (float(np.nanmax(x)), float(np.nanmin(x))):
            if abs(end) < LEAST_RANGE[i // 3] or abs(end - middle) <= FAR * spread:
                continue
            at = x == end
            first, last = _longest(at)
            if last - first >= CLIPPED:
                unit = "rad/s" if i < 3 else "m/s^2"
                text = f"the {name} stays at {end:.6g} {unit}, the end of its range, {int(at.sum())} times: saturated"
                yield Finding(
                    "saturated", last - first, CLIPPED, "samples in a row", _span(recording, first, last), text, False
                )


def glitches(recording: Recording) -> Iterator[Finding]:
    """Find single samples that lie far from both neighbours."""
    for values, least, unit, what in (
        (recording.dtheta, GLITCH_RATE, "rad/s", "angular rate"),
        (recording.dvel, GLITCH_FORCE, "m/s^2", "specific force"),
    ):
        if len(values) < 3:
            return
        off = np.sqrt(sum(np.square(x[1:-1] - 0.5 * (x[:-2] + x[2:])) for x in values.T)) * recording.rate_hz
        limit = max(GLITCH * float(np.nanmedian(off)), least)
        bad = np.flatnonzero(off > limit) + 1
        if len(bad):
            worst = int(np.nanargmax(off)) + 1
            text = f"the {what} jumps for single samples, most at sample {worst}: a glitch of the sensor or the logger"
            span = _span(recording, int(bad[0]), int(bad[-1]) + 1)
            yield Finding("glitches", float(off[worst - 1]), limit, unit, span, text, False)


def gravity_at_rest(recording: Recording) -> Iterator[Finding]:
    """Compare the specific force at rest with gravity, in size and direction."""
    rest = _at_rest(recording)
    if not rest.any():
        return
    f = np.mean(recording.dvel[rest], axis=0) * recording.rate_hz
    site = recording.site
    g = float(earth.gravity(earth.get(site.earth), site.latitude, site.height))
    size, span = float(np.linalg.norm(f)), _span_of(recording, rest)
    if abs(size - g) > GRAVITY_MPS2:
        text = f"at rest the specific force is {size:.3f} m/s^2, gravity {g:.3f}: a wrong scale, or large biases"
        yield Finding("gravity_at_rest", abs(size - g), GRAVITY_MPS2, "m/s^2", span, text, False)
    up = float(f[2]) / size
    if up < UP_SHARE:
        text = (
            "at rest the up axis does not feel gravity upwards: the base is upside down or on its side, the axes are "
            "others than those named, or the accelerometers have the sign of gravity"
        )
        yield Finding("upside_down", up, UP_SHARE, "g", span, text, False)


def earth_rate_at_rest(recording: Recording) -> Iterator[Finding]:
    """Compare the angular rate at rest with the earth's 15.04 deg/h, in size and, for a wrong unit, in direction.

    A large rate may be the bias of a small gyro. It is a wrong unit if it is the earth's turned by the factor of the units,
    with the earth's own component along gravity. Another rate that is too small is a warning: a simulation without the earth.
    """
    rest = _at_rest(recording)
    if not rest.any():
        return
    rate_hz, site = recording.rate_hz, recording.site
    w = np.mean(recording.dtheta[rest], axis=0) * rate_hz
    f = np.mean(recording.dvel[rest], axis=0)
    model = earth.get(site.earth)
    size, true = float(np.linalg.norm(w)), float(model.rate)
    blocks = block_means(recording.dtheta[rest], rate_hz) * rate_hz
    noise = float(np.linalg.norm(blocks.std(axis=0)) / np.sqrt(len(blocks)))
    along = float(w @ f / max(size * float(np.linalg.norm(f)), 1e-300))
    ratio, span = size / true, _span_of(recording, rest)
    name, limit = "earth_rate_at_rest", EARTH_RATIO * true / DEG_PER_H
    told = f"at rest the gyros turn by {size / DEG_PER_H:.4g} deg/h, the earth by 15.04"
    factor = 180.0 / np.pi
    upright = abs(along - np.sin(site.latitude)) < SLIP
    if abs(ratio / factor - 1) < SLIP and upright:
        yield Finding(name, size / DEG_PER_H, limit, "deg/h", span, f"{told}: deg/s were read as rad/s")
    elif ratio < 1 / EARTH_RATIO and noise < true / EARTH_RATIO:
        mistaken = abs(ratio * factor - 1) < SLIP and upright
        why = "rad/s were read as deg/s" if mistaken else "a wrong unit or scale, or the earth's rate was taken out"
        least = true / EARTH_RATIO / DEG_PER_H
        yield Finding(name, size / DEG_PER_H, least, "deg/h", span, f"{told}: {why}", mistaken)
    elif ratio > EARTH_RATIO:
        text = f"{told}: these gyros cannot find north at rest; a heading needs motion, or a second antenna"
        yield Finding(name, size / DEG_PER_H, limit, "deg/h", span, text, False)


def _at_rest(recording: Recording) -> Mask:
    """Return which samples lie in spans at rest, (N,)."""
    at = np.zeros(len(recording.dtheta), dtype=bool)
    for start, end in spans_at_rest(recording):
        first, last = (round((t - recording.t0) * recording.rate_hz) for t in (start, end))
        at[first:last] = True
    return at & ~recording.missing


def _longest(at: Mask) -> tuple[int, int]:
    """Return the first and the end (exclusive) of the longest run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]]).astype(np.int8)))
    i = int(np.argmax(edges[1::2] - edges[::2]))
    return int(edges[2 * i]), int(edges[2 * i + 1])


def _span(recording: Recording, first: int, last: int) -> tuple[float, float]:
    """Return the time of samples ``first`` to ``last`` (exclusive), s."""
    return recording.t0 + first / recording.rate_hz, recording.t0 + last / recording.rate_hz


def _span_of(recording: Recording, at: Mask) -> tuple[float, float]:
    index = np.flatnonzero(at)
    return _span(recording, int(index[0]), int(index[-1]) + 1)
