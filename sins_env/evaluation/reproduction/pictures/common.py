"""The common look of the figures: axes, legend, and the file."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sins_env.writing.files import replacing

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def plain(axes: Axes) -> None:
    """Draw a light grid and no frame at the top and the right."""
    axes.grid(alpha=0.3, linewidth=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=9)


def legend(figure: Figure, panels: Iterable[Axes], columns: int = 6) -> None:
    """Draw one legend for all panels below them; labels that several share are named once."""
    known: dict[Any, Any] = {
        label: handle for axes in panels for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
    }
    ncols = min(max(len(known), 1), columns)
    figure.legend(known.values(), known.keys(), loc="outside lower center", ncols=ncols, frameon=False, fontsize=9)


def save(figure: Figure, path: Path) -> None:
    """Save a figure as SVG, with fonts as text and without date, so that equal figures make equal files."""
    import matplotlib as mpl  # slow to import

    with replacing([path]) as (new,), mpl.rc_context({"svg.hashsalt": path.stem, "svg.fonttype": "none"}):
        figure.savefig(new, format="svg", metadata={"Date": None})
