"""Disturbances of the car of rlg_parked_car.npz, beside those of the simulated car.

    python benchmarks/car_disturbances.py                       the numbers that sins_env/trajectory/car.py states
    python benchmarks/car_disturbances.py --plot car.png        angles, velocities and spectra, recorded and simulated

The recording is in the folder $SINS_ENV_DATA. The simulated car has the same sensors and goes through the same analysis.
The model is in docs/mathematics/simulation.md#parked-car.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from scipy import optimize, signal

import sins_env  # noqa: F401  registers the environment
from sins_env import attitude, earth, recordings

Array = NDArray[np.float64]

RATE_HZ = 100.0
BUSY, QUIET = (0.0, 550.0), (680.0, 980.0)  #: s, times with people at the car, and with nobody
BAND_HZ = (0.5, 8.0)  #: band of the velocities
EVENT_RATE = 6e-4  #: rad/s, RMS over a second that marks an event; a quiet second has 1e-4
APART_S = 2.0  #: s, least time between two events
#: Times of free oscillations, s: after a door, a person or a shift of weight, until the next event.
FREE = ((992.8, 997.0), (1014.2, 1018.0), (84.0, 88.0), (97.1, 101.0), (82.0, 83.5), (78.3, 79.3), (93.6, 96.0))
STRONG = ((992.0, 996.0), (1014.2, 1018.0), (92.5, 94.0))  #: those with velocities above the accelerometers' resolution
#: Motion to fit: column of rates and velocities, guesses of the frequencies in Hz, and times.
GUESSES: dict[str, tuple[int, tuple[float, ...], tuple[tuple[float, float], ...]]] = {
    "pitch rate": (0, (2.5,), FREE),
    "roll rate": (1, (2.2, 5.2), FREE),
    "yaw rate": (2, (2.9,), FREE),
    "surge": (4, (2.0,), STRONG),
    "heave": (5, (2.4,), STRONG),
}


@dataclass(frozen=True)
class Course:
    """Motion of a car without earth rate and gravity, about the axes right, forward, up."""

    angles: Array  #: (samples, 3) rad
    rates: Array  #: (samples, 3) rad/s
    vel: Array  #: (samples, 3) m/s, within BAND_HZ

    @classmethod
    def of(cls, dtheta: Array, dvel: Array, rate_ie_b: Array) -> Course:
        """Make it from increments (samples, 3): earth rate and gravity are removed, gravity as the car tilts."""
        rates = dtheta * RATE_HZ - rate_ie_b
        angles = np.cumsum(rates, axis=0) / RATE_HZ
        angles -= np.median(angles, axis=0)
        rest = np.median(dvel.reshape(-1, 100, 3).sum(axis=1), axis=0)
        accel = dvel * RATE_HZ - (rest - np.cross(angles, rest))
        low = signal.butter(4, BAND_HZ[1], fs=RATE_HZ, output="sos")
        band = signal.butter(2, BAND_HZ, "bandpass", fs=RATE_HZ, output="sos")
        vel = signal.sosfiltfilt(band, np.cumsum(accel - accel.mean(axis=0), axis=0) / RATE_HZ, axis=0)
        return cls(angles, signal.sosfiltfilt(low, rates, axis=0), vel)

    def part(self, span: tuple[float, float]) -> Course:
        """Cut out a span of time, s."""
        at = slice(*(round(RATE_HZ * t) for t in span))
        return Course(self.angles[at], self.rates[at], self.vel[at])

    def events(self) -> Iterator[tuple[int, int]]:
        """Yield the first and the last sample of each event."""
        power = signal.fftconvolve((self.rates**2).sum(axis=1), np.full(100, 0.01), "same")
        hot = np.flatnonzero(power > EVENT_RATE**2)
        for one in np.split(hot, np.flatnonzero(np.diff(hot) > APART_S * RATE_HZ) + 1):
            if len(one):
                yield int(one[0]), int(one[-1])

    def steps(self) -> Array:
        """Return the settled change of the angles, the peak rates and the peak velocities of each event, (events, 9)."""
        out = []
        for first, last in self.events():
            before, after = max(first - 150, 0), min(last + 150, len(self.rates) - 1)
            settled = self.angles[after : after + 100].mean(axis=0) - self.angles[
                max(before - 100, 0) : before + 1
            ].mean(axis=0)
            peaks = [np.abs(x[first : last + 1]).max(axis=0) for x in (self.rates, self.vel)]
            out.append(np.concatenate([settled, *peaks]))
        return np.array(out)


def recorded() -> Course:
    """Read the course of the recorded car."""
    recording = recordings.load("rlg_parked_car.npz")
    reference = recording.reference
    assert reference is not None
    C = attitude.to_dcm(reference.q_nb[len(reference.q_nb) // 2])
    return Course.of(recording.dtheta, recording.dvel, C.T @ earth.rate_n(earth.get("wgs84"), recording.site.latitude))


def simulated(duration: float, seed: int, **settings: Any) -> Course:
    """Play the simulated car for ``duration`` seconds, and return its course."""
    env: Any = gymnasium.make("SINS/AlignVehicle-v0", duration=duration, reveal_truth=True, **settings)
    obs, info = env.reset(seed=seed)
    start, parts, over = info["truth"]["q_nb"], [], False
    while not over:
        parts.append((obs["dtheta"], obs["dvel"]))
        obs, _, _, over, info = env.step(start)
    dtheta, dvel = (np.concatenate(column) for column in zip(*parts, strict=True))
    rate = earth.rate_n(earth.get("wgs84"), env.unwrapped.task.site.latitude)
    return Course.of(dtheta, dvel, attitude.to_dcm(start).T @ rate)


def free_modes(x: Array, guesses: tuple[float, ...]) -> tuple[Array, float]:
    """Fit damped sinusoids to x (samples,): their frequency in Hz and damping, (modes, 2), and the explained variance."""
    t = np.arange(len(x)) / RATE_HZ

    def residual(p: Array) -> Array:
        columns = [np.ones_like(t), t]
        for hz, zeta in p.reshape(-1, 2):
            w = 2 * np.pi * hz
            columns += [np.exp(-zeta * w * t) * wave(w * np.sqrt(1 - zeta**2) * t) for wave in (np.cos, np.sin)]
        B = np.stack(columns, axis=1)
        out: Array = (x - B @ np.linalg.lstsq(B, x, rcond=None)[0]) / x.std()
        return out

    start = np.array([[hz, 0.08] for hz in guesses])
    limits = (start * [0.7, 0] + [0, 0.005]).ravel(), (start * [1.4, 0] + [0, 0.6]).ravel()
    found = optimize.least_squares(residual, start.ravel(), bounds=limits)
    return found.x.reshape(-1, 2), 1 - float(np.mean(found.fun**2))


def show_modes(course: Course, console: Console) -> None:
    """Print frequency and damping of the free oscillations."""
    table = Table("free oscillation", "from, s", "Hz", "damping", "explained", title="Modes")
    for name, (column, guesses, spans) in GUESSES.items():
        found = []
        for span in spans:
            part = course.part(span)
            modes, explained = free_modes(np.hstack([part.rates, part.vel])[:, column], guesses)
            if explained > 0.45:
                found.append(modes)
                hz, zeta = (" ".join(f"{v:.2f}" for v in modes[:, i]) for i in (0, 1))
                table.add_row(name, f"{span[0]:g}", hz, zeta, f"{explained:.2f}")
        if found:
            middle = np.median(found, axis=0)
            hz, zeta = (" ".join(f"{v:.2f}" for v in middle[:, i]) for i in (0, 1))
            table.add_row(f"{name}, median of {len(found)}", "", hz, zeta, "", style="bold", end_section=True)
    console.print(table)


def show_events(courses: dict[str, Course], console: Console) -> None:
    """Print the number and the size of the events of each course."""
    heads = ("settled pitch, roll, yaw, mrad", "peak rates, mrad/s", "peak velocities R, F, U, mm/s")
    table = Table("events", "minutes", "number", *heads, title="Events: medians of those that tilt, and of the others")
    for name, course in courses.items():
        steps = 1e3 * course.steps()
        minutes = f"{len(course.rates) / RATE_HZ / 60:.1f}"
        tilt = np.hypot(steps[:, 0], steps[:, 1])
        kinds = {
            "people: tilt > 1.2 mrad": tilt > 1.2,
            "doors: 0.3 to 1.2": (tilt > 0.3) & (tilt <= 1.2),
            "none": tilt <= 0.3,
        }
        for kind, which in kinds.items():
            if which.any():
                values = [
                    " ".join(f"{v:.1f}" for v in np.median(np.abs(steps[which, i : i + 3]), axis=0)) for i in (0, 3, 6)
                ]
                table.add_row(f"{name}, {kind}", minutes, str(which.sum()), *values)
        table.add_section()
    console.print(table)


def show_lever(course: Course, console: Console) -> None:
    """Print the height of the IMU above the axes of roll and pitch, from v = w x r during events."""
    hot = np.concatenate([np.arange(a, b + 1) for a, b in course.events()])
    W, V = course.rates[hot], course.vel[hot]
    up = [np.linalg.lstsq(W, V[:, i], rcond=None)[0][j] * s for i, j, s in ((0, 1, 1.0), (1, 0, -1.0))]
    console.print(f"height of the IMU above the axes: {up[0]:.2f} m by roll, {up[1]:.2f} m by pitch")


def draw(courses: dict[str, Course], path: str) -> None:
    """Draw angles, velocities and spectra of each course."""
    figure = Figure((13, 3.2 * (len(courses) + 1)), layout="constrained")
    panels = figure.subplots(len(courses) + 1, 2, squeeze=False)
    for row, (name, course) in zip(panels, courses.items(), strict=False):
        t = np.arange(len(course.rates)) / RATE_HZ
        for j, label in enumerate(("pitch", "roll", "yaw")):
            row[0].plot(t, 1e3 * course.angles[:, j], linewidth=0.7, label=label)
        for j, label in enumerate(("right", "forward", "up")):
            row[1].plot(t, 1e3 * course.vel[:, j], linewidth=0.4, label=label)
        row[0].set(title=f"{name}: angles, mrad", ylim=(-6, 6))
        row[1].set(title=f"{name}: velocities of the IMU, mm/s", ylim=(-30, 30))
        for axes in row:
            axes.legend(fontsize=7, loc="upper right")
    for axes, (unit, what, column) in zip(
        panels[-1], (("(rad/s)^2/Hz", "rates", 1), ("(m/s)^2/Hz", "vel", 0)), strict=True
    ):
        for name, course in courses.items():
            f, P = signal.welch(getattr(course, what)[:, column], RATE_HZ, nperseg=2048)
            axes.loglog(f[1:], P[1:], linewidth=0.9, label=name)
        axes.set(title=f"{'roll rate' if what == 'rates' else 'velocity right'}, {unit}", xlim=(0.1, 12), xlabel="Hz")
        axes.legend(fontsize=7)
        axes.set_ylim(bottom=1e-12)
    figure.savefig(path, dpi=80)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--plot", metavar="FILE", help="draw recorded and simulated courses")
    parser.add_argument("--rate", type=float, default=2.0, help="simulated events per minute")
    given = parser.parse_args()
    console = Console(width=132)
    whole = recorded()
    busy = {
        "recorded": whole.part(BUSY),
        "simulated": simulated(550.0, 3, events="people", event_rate_per_min=given.rate),
    }
    show_modes(whole, console)
    show_events(busy, console)
    for course in busy.values():
        show_lever(course, console)
    if given.plot:
        quiet = {"recorded, quiet": whole.part(QUIET), "simulated, quiet": simulated(300.0, 1, events="quiet")}
        draw(busy | quiet, given.plot)
        console.print(f"figure: {given.plot}")


if __name__ == "__main__":
    main()
