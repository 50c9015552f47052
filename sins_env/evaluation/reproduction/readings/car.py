"""Readings of the tables of the parked car: angles at the end, and the effect of a disturbance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.reproduction.readings.common import Reader, end_errors
from sins_env.evaluation.reproduction.verdicts import NOTHING, Estimate, root_mean_square
from sins_env.evaluation.score.resampling import percentile_interval, resampled_medians
from sins_env.evaluation.score.results import Results

ANGLES = ("heading", "pitch", "roll")


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


def azimuth(points: int = 0, about_mean: bool = True) -> Reader:
    """Make a reader of the azimuth error at the end, deg: its standard deviation over runs, or its RMS."""

    def read(results: Results) -> Estimate:
        return root_mean_square(np.degrees(end_errors(results, points)[:, 2]), about_mean)

    return read


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


def _euler(q: Array) -> Array:
    return np.stack(attitude.to_euler(attitude.to_dcm(q)), axis=-1)


def level(name: str, what: str, points: int = 0) -> Reader:
    """Make a reader of the standard deviation over runs of an angle at the end, deg.

    ``what`` is "found", "true", or "error", which is their difference.
    """

    def read(results: Results) -> Estimate:
        found, true = (part[:, ANGLES.index(name)] for part in angles(results, points))
        return root_mean_square(
            np.degrees({"found": found, "true": true, "error": found - true}[what]), about_mean=True
        )

    return read


def excursion(after_s: float) -> Reader:
    """Make a reader of the largest effect of a disturbance at ``after_s`` s on the azimuth, deg RMS over runs.

    The effect is the difference from the same run without it, with the same sensors and the same car.
    """

    def read(disturbed: Results, quiet: Results) -> Estimate:
        return root_mean_square(_since(disturbed, quiet, after_s).max(axis=1))

    return read


def left(disturbed: Results, quiet: Results) -> Estimate:
    """Read the effect that a disturbance leaves at the end, deg RMS over runs."""
    return root_mean_square(np.degrees(end_errors(disturbed)[:, 2] - end_errors(quiet)[:, 2]))


def recovery(after_s: float, within_deg: float) -> Reader:
    """Make a reader of the time after ``after_s`` s until the effect stays within ``within_deg``, s, median over runs."""

    def read(disturbed: Results, quiet: Results) -> Estimate:
        away = _since(disturbed, quiet, after_s)
        known = away[np.isfinite(away).all(axis=1)]
        if len(known) < 2:
            return Estimate(np.nan, np.nan, np.nan, len(known), len(away) - len(known))
        beyond = np.arange(1, away.shape[1] + 1) * (known > within_deg)
        times = beyond.max(axis=1).astype(float)
        low, high = percentile_interval(resampled_medians(times))
        return Estimate(float(np.median(times)), low, high, len(known), len(away) - len(known))

    return read


def _since(disturbed: Results, quiet: Results, after_s: float) -> Array:
    """Return the size of the difference in azimuth from ``after_s`` on, deg, (R, seconds); NaN for a lost run."""
    difference = disturbed.records.history[:, :, 2].astype(np.float64) - quiet.records.history[:, :, 2]
    later = disturbed.records.criteria.history_t > after_s + 1e-6
    return np.degrees(np.abs(attitude.wrap(difference[:, later])))
