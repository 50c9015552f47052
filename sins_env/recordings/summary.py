"""A summary of a recording, measured on its increments: forces and rates, spans at rest, a first guess of the heading."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.recordings.axes import heading_pitch_roll
from sins_env.recordings.column_units import block_means
from sins_env.recordings.recording import Gap, Recording
from sins_env.specs import ImuSpec
from sins_env.units import DEG, DEG_PER_H

SUB_S, BLOCK_S = 0.1, 1.0  #: rest shows in the spread of means over SUB_S within blocks of BLOCK_S
REST_FORCE, REST_RATE = 0.05, 0.005  #: limits of this spread in each axis of a base at rest, m/s^2 and rad/s
REST_LEAST_S = 5.0  #: length of the shortest span at rest that counts
GUESS_MOST_S, GUESS_LEAST_S = 300.0, 20.0  #: limits of the span that gives the guess of the heading
MEAN_OF = 10  #: number of velocities that are averaged before they count as motion
MOST_NORTH_ERROR = 20.0 * DEG  #: error of a heading from the earth's rate from which on it is none, rad
MOVING_MPS = 0.5  #: speed of a fix, or of the reference, from which on the base has left the spot


@dataclass(frozen=True)
class Guess:
    """A guess of the attitude at the start of a span on the spot, from the drift of gravity in the inertial frame."""

    start: float  #: start of the span, s
    end: float  #: end of the span, s
    angles: Array  #: (3,) heading, pitch, roll at the start, rad
    halves: tuple[float, float]  #: heading from either half of the span alone, carried back to the start, rad


class North(NamedTuple):
    """What the gyros leave of a heading from the earth's rate, at a base on the spot."""

    told: float  #: bias that is told of the gyros, 1 sigma, rad/s; zero if nothing is told
    measured: float  #: bias that they have at least, by their rate at rest, and its noise, rad/s; zero without rest
    horizontal: float  #: horizontal earth rate at the site, rad/s

    @property
    def error(self) -> float:
        """Error of the heading, rad."""
        return math.atan2(max(self.told, self.measured), self.horizontal)

    @property
    def found(self) -> bool:
        """Whether the gyros find north."""
        return self.error <= MOST_NORTH_ERROR

    def __str__(self) -> str:
        """Return why there is no heading, and what would give one."""
        kind, bias = ("told", self.told) if self.told >= self.measured else ("measured at rest", self.measured)
        return (
            f"gyros of {bias / DEG_PER_H:.3g} deg/h ({kind}) against the earth's horizontal {self.horizontal / DEG_PER_H:.3g} "
            f"leave {self.error / DEG:.0f} deg; motion with velocity fixes gives one, or two antennas (--aid heading)"
        )


@dataclass(frozen=True)
class Summary:
    """The measurements of :func:`summarise`."""

    force: tuple[float, float, float]  #: least, median and largest mean over a second of ``|f|``, m/s^2
    rate: tuple[float, float, float]  #: the same of ``|w|``, rad/s
    gaps: list[Gap]  #: gaps of the file, with those that are bridged
    fix_rate_hz: float | None
    fix_gaps: list[Gap]
    reference_rate_hz: float | None
    rest: list[tuple[float, float]]  #: spans (start, end) at rest, s
    guess: Guess | None  #: None without a span on the spot that has no gap
    reference_heading: float | None  #: heading of the reference at the start of the guess, rad


def summarise(recording: Recording) -> Summary:
    """Measure a recording in a few passes over its increments."""
    rate = recording.rate_hz
    force, turn = (
        np.linalg.norm(block_means(values, rate) * rate, axis=1) for values in (recording.dvel, recording.dtheta)
    )
    gnss, ref = recording.gnss, recording.reference
    rest = spans_at_rest(recording)
    guess = _guess(recording)
    fix_step = None if gnss is None or len(gnss.t_s) < 2 else float(np.median(np.diff(gnss.t_s)))
    heading = None
    if guess is not None and ref is not None:
        near = int(np.argmin(np.abs(ref.t_s - guess.start)))
        heading = float(heading_pitch_roll(ref.q_nb[near])[0])
    return Summary(
        _range(force),
        _range(turn),
        sorted([*recording.gaps, *recording.bridged]),
        None if fix_step is None else 1.0 / fix_step,
        [] if gnss is None or fix_step is None else _missing(gnss.t_s, fix_step),
        None if ref is None or len(ref.t_s) < 2 else float(1.0 / np.median(np.diff(ref.t_s))),
        rest,
        guess,
        heading,
    )


