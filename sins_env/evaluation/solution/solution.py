"""The solution of a recording, with what can be done with it: files, figures, and a summary."""

from __future__ import annotations

import html
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from sins_env.evaluation.estimators.guard import EstimatorError
from sins_env.evaluation.replay.angles_figure import replay_figure
from sins_env.evaluation.replay.replaying import Replay
from sins_env.evaluation.replay.track_figure import track_figure
from sins_env.evaluation.solution import files
from sins_env.evaluation.solution.epochs import Epochs, epochs_of
from sins_env.recordings import Finding, findings, seconds
from sins_env.writing.files import saved
from sins_env.writing.visible import in_json

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.figure import Figure


class Solution(Epochs):
    """States at K epochs with their sigmas, in files, figures and words."""

    def to_csv(self, path: str | Path, *, rate_hz: float | None = None, frame: str = "enu") -> None:
        """Write a table with a row for each epoch, or at ``rate_hz``; ``frame`` is "enu" or "ned". See :func:`files.save`."""
        files.save(self, path, "csv", rate_hz=rate_hz, frame=frame)

    def to_kml(self, path: str | Path, *, rate_hz: float | None = None) -> None:
        """Write the track for a map, coloured by the horizontal sigma of the position."""
        files.save(self, path, "kml", rate_hz=rate_hz)

    def to_tum(self, path: str | Path, *, rate_hz: float | None = None, frame: str = "enu") -> None:
        """Write time, metres from the first position, and the quaternion x, y, z, w, as evo reads it."""
        files.save(self, path, "tum", rate_hz=rate_hz, frame=frame)

    def to_nav(self, path: str | Path, *, rate_hz: float | None = None) -> None:
        """Write the navigation file of KF-GINS: North-East-Down, Forward-Right-Down."""
        files.save(self, path, "nav", rate_hz=rate_hz)

    def to_npz(self, path: str | Path, *, rate_hz: float | None = None, frame: str = "enu") -> None:
        """Write the columns of the CSV as arrays of an NPZ file."""
        files.save(self, path, "npz", rate_hz=rate_hz, frame=frame)

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the figure of the replay: track, innovations in their band, and sigmas; with ``path`` it is written, too."""
        drawn = replay_figure(self.replay) if self.replay.track is None else track_figure(self.replay)
        return saved(drawn, path)

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What the recording says against itself, before any solver sees it."""
        return () if self.replay.source is None else tuple(findings(self.replay.source))

    def summary(self) -> dict[str, Any]:
        """Return what JSON says of the solution: its span, the last state with sigmas, and its consistency."""
        heading, pitch, roll = np.degrees(self.angles[-1])
        s_heading, s_pitch, s_roll = np.degrees(self.sigma_attitude[-1])
        one = self.consistency
        found: dict[str, Any] = in_json(
            {
                "recording": self.recording,
                "solver": self.solver,
                "smoothed": self.smoothed,
                "start_s": float(self.time[0]),
                "end_s": float(self.time[-1]),
                "epochs": len(self.time),
                "consistent": one.consistent,
                "warnings": [{**w._asdict(), "span_s": list(w.span_s)} for w in one.warnings],
                "heading_deg": float(heading),
                "sigma_heading_deg": float(s_heading),
                "pitch_deg": float(pitch),
                "sigma_pitch_deg": float(s_pitch),
                "roll_deg": float(roll),
                "sigma_roll_deg": float(s_roll),
                "latitude_deg": float(np.degrees(self.position[-1, 0])),
                "longitude_deg": float(np.degrees(self.position[-1, 1])),
                "height_m": float(self.position[-1, 2]),
                "velocity_enu_mps": self.velocity[-1].tolist(),
                "sigma_position_enu_m": self.sigma_position[-1].tolist(),
                "sigma_velocity_enu_mps": self.sigma_velocity[-1].tolist(),
                "mean_nis": {name: float(part.value.mean()) for name, part in one.means.items() if len(part.value)},
                "correlation": dict(one.correlation),
                "withheld_rms_m": [list(part) for part in one.withheld],
            }
        )
        return found

    def facts(self) -> dict[str, str]:
        """Return what a reader wants to see first, by name."""
        (heading, pitch, roll), (s_h, s_p, s_r) = np.degrees(self.angles[-1]), np.degrees(self.sigma_attitude[-1])
        latitude, longitude = np.degrees(self.position[-1, :2])
        east, north, up = self.sigma_position[-1]
        one = self.consistency
        begin, end = (seconds(round(float(t), 6)) for t in self.time[[0, -1]])
        found = {
            "span": f"{begin} to {end} s, {len(self.time)} epochs",
            "heading": f"{heading:.3f} deg, sigma {s_h:.2g}",
            "pitch, roll": f"{pitch:.3f}, {roll:.3f} deg, sigma {s_p:.2g}, {s_r:.2g}",
            "position": f"{latitude:.7f}, {longitude:.7f} deg, {self.position[-1, 2]:.2f} m",
            "sigma E, N, U": f"{east:.2g}, {north:.2g}, {up:.2g} m",
            "consistent": "yes" if one.consistent else f"no: {', '.join(found.name for found in one.warnings)}",
            "measured": one.summary,
        }
        if self.replay.track is None:  # the place of an alignment is told
            del found["position"], found["sigma E, N, U"]
        return found

    def __repr__(self) -> str:
        facts = self.facts()
        how = ", smoothed" if self.smoothed else ""
        return (
            f"<Solution of {self.recording} by {self.solver}{how}: {facts['span']}; at the end heading {facts['heading']}; "
            f"consistent: {facts['consistent']}>"
        )

    def _repr_html_(self) -> str:
        rows = [
            ("recording", self.recording),
            ("solver", self.solver + ", smoothed" * self.smoothed),
            *self.facts().items(),
        ]
        cells = "".join(f"<tr><th>{html.escape(k)}</th><td>{html.escape(v)}</td></tr>" for k, v in rows)
        return f"<table>{cells}</table>"

    @classmethod
    def of(cls, one: Replay, window: int = 0, smoothed: bool = False) -> Solution:
        """Return the solution that a window of a replay is.

        Raises:
            EstimatorError: the solver gave up in it, or returned what is no estimate.
        """
        if one.failed[window]:
            at = f", window from {seconds(one.starts[window])} s" if len(one.starts) > 1 else ""
            raise EstimatorError(f"{one.solver} on {one.recording}{at}: {one.failed[window]}")
        return cls(**epochs_of(one, window, smoothed))
