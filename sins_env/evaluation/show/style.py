"""Colours, line styles and notes that all figures share."""

from __future__ import annotations

from collections.abc import Callable
from io import BytesIO
from typing import TYPE_CHECKING, Any

from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.writing.visible import LAYOUT, visible

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


#: Colours of Okabe and Ito, which differ for any colour vision; line styles differ in print, too.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
STYLES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.2, 1.2)), (0, (6, 1.5, 1.2, 1.5)))
NO_REFERENCE = "no reference: errors are not scored"
DOTTED: dict[str, Any] = {"color": "0.35", "linestyle": (0, (1, 1)), "linewidth": 1.2}


def style(i: int) -> dict[str, Any]:
    """Return colour and line style of the i-th solver."""
    return {"color": COLOURS[i % len(COLOURS)], "linestyle": STYLES[i % len(STYLES)], "linewidth": 1.7}


def new_figure(width: float, height: float, dpi: float | None = None) -> Figure:
    """Make an empty figure of that width and height in inches, without pyplot, which would keep it in memory.

    Dollar signs in its titles and labels are no mathematics, and characters that do not print are shown as escapes.
    """
    from matplotlib.axis import Tick  # slow to import, like the others
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # half a second, which who draws nothing does without
    from matplotlib.figure import Figure
    from matplotlib.text import Text as Label  # slow to import, like the others

    class Shown(Figure):
        def draw(self, renderer: Any) -> None:
            ticks = {label for tick in self.findobj(Tick) for label in tick.findobj(Label)}
            for label in set(self.findobj(Label)) - ticks:
                label.set_parse_math(False)
                label.set_text(visible(label.get_text(), keep=LAYOUT))
            super().draw(renderer)

        def _repr_png_(self) -> bytes:
            """Return the picture that a notebook shows, which knows figures of pyplot only."""
            self.savefig(picture := BytesIO(), format="png")
            return picture.getvalue()

    figure = Shown(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def finish(axes: Axes, title: str, **settings: Any) -> None:
    """Set title, settings and grid, and write numbers instead of powers on log axes."""
    axes.set_title(title, fontsize=10, loc="left")
    axes.set(**settings)
    axes.grid(which="major", alpha=0.35, linewidth=0.6)
    axes.grid(which="minor", alpha=0.15, linewidth=0.4)
    axes.spines[["top", "right"]].set_visible(False)
    axes.tick_params(labelsize=9)
    from matplotlib.ticker import FuncFormatter  # slow to import

    for axis in (axes.xaxis, axes.yaxis):
        if axis.get_scale() == "log":
            axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
            axis.set_minor_formatter(FuncFormatter(few_labels(axis)))


def bound_style(bound: Bound, name: str = "Cramér-Rao bound") -> dict[str, Any]:
    """Return the line style of a bound: solid, or dashed if it is only a reference."""
    line = {"color": "black", "linewidth": 1.1, "zorder": 3}
    if bound.holds:
        return {"label": name, "linestyle": "-", **line}
    return {"label": f"{name}, a reference only", "linestyle": (0, (4, 3)), **line}


def oracle_style() -> dict[str, Any]:
    """Return the line style of the oracle, which shows the luck of the runs beside the bound."""
    dash = (0, (6, 2, 1.5, 2))
    return {"label": "oracle in the same runs", "color": "black", "linewidth": 1.1, "linestyle": dash, "zorder": 3}


def say_unscored(axes: Axes) -> None:
    """Write into the axes that errors are not scored."""
    axes.text(0.5, 0.5, NO_REFERENCE, transform=axes.transAxes, ha="center", va="center", fontsize=9, color="0.35")


def few_labels(axis: Any) -> Callable[[float, Any], str]:
    """Return a formatter of minor ticks, which labels 2 and 5 if a log axis is shorter than a decade and a half."""

    def label(value: float, _: Any) -> str:
        low, high = sorted(axis.get_view_interval())
        return f"{value:g}" if high < 30 * low and f"{value:e}"[0] in "25" else ""

    return label


def threshold_text(task: EvaluationTask) -> str:
    """Return the label of the task's thresholds."""
    return f"threshold of the task: {task.delta_azimuth_deg:g} deg, {task.delta_level_arcsec:g} arcsec"


def shade_coarse(axes: Axes, coarse_s: float) -> None:
    """Shade the coarse phase, which is not scored."""
    if coarse_s:
        axes.axvspan(0, coarse_s, color="0.5", alpha=0.15, linewidth=0, label="coarse phase, not scored")
