"""Figures of sensors and flights."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.show.style import new_figure
from sins_env.recordings import Recording, seconds
from sins_env.sensors.allan import Allan, Budget, allan_deviation, expected_allan
from sins_env.sensors.imu import Imu
from sins_env.specs import ImuSpec
from sins_env.trajectory import FlightPlan
from sins_env.units import DEG, DEG_PER_H, UG

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


RATE_HZ, DURATION_S = 100.0, 3600.0  #: sampling rate and duration of the simulated IMU at rest
_COLORS = ("tab:blue", "tab:orange", "tab:green")


def simulate_at_rest(spec: ImuSpec, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return increments of gyros (rad) and accelerometers (m/s) without any input, (N, 3) each: their errors alone."""
    imu = Imu(spec, 1.0 / RATE_HZ)
    imu.reset([rng.spawn(6)])
    still = np.zeros((1, 1, round(DURATION_S * RATE_HZ), 3))
    dtheta, dvel = imu.measure(still, still)
    return dtheta[0, 0], dvel[0, 0]


def allan_figure(
    subject: ImuSpec | Recording,
    title: str,
    rng: np.random.Generator | None = None,
    window: tuple[float, float] | None = None,
    datasheet: ImuSpec | None = None,
    name: str = "datasheet",
) -> Figure:
    """Draw the Allan deviation of three gyros and three accelerometers, with 1-sigma bands, beside the datasheet.

    Args:
        subject: IMU spec, which is simulated for an hour at rest, or a recording.
        title: title of the figure.
        rng: generator of the simulation, needed for a spec.
        window: start and length in s of the part of a recording to show; None shows all of it.
        datasheet: spec of the recording's sensors, if it is known.
        name: what the spec is, for the legend.

    Raises:
        ValueError: a spec without a generator, or a window outside the recording or over a gap.
    """
    if isinstance(subject, Recording):
        rate, increments = subject.rate_hz, _cut(subject, window)
    elif rng is None:
        raise ValueError("rng is missing; allowed: a numpy Generator, for a simulated sensor")
    else:
        rate, increments, datasheet = RATE_HZ, simulate_at_rest(subject, rng), subject
    figure = new_figure(11.0, 4.8, dpi=110)
    axes = figure.subplots(1, 2)
    measured = [allan_deviation(part, 1.0 / rate) for part in increments]
    budgets: tuple[Budget | None, Budget | None] = (None, None)
    if datasheet is not None:
        budgets = expected_allan(datasheet, measured[0].tau, moving=isinstance(subject, Recording))
    units = (("gyros", "deg/h", DEG_PER_H), ("accelerometers", "ug", UG))
    for ax, allan, budget, (kind, unit, scale) in zip(axes, measured, budgets, units, strict=True):
        _draw(ax, allan, budget, scale, name)
        ax.set(
            title=kind,
            xlabel="averaging time, s",
            ylabel=f"Allan deviation, {unit}",
            xscale="log",
            yscale="log",
        )
        ax.grid(which="both", alpha=0.25)
    figure.suptitle(title)
    return figure


def _cut(recording: Recording, window: tuple[float, float] | None) -> tuple[Array, Array]:
    start, length = window or (recording.t0, recording.end - recording.t0)
    first = round((start - recording.t0) * recording.rate_hz)
    last = first + round(length * recording.rate_hz)
    if not 0 <= first < last <= len(recording.dtheta):
        raise ValueError(f"window = {window!r}; allowed: within {seconds(recording.t0)} to {seconds(recording.end)} s")
    dtheta, dvel = recording.dtheta[first:last], recording.dvel[first:last]
    missing = np.flatnonzero(np.isnan(dtheta[:, 0]))
    if len(missing):
        at = start + missing[0] / recording.rate_hz
        raise ValueError(
            f"{recording.name}: IMU samples are missing from {seconds(at)} s on; allowed: windows without a gap"
        )
    return dtheta, dvel


def _draw(ax: Axes, allan: Allan, budget: Budget | None, scale: float, whole: str) -> None:
    """Draw one panel; parts that are zero have no place on logarithmic axes and are left out."""
    if not allan.adev.any():
        ax.text(0.5, 0.5, "no errors", transform=ax.transAxes, ha="center")
        return
    for i, (axis, color) in enumerate(zip(("right", "forward", "up"), _COLORS, strict=True)):
        adev, error = allan.adev[:, i] / scale, allan.standard_error[:, i] / scale
        ax.plot(allan.tau, adev, color=color, lw=1.2, label=axis)
        low = np.maximum(adev - error, 0.1 * adev)
        ax.fill_between(allan.tau, low, adev + error, color=color, alpha=0.2, lw=0)
    if budget is not None:
        parts = (("white noise", "--"), ("Gauss-Markov", "-."), ("pulses", ":"))
        for part, (name, style) in zip(budget, parts, strict=True):
            if part.any():
                ax.plot(allan.tau, part / scale, color="gray", ls=style, lw=1.0, label=name)
        ax.plot(allan.tau, budget.total / scale, color="black", lw=1.4, label=whole, zorder=0)
    ax.set_ylim(bottom=0.3 * allan.adev.min() / scale)  # parts far below the sum would only stretch the axis
    ax.legend(fontsize=8)


def flight_figure(plan: FlightPlan, title: str) -> Figure:
    """Draw ground track, height, speed and attitude over time, with dots and lines at the borders of segments."""
    t, segment, at, moved = plan.track()
    corners = np.flatnonzero(np.diff(segment)) + 1
    figure = new_figure(11.0, 6.6, dpi=110)
    grid = figure.add_gridspec(3, 2)
    track = figure.add_subplot(grid[:, 0])
    east, north = moved[:, 0] / 1e3, moved[:, 1] / 1e3
    track.plot(east, north, color=_COLORS[0], lw=1.2)
    track.plot(east[corners], north[corners], ".", color="gray", ms=5)
    for i, mark, name in ((0, "o", "start"), (-1, "s", "end")):
        track.plot(east[i], north[i], mark, color=_COLORS[1], label=name)
    track.set(xlabel="East, km", ylabel="North, km", title="ground track")
    track.set_aspect("equal", adjustable="datalim")
    track.legend(fontsize=8)
    speed = np.sqrt(np.sum(at.vel**2, axis=-1))
    angles = at.angles / DEG
    panels = (
        ("height, m", {"": plan.height_m + moved[:, 2]}),
        ("speed, m/s", {"": speed}),
        ("attitude, deg", {"heading": angles[:, 0], "pitch": angles[:, 1], "roll": angles[:, 2]}),
    )
    for row, (label, lines) in enumerate(panels):
        ax = figure.add_subplot(grid[row, 1])
        for (name, values), color in zip(lines.items(), _COLORS, strict=False):
            ax.plot(t, values, color=color, lw=1.2, label=name)
        for end in plan.ends_s[:-1]:
            ax.axvline(end, color="gray", lw=0.5, alpha=0.5)
        ax.set(ylabel=label, xlim=(0, plan.duration_s))
        ax.ticklabel_format(axis="y", useOffset=False)
        if len(lines) > 1:
            ax.legend(fontsize=8)
    ax.set_xlabel("time, s")
    for ax in figure.axes:
        ax.grid(alpha=0.25)
    figure.suptitle(title)
    return figure
