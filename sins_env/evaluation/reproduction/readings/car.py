"""Readings of the tables of the parked car: angles at the end, and the effect of a disturbance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.reproduction.readings.common import FAILED, Reader, end_errors
from sins_env.evaluation.reproduction.verdicts import NOTHING, Estimate, capped_rms, median
from sins_env.evaluation.score.results import Results

ANGLES = ("heading", "pitch", "roll")
TILT_DEG = 1.0  #: more than a parked car tilts


def whole(read: Reader) -> Reader:
    """Return the reader itself, which reads all runs."""
    return read


def of_records(part: slice, read: Reader) -> Reader:
    """Make a reader of only those runs that play some of the task's records."""

    def of_part(results: Results) -> Estimate:
        records, number = results.records, results.task.records
        rows = [records.row(int(i)) for i in np.flatnonzero(np.isin(records.run % number, np.arange(number)[part]))]
        return read(replace(results, records=Records.of_rows(records.criteria, rows))) if rows else NOTHING

    return of_part


def azimuth(points: int = 0, about_mean: bool = True, cap_deg: float | None = None) -> Reader:
    """Make a reader of the azimuth error at the end, deg: its standard deviation over runs, or its RMS.

    A run counts with no more than ``cap_deg``; None takes the error from which a run has failed.
    """

    def read(results: Results) -> Estimate:
        return capped_rms(np.degrees(end_errors(results, points)[:, 2]), cap_deg or failed_deg(results), about_mean)

    return read


def failed_deg(results: Results) -> float:
    """Return the azimuth error, deg, beyond which a run has failed."""
    return FAILED * results.task.delta_azimuth_deg


def angles(results: Results, points: int = 0) -> tuple[Array, Array]:
    """Return heading, pitch and roll at the end, the estimated and the true ones, (R, 3) each, in rad.

    Those of a simulated car count from the true angles at switch-on, because each run parks it at another place.
    """
    task, records = results.task, results.records
    env = task.make(len(records))
    task.reset(env, records.run.tolist())
    world = env.unwrapped.episode.world  # type: ignore[attr-defined]
    true = world.truth_at(records.criteria.num_epochs).q_nb
    found = attitude.multiply(attitude.misalignment_quaternion(end_errors(results, points)), true)
    place = np.zeros(3) if task.windows else _euler(world.truth_at(0).q_nb)
    env.close()
    return attitude.wrap(_euler(found) - place), attitude.wrap(_euler(true) - place)


def courses_of(results: Results) -> tuple[Array, Array, Array]:
    """Return the times of the fine phase (S,), s, and the angles of the first run as found and as they are, (S, 3), deg.

    They count from the true angles at switch-on.
    """
    task, records, criteria = results.task, results.records, results.records.criteria
    t = np.asarray(criteria.history_t)
    fine = np.flatnonzero(t > criteria.coarse_s)
    env = task.make(1)
    task.reset(env, records.run[:1].tolist())
    world = env.unwrapped.episode.world  # type: ignore[attr-defined]
    true = np.stack([world.truth_at(round(t[i] / criteria.epoch_s)).q_nb[0] for i in fine])
    place = _euler(world.truth_at(0).q_nb[0])
    env.close()
    found = attitude.multiply(attitude.misalignment_quaternion(records.history[0, fine, :3].astype(float)), true)
    away, car = (np.degrees(attitude.wrap(_euler(q) - place)) for q in (found, true))
    return t[fine], away, car


def settled_s(results: Results, within_deg: float) -> Array:
    """Return the times (R,), s into the fine phase, from which on the azimuth stays near its own last value; NaN for a lost run."""
    records, criteria = results.records, results.records.criteria
    t = np.asarray(criteria.history_t)
    fine = t > criteria.coarse_s
    error = records.history[:, fine, 2].astype(np.float64)
    away = np.degrees(np.abs(attitude.wrap(error - error[:, -1:])))
    times = np.append(0.0, t[fine] - criteria.coarse_s)[
        (np.arange(1, fine.sum() + 1) * (away > within_deg)).max(axis=1)
    ]
    return np.where(records.unfinished, np.nan, times)


def _euler(q: Array) -> Array:
    return np.stack(attitude.to_euler(attitude.to_dcm(q)), axis=-1)


def level(name: str, what: str, points: int = 0) -> Reader:
    """Make a reader of the standard deviation over runs of an angle at the end, deg.

    ``what`` is "found", "true", or "error", which is their difference.
    """

    def read(results: Results) -> Estimate:
        found, true = (part[:, ANGLES.index(name)] for part in angles(results, points))
        of = {"found": found, "true": true, "error": found - true}[what]
        return capped_rms(np.degrees(of), TILT_DEG, about_mean=True)

    return read


def excursion(after_s: float) -> Reader:
    """Make a reader of the largest effect of a disturbance at ``after_s`` s on the azimuth, deg RMS over runs.

    The effect is the difference from the same run without it, with the same sensors and the same car.
    """

    def read(disturbed: Results, quiet: Results) -> Estimate:
        return capped_rms(_since(disturbed, quiet, after_s).max(axis=1), failed_deg(quiet))

    return read


def left(disturbed: Results, quiet: Results) -> Estimate:
    """Read the effect that a disturbance leaves at the end, deg RMS over runs."""
    effect = np.degrees(end_errors(disturbed)[:, 2] - end_errors(quiet)[:, 2])
    return capped_rms(effect, failed_deg(quiet))


def recovery(after_s: float, within_deg: float) -> Reader:
    """Make a reader of the time after ``after_s`` s until the effect stays within ``within_deg``, s, median over runs."""

    def read(disturbed: Results, quiet: Results) -> Estimate:
        away = _since(disturbed, quiet, after_s)
        beyond = np.arange(1, away.shape[1] + 1) * (away > within_deg)
        lost = ~np.isfinite(away).all(axis=1)
        return median(np.where(lost, np.nan, beyond.max(axis=1).astype(float)))

    return read


def _since(disturbed: Results, quiet: Results, after_s: float) -> Array:
    """Return the size of the difference in azimuth from ``after_s`` on, deg, (R, seconds); NaN for a lost run."""
    difference = disturbed.records.history[:, :, 2].astype(np.float64) - quiet.records.history[:, :, 2]
    later = disturbed.records.criteria.history_t > after_s + 1e-6
    return np.degrees(np.abs(attitude.wrap(difference[:, later])))
