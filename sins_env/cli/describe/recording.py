"""The verb ``describe`` for a recording: its contents."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from rich.console import Console

from sins_env import earth, recordings
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.show.rich_tables import titled
from sins_env.reading.files import following
from sins_env.recordings import first_few, seconds
from sins_env.specs import ImuSpec
from sins_env.units import DEG_PER_H


def is_recording(name: str) -> bool:
    """Return whether a name is that of a file, or has the ending of a recording."""
    endings = {".json", *(one.ending for one in recordings.FORMATS.values())}
    return Path(name).suffix.lower() in endings or Path(name).is_file()


def describe_recording(name: str, console: Console, imu: ImuSpec | None = None) -> bool:
    """Print the contents of a recording; ``imu`` is what is told of its sensors."""
    with Bar(f"reading {name}", total=1.0) as bar, following(bar.update):
        recording = recordings.load(name, accept=recordings.REFUSING)
        found, against = recordings.summarise(recording), recordings.findings(recording)
        north = recordings.north(recording, imu)
    table = titled(recording.name)
    table.show_header = False
    table.add_column(no_wrap=True)
    table.add_column(overflow="fold")
    site, begin, end = recording.site, seconds(recording.t0), seconds(recording.end)
    gnss, reference, lever = recording.gnss, recording.reference, recording.lever_arm
    gravity = float(earth.gravity(earth.get(site.earth), site.latitude, site.height))
    rows = {
        "samples": f"{len(recording.dtheta)} at {recording.rate_hz:g} Hz",
        "time": f"{begin} to {end} s, {recordings.told_time(recording)}",
        "missing": _gaps(found.gaps, "sample", "samples"),
        "site": f"{np.degrees(site.latitude):.6f}, {np.degrees(site.longitude):.6f} deg, {site.height:g} m",
        "GNSS": "none; a zero-velocity update stands in" if gnss is None else _fixes(gnss, found),
        "lever arm": "unknown; zero" if lever is None else f"{', '.join(f'{x:g}' for x in lever)} m right, forward, up",
        "reference": "none" if reference is None else _reference(reference, found),
        "displacements": _displacements(recording.displacements),
        "aids": ", ".join(f"{name} ({len(one.t_s)} readings)" for name, one in recording.aids.items()),
        "|f|": f"{_three(found.force, 1.0, '.4f')} m/s² (median and range of means over 1 s); gravity {gravity:.4f}",
        "|w|": f"{_three(found.rate, DEG_PER_H, '.4g')} deg/h",
        "at rest": _spans(found.rest),
        "first heading": _heading(found) if north.found else f"none: {north}",
    }
    if gnss is None:
        del rows["lever arm"]
    if recording.displacements is None:
        del rows["displacements"]
    if not recording.aids:
        del rows["aids"]
    for key, text in rows.items():
        table.add_row(key, text)
    console.print(table)
    for one in against:
        kind = "refused unless accepted" if one.wrong else "warning"
        console.print(f"{kind}: {one}", markup=False, highlight=False, soft_wrap=True)
    return True


def _three(values: tuple[float, float, float], unit: float, form: str) -> str:
    low, middle, high = (format(value / unit, form) for value in values)
    return f"{middle} ({low} to {high})"


def _gaps(gaps: list[recordings.Gap], one: str, many: str, most: int = 8) -> str:
    """Return the number of missing samples, and the first ``most`` gaps with their times."""
    if not gaps:
        return f"no {one}"
    parts = [f"{gap.samples} from {seconds(gap.start)} to {seconds(gap.end)} s" for gap in gaps]
    count = sum(gap.samples for gap in gaps)
    return f"{count} {one if count == 1 else many}: {first_few(parts, most)}"


def _fixes(gnss: recordings.Gnss, found: recordings.Summary) -> str:
    kind = "" if gnss.vel is not None else ", positions only"
    rate = f" at {found.fix_rate_hz:.4g} Hz" if found.fix_rate_hz else ""
    return f"{len(gnss.t_s)} fixes{rate}{kind}; missing: {_gaps(found.fix_gaps, 'fix', 'fixes')}"


def _reference(reference: recordings.Reference, found: recordings.Summary) -> str:
    more = [name for name, part in (("velocities", reference.vel), ("positions", reference.pos)) if part is not None]
    rest = f" with {' and '.join(more)}" if more else ""
    return f"{len(reference.t_s)} attitudes at {found.reference_rate_hz or 0:.4g} Hz{rest}"


def _displacements(moved: recordings.Displacements | None) -> str:
    if moved is None:
        return ""
    return (
        f"{len(moved.t_s)} of the antenna in {moved.span_s:g} s by carrier phase, {moved.usable.sum()} to be relied on"
    )


def _spans(spans: list[tuple[float, float]], most: int = 8) -> str:
    if not spans:
        return "never for 5 s"
    total = sum(end - start for start, end in spans)
    parts = [f"{seconds(start)} to {seconds(end)} s" for start, end in spans]
    return f"{total:.0f} s in all: {first_few(parts, most)}"


def _heading(found: recordings.Summary) -> str:
    """Return the estimated first heading, that from either half of its data, and that of the reference."""
    guess = found.guess
    if guess is None:
        return "no 20 s without a gap before it moves"
    heading, pitch, roll = np.degrees(guess.angles)
    one, two = np.degrees(guess.halves) % 360
    text = (
        f"{heading:.2f} deg, pitch {pitch:.2f}, roll {roll:.2f} at {seconds(guess.start)} s, from gravity's drift until "
        f"{seconds(guess.end)} s (either half alone: {one:.2f}, {two:.2f})"
    )
    reference = found.reference_heading
    return text if reference is None else f"{text}; reference {np.degrees(reference):.2f}"
