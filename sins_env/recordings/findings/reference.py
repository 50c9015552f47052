"""Checks of the reference's attitude against gravity's drift at rest, and against the course."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from sins_env import attitude
from sins_env.recordings.axes import heading_pitch_roll
from sins_env.recordings.findings.course import MOST_COURSE_DEG, off_course
from sins_env.recordings.findings.finding import Finding
from sins_env.recordings.findings.inertial import earth_rate_at_rest
from sins_env.recordings.recording import Recording
from sins_env.recordings.summary import summarise

MOST_DEG = 5.0  #: largest angle between reference and estimate
HALVES = 5.0  #: the same, in differences of the estimates from either half of the data
LEAST_FAST = 10  #: least number of velocities that give a course


def reference_attitude(recording: Recording) -> Iterator[Finding]:
    """Compare the reference's first attitude with that from gravity's drift, as far as its halves agree."""
    ref = recording.reference
    if ref is None:
        return
    guess = summarise(recording).guess
    if guess is None or any(earth_rate_at_rest(recording)) or not ref.t_s[0] - 1.0 <= guess.start <= ref.t_s[-1]:
        return
    told = heading_pitch_roll(ref.q_nb[int(np.argmin(np.abs(ref.t_s - guess.start)))])
    off = np.degrees(attitude.wrap(told - guess.angles))
    halves = abs(float(np.degrees(attitude.wrap(guess.halves[0] - guess.halves[1]))))
    limits = np.array([max(MOST_DEG, HALVES * halves), MOST_DEG, MOST_DEG])
    if limits[0] > 45.0:
        limits[0] = 181.0  # these gyros find no north
    at = int(np.argmax(np.abs(off) / limits))
    if abs(off[at]) <= limits[at]:
        return
    name = ("heading", "pitch", "roll")[at]
    true = float(np.degrees(guess.angles[0]))
    other = (90.0 - true) % 360.0 - float(np.degrees(told[0]))
    counter = at == 0 and abs((other + 180.0) % 360.0 - 180.0) < limits[0]
    why = (
        "an angle counter-clockwise from east, read as a heading?"
        if counter
        else "another frame, axes or order of columns?"
    )
    mine, its = np.degrees(guess.angles[at]), np.degrees(told[at])
    text = f"the reference's {name} is {its:.2f} deg, that from gravity's drift {mine:.2f}: {why}"
    yield Finding("reference_attitude", abs(float(off[at])), float(limits[at]), "deg", (guess.start, guess.end), text)


def reference_course(recording: Recording) -> Iterator[Finding]:
    """Compare the reference's heading with the course of its velocity."""
    ref = recording.reference
    if ref is None or ref.vel is None:
        return
    found = off_course(ref.q_nb, ref.vel, LEAST_FAST)
    if found is not None and abs(off := found[0]) > MOST_COURSE_DEG:
        t = ref.t_s[found[1]]
        text = f"the reference's heading lies {abs(off):.0f} deg off its course: another frame, other axes, or a mounting angle"
        yield Finding("reference_course", abs(off), MOST_COURSE_DEG, "deg", (float(t[0]), float(t[-1])), text, False)