def north(recording: Recording, imu: ImuSpec | None = None) -> North:
    """Return what the gyros leave of a heading at rest: by what ``imu`` tells of them, and by their rate at rest.

    The rate at rest is that of the earth plus the bias, so its length is off by no more than the bias.
    """
    told = 0.0 if imu is None else math.hypot(imu.gyro_bias_deg_h, imu.gyro_markov_deg_h) * DEG_PER_H
    model, measured = earth.get(recording.site.earth), 0.0
    spans = spans_at_rest(recording)
    if spans:
        start, end = max(spans, key=lambda span: span[1] - span[0])
        first, last = (round((t - recording.t0) * recording.rate_hz) for t in (start, end))
        means = block_means(recording.dtheta[first:last], recording.rate_hz) * recording.rate_hz
        noise = float(np.linalg.norm(means.std(axis=0)) / math.sqrt(len(means)))
        measured = max(abs(float(np.linalg.norm(means.mean(axis=0))) - model.rate), noise)
    return North(told, measured, model.rate * math.cos(recording.site.latitude))


def _range(values: Array) -> tuple[float, float, float]:
    return float(values.min()), float(np.median(values)), float(values.max())


def _missing(t: Array, step: float) -> list[Gap]:
    """Return the spans between stamps in which at least one stamp is missing."""
    wide = np.flatnonzero(np.diff(t) > 1.5 * step)
    return [Gap(float(t[i]), float(t[i + 1]), round(float(t[i + 1] - t[i]) / step) - 1) for i in wide]


def spans_at_rest(recording: Recording) -> list[tuple[float, float]]:
    """Return the spans (start, end), s, in which every second is at rest."""
    rate = recording.rate_hz
    sub = max(round(SUB_S * rate), 1)
    per_block = max(round(BLOCK_S * rate / sub), 2)
    count = len(recording.dtheta) // (sub * per_block)
    if count == 0:
        return []
    still = np.ones(count, dtype=bool)
    for values, limit in ((recording.dvel, REST_FORCE), (recording.dtheta, REST_RATE)):
        means = values[: count * per_block * sub].reshape(count, per_block, sub, 3).mean(axis=2) * rate
        with np.errstate(invalid="ignore"):
            still &= (means.std(axis=1) < limit).all(axis=1)  # False where samples are missing
        mean = means.mean(axis=1)
        calm = np.abs(np.diff(mean, axis=0)).max(axis=1) < 2 * limit
        still[1:] &= calm
    length = per_block * sub / rate
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8)))
    spans = [
        (recording.t0 + float(a) * length, recording.t0 + float(b) * length)
        for a, b in zip(edges[::2], edges[1::2], strict=True)
    ]
    return [span for span in spans if span[1] - span[0] >= REST_LEAST_S and not _travels(recording, *span)]


def _travels(recording: Recording, start: float, end: float) -> bool:
    """Return whether fixes or reference move in a span whose increments are steady: a straight drive feels like rest.

    Velocities are averaged over ten stamps, so that the noise of a receiver is no motion.
    """
    for part in (recording.gnss, recording.reference):
        if part is None or part.vel is None:
            continue
        vel = part.vel[(part.t_s > start) & (part.t_s <= end)]
        if not len(vel):
            continue
        starts = np.arange(0, max(len(vel) - MEAN_OF + 1, 1), MEAN_OF)
        means = np.add.reduceat(vel, starts, axis=0) / np.diff(np.append(starts, len(vel)))[:, None]
        if (np.linalg.norm(means, axis=1) > MOVING_MPS).any():
            return True
    return False


