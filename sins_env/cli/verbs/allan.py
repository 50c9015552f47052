"""The verb ``allan``: the noise of an IMU at rest, as a table, a figure and a specification."""

from __future__ import annotations

import json
import math
from argparse import Namespace
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from sins_env import checks, earth, recordings
from sins_env.arrays import Array
from sins_env.cli.describe.figures import allan_figure
from sins_env.cli.output import check_plot, remark, save_figure
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.show.numbers import number_text
from sins_env.evaluation.show.rich_tables import titled
from sins_env.reading.datasheets import to_kalibr, told
from sins_env.reading.documents import YAML_ENDINGS
from sins_env.recordings import Recording, on_clock, seconds
from sins_env.recordings.summary import spans_at_rest
from sins_env.sensors.noise_fit import LEAST_TIMES, MOST_MISFIT, NAMES, NoiseFit, fit_markov, fit_noise, imu_fields
from sins_env.specs import IMU_PRESETS, ImuSpec, imu_spec
from sins_env.units import ARCSEC, DEG_PER_H, DEG_PER_SQRT_H, UG
from sins_env.writing.files import replacing

AXES = ("right", "forward", "up")
LEAST_S = 60.0  #: shortest span of data that is fitted, s
#: Units of Q, N, B and K.
GYRO_UNITS = (
    ("arcsec", ARCSEC),
    ("deg/sqrt(h)", DEG_PER_SQRT_H),
    ("deg/h", DEG_PER_H),
    ("deg/h/sqrt(h)", DEG_PER_H / 60),
)
ACCEL_UNITS = (("m/s", 1.0), ("ug/sqrt(Hz)", UG), ("ug", UG), ("ug/sqrt(h)", UG / 60))
WHAT = ("quantisation", "white noise", "flicker", "random walk")


def allan(given: Namespace, console: Console) -> int:
    """Fit the noise of a recording at rest; print it, draw it, and write it as a specification. Return the exit code.

    Raises:
        ValueError: no rest of a minute, a gap, or a file whose ending says no known form.
    """
    if given.plot:
        check_plot(given.plot)
    if given.out and Path(given.out).suffix.lower() not in (".json", *YAML_ENDINGS):
        raise checks.refused("--out", given.out, f"a file that ends in .json, {', '.join(YAML_ENDINGS)}")
    base = IMU_PRESETS["perfect"] if given.imu is None else imu_spec(told(given.imu, IMU_PRESETS, "IMU preset"))
    with Bar(f"noise of {given.file}"):
        recording = recordings.load(given.file, accept=given.accept or None)
        start, end = _span(recording, given.window)
        first, last = (round((t - recording.t0) * recording.rate_hz) for t in (start, end))
        parts = [part[first:last] for part in (recording.dtheta, recording.dvel)]
        gyro, accel = (fit_noise(part, 1.0 / recording.rate_hz, given.least) for part in parts)
    fields = {**imu_fields(fit_markov(gyro), fit_markov(accel)), **_biases(recording, parts, base)}
    fields = {name: float(f"{value:.5g}") for name, value in fields.items()}
    spec = imu_spec(fields, base)
    title = f"{recording.name}, {seconds(start)} to {seconds(end)} s at {recording.rate_hz:g} Hz"
    console.print(_table(title, gyro, accel))
    console.print(
        f"--imu {','.join(f'{name}={value:g}' for name, value in fields.items())}", highlight=False, soft_wrap=True
    )
    notes = [
        *_misfits(recording, parts, gyro, accel),
        "biases are those of one switch-on, as far as gravity and the earth's rate show them",
        "scale factors and misalignment do not show at rest"
        + (f"; they are those of {given.imu}" if given.imu else ""),
    ]
    for note in notes:
        remark(note)
    if given.out:
        _write(
            Path(given.out),
            fields if given.imu is None else asdict(spec),
            [f"Noise of {title}", *_lines(gyro, accel), *notes],
        )
    if given.kalibr:
        values = {**to_kalibr(asdict(spec)), "rostopic": "/imu0", "update_rate": recording.rate_hz}
        _write(
            Path(given.kalibr), values, [f"Noise of {title}", "Kalibr advises to enlarge values from rest before use"]
        )
    if given.plot:
        figure = allan_figure(recording, title, window=(start, end - start), datasheet=spec, name="fitted")
        save_figure(figure, given.plot)
    return 0


