"""Parts that the figures of the report share: the look of a solver in all of them, and a panel that fits a phone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.report.svg import LOOKS, PAGE, inline
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.style import STYLES, few_labels, new_figure

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

WIDTH, HEIGHT, FONT = 400, 290, 12.0  #: pixels, about as wide as a phone
MARKERS = "osD^vPX*"
DASHES = ("", "9 3", "2 2.4", "11 2.6 2 2.6")  #: STYLES in the SVG of the page's legend


class Look(NamedTuple):
    """Colour, dash and marker of a solver that stands out; the other solvers are grey."""

    number: int

    @property
    def name(self) -> str:
        """Name of the colour, which is a CSS variable of the page."""
        return f"look-{self.number % LOOKS}"

    @property
    def dash(self) -> int:
        """Index into STYLES and DASHES."""
        return (self.number + self.number // LOOKS) % len(STYLES)

    @property
    def marker(self) -> str:
        """Marker in Matplotlib's spelling."""
        return MARKERS[self.number % LOOKS]


class Drawing(NamedTuple):
    """Figure of the page."""

    title: str
    caption: str
    svg: str


@dataclass(frozen=True)
class Lineup:
    """Solvers of a task, the best first, with their looks."""

    lines: Sequence[Results]
    looks: Mapping[str, Look]  #: looks by label of the solver
    prefix: str  #: prefix of the identifiers in its figures

    @property
    def bound(self) -> Bound | None:
        """Bound of the task; None if there is none."""
        return next((one.bound for one in self.lines if one.bound), None)

    @property
    def oracle(self) -> Records | None:
        """Runs of the oracle with their histories; None if they are not known."""
        return next((one.oracle for one in self.lines if one.oracle and one.oracle.history.shape[1]), None)

    @property
    def back_to_front(self) -> list[Results]:
        """Solvers in the order of drawing: grey ones first, the best last."""
        return sorted(reversed(self.lines), key=lambda one: one.label in self.looks)


class Panel:
    """Figure with one pair of axes."""

    def __init__(self, lineup: Lineup, name: str) -> None:
        self.lineup, self.prefix = lineup, f"{lineup.prefix}-{name}"
        self.figure: Figure = new_figure(WIDTH / 72, HEIGHT / 72, dpi=72)
        self.axes: Axes = self.figure.add_subplot()
        self.names: dict[str, str] = {}

    def style(self, one: Results, told: str = "") -> dict[str, Any]:
        """Return the style of a solver's line, and keep its label and ``told`` for a tooltip."""
        gid = f"named-{len(self.names)}"
        self.names[gid] = f"{one.label}{told and ': '}{told}"
        look = self.lineup.looks.get(one.label)
        if look is None:
            return {"gid": gid, "color": PAGE["other"], "linewidth": 0.9, "zorder": 1.5}
        return {"gid": gid, "color": PAGE[look.name], "linestyle": STYLES[look.dash], "linewidth": 1.8, "zorder": 2.5}

    def told(self, one: Results) -> bool:
        """Return whether the solver has a look of its own."""
        return one.label in self.lineup.looks

    def svg(self, title: str, description: str, **settings: Any) -> str:
        """Return the figure as SVG, with axes in the colours of the page; ``settings`` are those of ``Axes.set``."""
        from matplotlib.ticker import FuncFormatter  # slow to import

        axes, ink, grid = self.axes, PAGE["ink"], PAGE["grid"]
        axes.set(**settings)
        axes.grid(color=grid, linewidth=0.8)
        axes.spines[["top", "right"]].set_visible(False)
        for side in ("left", "bottom"):
            axes.spines[side].set(color=grid, linewidth=1.2)
        axes.tick_params(which="both", color=grid, labelcolor=ink, labelsize=FONT)
        for axis in (axes.xaxis, axes.yaxis):
            axis.label.set(color=ink, size=FONT)
            if axis.get_scale() == "log":
                axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
                axis.set_minor_formatter(FuncFormatter(few_labels(axis)))
                axis.set_tick_params(which="minor", labelsize=FONT)
        return inline(self.figure, self.prefix, title, description, self.names)
