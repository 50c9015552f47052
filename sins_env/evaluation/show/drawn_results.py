"""Results as users get them: with their figure."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.error_figure import error_figure
from sins_env.writing.files import saved

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.figure import Figure


@dataclass(frozen=True, repr=False)
class DrawnResults(Results):
    """Results of one solver on one task and one suite, which also draw themselves."""

    def plot(self, path: str | Path | None = None) -> Figure:
        """Return the figure of the errors over time beside the bound; with ``path`` it is written, too."""
        return saved(error_figure([self]), path)
