"""What ``render()`` draws: the attitude of the base, and the error history against the floor that the sensors set."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.specs import ARCSEC, DEG_PER_H, UG
from sins_env.types import Task

Array = NDArray[np.float64]


def sensor_floor(task: Task) -> tuple[float, float]:
    """1-sigma level and azimuth errors, rad, that constant biases leave on a base at rest: accel/g, gyro/(rate cos L)."""
    model = earth.get(task.site.earth)
    level = task.prior.accel_bias_std_ug * UG / float(earth.gravity(model, task.site.latitude))
    azimuth = task.prior.gyro_bias_std_deg_h * DEG_PER_H / (model.rate * math.cos(task.site.latitude))
    return level, azimuth


class Renderer:
    """Keeps one run's errors and draws them with Matplotlib's Agg canvas."""

    def __init__(self, task: Task) -> None:
        self.reset(task)

    def reset(self, task: Task) -> None:
        self._task = task
        self._t: list[float] = []
        self._phi: list[Array] = []
        self._q: Array = np.array([1.0, 0.0, 0.0, 0.0])

    def add(self, t: float, q_nb: Array, phi: Array, failed: bool) -> None:
        self._t.append(t)
        self._phi.append(phi)
        if not failed:
            self._q = attitude.normalize(q_nb / np.max(np.abs(q_nb)))

    def draw(self) -> NDArray[np.uint8]:
        """(480, 960, 3) RGB."""
        from matplotlib.backends.backend_agg import FigureCanvasAgg  # slow to import, needed only to draw
        from matplotlib.figure import Figure

        figure = Figure(figsize=(9.6, 4.8), dpi=100, layout="constrained")
        canvas = FigureCanvasAgg(figure)
        grid = figure.add_gridspec(1, 2, width_ratios=(1, 1.6))
        base = figure.add_subplot(grid[0], projection="3d")
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
        errors = figure.add_subplot(grid[1])
        phi = np.abs(np.array(self._phi).reshape(-1, 3)) / ARCSEC
        for values, name, color in zip(
            phi.T, ("E", "N", "U (azimuth)"), ("tab:green", "tab:olive", "tab:blue"), strict=True
        ):
            errors.plot(self._t, np.maximum(values, 1e-2), label=name, color=color, lw=1)
        for value, color in zip(sensor_floor(self._task), ("tab:olive", "tab:blue"), strict=True):
            errors.axhline(value / ARCSEC, color=color, ls="--", lw=0.8)
        errors.set(
            xlabel="time, s",
            ylabel="|misalignment|, arcsec",
            yscale="log",
            xlim=(0, self._task.duration_s),
            ylim=(1, 7e5),
        )
        errors.set_title("errors; dashed: what the told biases leave (1 sigma)", fontsize=9)
        errors.grid(alpha=0.3)
        errors.legend(loc="upper right", fontsize=8)
        canvas.draw()
        return np.asarray(canvas.buffer_rgba())[..., :3].copy()