def _guess(recording: Recording) -> Guess | None:
    """Guess the attitude from the first span on the spot without a gap, at most 300 s; the base may sway."""
    first, last = _on_the_spot(recording)
    rate = recording.rate_hz
    if (last - first) / rate < GUESS_LEAST_S:
        return None
    start = recording.t0 + first / rate
    q = inertial_alignment(recording, first, last)
    middle = (first + last) // 2
    late = inertial_alignment(recording, middle, last)
    relative = carried(recording, first, middle)[0][-1]
    whole, early = heading_pitch_roll(q), heading_pitch_roll(inertial_alignment(recording, first, middle))
    # C_nb at the start from that at the middle; the Earth has turned meanwhile
    w_ie = earth.rate_n(earth.get(recording.site.earth), recording.site.latitude)
    turned = attitude.from_rotvec(w_ie * ((middle - first) / rate))
    back = attitude.multiply(attitude.multiply(turned, late), attitude.conjugate(relative))
    return Guess(start, recording.t0 + last / rate, whole, (float(early[0]), float(heading_pitch_roll(back)[0])))


def _on_the_spot(recording: Recording) -> tuple[int, int]:
    """Return the samples (first, last) from the first one there is to the first gap, or until the base moves."""
    rate = recording.rate_hz
    first = int(np.argmax(~recording.missing))
    gap = np.flatnonzero(recording.missing[first:])
    last = first + (int(gap[0]) if len(gap) else len(recording.dtheta) - first)
    moves = [recording.t0 + last / rate]
    for part in (recording.gnss, recording.reference):
        if part is not None and part.vel is not None:
            fast = np.flatnonzero(np.linalg.norm(part.vel, axis=1) > MOVING_MPS)
            moves += [float(part.t_s[fast[0]]) - 1.0] if len(fast) else []
    most = min(min(moves), recording.t0 + first / rate + GUESS_MOST_S)
    return first, max(min(last, int((most - recording.t0) * rate)), first)


def carried(recording: Recording, first: int, last: int) -> tuple[Array, Array, int]:
    """Integrate increments in body axes frozen at the start, over samples ``first`` to ``last`` without gaps.

    Returns the attitude relative to the start, (S, 4), and the velocity added by specific force, (S, 3), m/s, both at the
    ends of S steps of about 0.02 s, and the number of samples in a step.
    """
    size = max(round(0.02 * recording.rate_hz), 1)  # 50 Hz is fine enough for a guess
    count = max((last - first) // size, 1)
    size = min(size, last - first)
    dtheta, dvel = (
        values[first : first + count * size].reshape(count, size, 3).sum(axis=1)
        for values in (recording.dtheta, recording.dvel)
    )
    q = _running_product(attitude.from_rotvec(dtheta))
    middle = np.concatenate([[[1.0, 0.0, 0.0, 0.0]], q[:-1]])
    half = attitude.multiply(middle, attitude.from_rotvec(0.5 * dtheta))
    steps = np.matmul(attitude.to_dcm(half), dvel[..., None])[..., 0]
    return q, np.cumsum(steps, axis=0), size


def _running_product(q: Array) -> Array:
    """Return the products q_1, q_1 q_2, q_1 q_2 q_3 ..., (n, 4), in log2(n) steps of doubled reach."""
    q = q.copy()
    reach = 1
    while reach < len(q):
        q[reach:] = attitude.multiply(q[:-reach], q[reach:])
        reach *= 2
    return attitude.normalize(q)


def inertial_alignment(recording: Recording, first: int, last: int) -> Array:
    """Return q_nb (4,) at sample ``first`` of a base that stays on the spot until ``last``.

    The integral of gravity in body axes frozen at the start is fitted to that in the local frame frozen at the start.
    This is Wahba's problem over all values of the integrals. See docs/mathematics/coarse_alignment.md#recordings.
    """
    _, v_b, _ = carried(recording, first, last)
    t = (np.arange(len(v_b)) + 1) * ((last - first) / recording.rate_hz / len(v_b))
    site, model = recording.site, earth.get(recording.site.earth)
    w = earth.rate_n(model, site.latitude)
    rate = float(np.linalg.norm(w))
    axis = w / rate
    up = np.array([0.0, 0.0, 1.0])
    along = axis * (axis @ up)
    across, third = up - along, np.cross(axis, up)
    x = rate * t[:, None]
    v_n = along * t[:, None] + across * np.sin(x) / rate + third * (1.0 - np.cos(x)) / rate
    u, _, vt = np.linalg.svd(v_n.T @ v_b)
    C = u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)]) @ vt
    return attitude.from_dcm(C)
