"""The picture that ``render()`` draws: the attitude of the base, and the errors against the floor of the sensors."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.types import Task
from sins_env.units import ARCSEC, DEG_PER_H, UG

_COLORS = ("tab:green", "tab:olive", "tab:blue")  #: colours of the components in the order E, N, U


def sensor_floor(task: Task) -> tuple[float, float]:
    """Return the 1-sigma level and azimuth errors, rad, that constant biases leave on a base at rest.

    They are accelerometer bias / g and gyro bias / (Earth's rate cos L).
    """
    model = earth.get(task.site.earth)
    level = task.prior.accel_bias_std_ug * UG / float(earth.gravity(model, task.site.latitude))
    azimuth = task.prior.gyro_bias_std_deg_h * DEG_PER_H / (model.rate * math.cos(task.site.latitude))
    return level, azimuth


class Renderer:
    """A record of one run's errors that draws itself with Matplotlib's Agg canvas."""

    def __init__(self, task: Task) -> None:
        self.reset(task)

    def reset(self, task: Task) -> None:
        """Begin an episode of this task."""
        self._task = task
        self._t: list[float] = []
        self._phi: list[Array] = []
        self._pos: list[Array] = []
        self._q: Array = np.array([1.0, 0.0, 0.0, 0.0])

    def add(self, t: float, action: Array, errors: dict[str, Array], failed: bool) -> None:
        """Add an epoch: its end in s, the action, and its errors E, N, U in rad and m."""
        self._t.append(t)
        self._phi.append(errors["phi"])
        if "pos" in errors:
            self._pos.append(errors["pos"])
        if not failed:
            self._q = attitude.normalize(action[:4] / np.max(np.abs(action[:4])))

    def draw(self) -> NDArray[np.uint8]:
        """Draw the picture, RGB, (480, 960, 3)."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import, needed only to draw
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.6, 4.8), dpi=100, layout="constrained")
        canvas = FigureCanvasAgg(figure)
        navigate = self._task.navigate
        grid = figure.add_gridspec(1 + navigate, 2, width_ratios=(1, 1.6))
        self._draw_base(figure.add_subplot(grid[:, 0], projection="3d"))
        phi = figure.add_subplot(grid[0, 1])
        self._draw_errors(phi, self._phi, ARCSEC, ("E", "N", "U (azimuth)"), "|misalignment|, arcsec", (1, 7e5))
        if navigate:
            pos = figure.add_subplot(grid[1, 1], sharex=phi)
            self._draw_errors(pos, self._pos, 1.0, ("E", "N", "U"), "|position error|, m", (1e-2, 1e4))
        else:
            for value, color in zip(sensor_floor(self._task), _COLORS[1:], strict=True):
                phi.axhline(value / ARCSEC, color=color, ls="--", lw=0.8)
            phi.set_title("errors; dashed: what the told biases leave (1 sigma)", fontsize=9)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()

    def _draw_base(self, base: Any) -> None:
        C = attitude.to_dcm(self._q)
        corners = np.array([[-0.5, -1, 0], [0.5, -1, 0], [0.5, 0.6, 0], [0, 1, 0], [-0.5, 0.6, 0], [-0.5, -1, 0]]) @ C.T
        base.plot(*corners.T, color="tab:blue", lw=2)
        for axis, name, color in zip(
            C.T, ("right", "forward", "up"), ("tab:green", "tab:red", "tab:gray"), strict=True
        ):
            base.plot(*np.stack([np.zeros(3), 0.9 * axis]).T, color=color)
            base.text(*axis, name, color=color, ha="center")
        base.set(xlim=(-1, 1), ylim=(-1, 1), zlim=(-1, 1), xlabel="East", ylabel="North")
        base.set(xticks=[-1, 0, 1], yticks=[-1, 0, 1], zticks=[], xticklabels=[], yticklabels=[])
        base.set_box_aspect(None, zoom=0.9)
        heading, pitch, roll = (math.degrees(float(a)) for a in attitude.to_euler(C))
        base.set_title(f"heading {heading % 360:.2f}\npitch {pitch:+.2f}  roll {roll:+.2f} deg", fontsize=9)

    def _draw_errors(
        self, ax: Any, errors: list[Array], unit: float, names: tuple[str, ...], label: str, limits: tuple[float, float]
    ) -> None:
        values = np.abs(np.array(errors).reshape(-1, 3)) / unit
        for value, name, color in zip(values.T, names, _COLORS, strict=True):
            ax.plot(self._t, np.maximum(value, 1e-2 * limits[0]), label=name, color=color, lw=1)
        ax.set(xlabel="time, s", ylabel=label, yscale="log", xlim=(0, self._task.duration_s), ylim=limits)
        ax.grid(alpha=0.3)
        ax.legend(loc="upper right", fontsize=8)