def _span(recording: Recording, window: Any) -> tuple[float, float]:
    """Return the span (start, end), s, that is told, or the longest one at rest.

    Raises:
        ValueError: less than a minute, a span outside the recording, or one with a gap.
    """
    if window:
        start = on_clock(recording, window[0])
        end = start + window[1]
    else:
        rest = spans_at_rest(recording)
        start, end = max(rest, key=lambda span: span[1] - span[0], default=(recording.t0, recording.t0))
    if end - start < LEAST_S:
        what = f"a window of {end - start:g} s" if window else f"at rest for {end - start:g} s at most"
        raise ValueError(
            f"{recording.name}: {what}; allowed: at least {LEAST_S:g} s, or --window START LENGTH with such a rest"
        )
    if start < recording.t0 - 0.5 / recording.rate_hz or end > recording.end + 0.5 / recording.rate_hz:
        whole = f"{seconds(recording.t0)} to {seconds(recording.end)} s"
        raise ValueError(
            f"window from {seconds(start)} to {seconds(end)} s of {recording.name}; allowed: within {whole}"
        )
    for gap in recording.gaps:
        if gap.start < end and gap.end > start:
            raise ValueError(f"{recording.name}: samples are missing, {gap}; allowed: a window without a gap")
    return start, end


def _biases(recording: Recording, parts: list[Array], base: ImuSpec) -> dict[str, float]:
    """Return the biases that show: of the gyros along and across gravity, of the accelerometers in the length of the force.

    The heading hides a third of the gyros' and two thirds of the accelerometers', so that larger ones of ``base`` stay.
    """
    site, rate = recording.site, recording.rate_hz
    model = earth.get(site.earth)
    w, f = (part.mean(axis=0) * rate for part in parts)
    force = float(np.linalg.norm(f))
    up = float(w @ f) / force
    level = math.sqrt(max(float(w @ w) - up * up, 0.0))
    _, north, vertical = earth.rate_n(model, site.latitude).tolist()
    gyro = math.hypot(up - vertical, level - north) / math.sqrt(2.0)
    accel = abs(force - float(earth.gravity(model, site.latitude, site.height)))
    return {
        "gyro_bias_deg_h": max(gyro / DEG_PER_H, base.gyro_bias_deg_h),
        "accel_bias_ug": max(accel / UG, base.accel_bias_ug),
    }


def _misfits(recording: Recording, parts: list[Array], gyro: NoiseFit, accel: NoiseFit) -> Iterator[str]:
    """Yield a warning for sensors whose Allan variance is not that of noise, with averaging times that would fit."""
    for kind, part, fit in (("gyros", parts[0], gyro), ("accelerometers", parts[1], accel)):
        worst = float(fit.misfit.max())
        if worst <= MOST_MISFIT:
            continue
        text = f"warning: the {kind} are not at rest, or have other noise: chi-square of the fit is {worst:.3g} times its size"
        for least in fit.tau[1 : 1 - LEAST_TIMES]:
            if fit_noise(part, 1.0 / recording.rate_hz, float(least)).misfit.max() <= MOST_MISFIT:
                yield f"{text}; from averaging times of {least:g} s on they fit: --from {least:g}"
                break
        else:
            yield f"{text}, at all averaging times"


def _cells(fit: NoiseFit, units: tuple[tuple[str, float], ...]) -> Any:
    """Yield the name of each coefficient with its unit, and for each axis its value and interval."""
    for i, (name, what, (unit, size)) in enumerate(zip(NAMES, WHAT, units, strict=True)):
        values = [
            (
                number_text(fit.coefficients[axis, i] / size),
                number_text(low / size),
                number_text(fit.high[axis, i] / size),
            )
            for axis, low in enumerate(fit.low[:, i])
        ]
        yield (
            f"{name}, {what}",
            unit,
            [
                f"{value} ({low} to {high})" if fit.coefficients[axis, i] else f"below {high}"
                for axis, (value, low, high) in enumerate(values)
            ],
        )


def _table(title: str, gyro: NoiseFit, accel: NoiseFit) -> Table:
    table = titled(f"{title}; 95 % intervals")
    table.add_column("")
    for axis in AXES:
        table.add_column(axis)
    for kind, fit, units in (("gyros", gyro, GYRO_UNITS), ("accelerometers", accel, ACCEL_UNITS)):
        table.add_row(f"[bold]{kind}[/]")
        for name, unit, cells in _cells(fit, units):
            table.add_row(f"{name}\n{unit}", *(cell.replace(" (", "\n(") for cell in cells))
        table.add_section()
    return table


def _lines(gyro: NoiseFit, accel: NoiseFit) -> list[str]:
    """Return the table as lines of comments."""
    return [
        f"{kind} {name}, {unit}, right, forward, up: {'; '.join(cells)}"
        for kind, fit, units in (("gyro", gyro, GYRO_UNITS), ("accelerometer", accel, ACCEL_UNITS))
        for name, unit, cells in _cells(fit, units)
    ]


def _write(path: Path, values: Mapping[str, Any], comments: list[str]) -> None:
    """Write values as YAML with comments, or as JSON, which has none."""
    if path.suffix.lower() == ".json":
        text = json.dumps(values, indent=1) + "\n"
    else:
        text = "".join(f"# {line}\n" for line in comments) + "".join(
            f"{name}: {value!r}\n" for name, value in values.items()
        )
    with replacing([path]) as (new,):
        new.write_text(text)
    print(path, flush=True)
