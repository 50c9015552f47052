"""The answer that users get: the curves of the bound with their text, their HTML and their figure."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sins_env.evaluation.planning import tables
from sins_env.evaluation.planning.curves import Curves
from sins_env.evaluation.planning.figure import forecast_figure
from sins_env.evaluation.show.rich_tables import in_html
from sins_env.writing.files import saved

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class Forecast(Curves):
    """The smallest errors that a task allows, 1 sigma. A notebook shows what ``sins-env bound`` prints."""

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the figure: the bound over time with its budget or its family; with ``path`` it is written, too."""
        return saved(forecast_figure(self), path)

    def _repr_html_(self) -> str:
        return in_html(*tables.told(self))
