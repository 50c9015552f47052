"""Figures of flights: the path from above, and the height over time."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from sins_env import earth
from sins_env.evaluation.reproduction.pictures.common import plain
from sins_env.evaluation.reproduction.tables import Picture
from sins_env.evaluation.show.style import COLOURS, new_figure
from sins_env.evaluation.tasks.task import EvaluationTask

if TYPE_CHECKING:
    from matplotlib.figure import Figure

KM = 1000.0
PART = 1000  #: epochs whose motion is worked out at once


def path(name: str, caption: str, task: EvaluationTask) -> Picture:
    """Return a picture of the flight of a task, which is the same in every run."""
    return Picture(name, caption, lambda _: _draw(task))


def _draw(task: EvaluationTask) -> Figure:
    env = task.make(1)
    task.reset(env, [0])
    episode: Any = env.unwrapped.episode  # type: ignore[attr-defined]
    public, trajectory = episode.task, episode.world.trajectory
    parts = [range(k, min(k + PART, public.num_epochs)) for k in range(0, public.num_epochs, PART)]
    pos = np.concatenate([trajectory.chunk(part.start, len(part)).state.pos[0] for part in parts])
    pos = pos[:: max(round(1.0 / public.epoch_s), 1)]
    t = np.linspace(0.0, public.num_epochs * public.epoch_s, len(pos))
    env.close()
    away = earth.offset(earth.get(public.site.earth), pos[:1], pos) / KM
    figure = new_figure(11.0, 4.2)
    above, height = figure.subplots(1, 2)
    above.plot(away[:, 0], away[:, 1], color=COLOURS[0], linewidth=1.6)
    above.plot(0.0, 0.0, "o", color=COLOURS[1], label="start")
    above.set(xlabel="east, km", ylabel="north, km", aspect="equal", adjustable="datalim")
    above.legend(frameon=False, fontsize=9)
    height.plot(t, pos[:, 2], color=COLOURS[0], linewidth=1.6)
    height.set(xlabel="time, s", ylabel="height, m", xlim=(0, t[-1]))
    for axes, title in ((above, "from above"), (height, "height")):
        axes.set_title(title, loc="left", fontsize=10)
        plain(axes)
    return figure
