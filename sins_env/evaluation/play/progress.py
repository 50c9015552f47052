"""Progress bar with rate and time left, on standard error, or a line in a notebook; nothing is shown elsewhere."""

from __future__ import annotations

import sys
from collections.abc import Callable
from datetime import timedelta
from types import TracebackType

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, ProgressColumn, Task
from rich.table import Column
from rich.text import Text

from sins_env.writing import notebook

BAR_LEAST, BAR_MOST = 6, 24  #: least and most characters of the bar
#: Characters of each part with a space: "100%", "12,345x", "0:12:34 left", "0:12:34", "azimuth -123.456 deg".
PERCENT, RATE, LEFT, ELAPSED, NOTE = 5, 8, 13, 8, 21


class _Cell(ProgressColumn):
    """Column with one line of text that is never wrapped; it is empty until the text is known."""

    def __init__(self, text: Callable[[Task], str], style: str = "", most: int | None = None) -> None:
        super().__init__(table_column=Column(no_wrap=True, overflow="ellipsis", max_width=most))
        self.text, self.style = text, style

    def render(self, task: Task) -> Text:
        return Text(self.text(task), style=self.style, no_wrap=True, overflow="ellipsis")


def _percent(task: Task) -> str:
    return f"{task.percentage:.0f}%" if task.total and task.completed else ""


def _rate(task: Task) -> str:
    """Return how many times faster than real time the work is, whose unit is a second of one run."""
    speed = task.finished_speed or task.speed
    return f"{speed:,.0f}x" if speed and speed >= 0.5 else ""


def _left(task: Task) -> str:
    seconds = task.time_remaining
    return f"{timedelta(seconds=max(int(seconds), 0))} left" if seconds is not None and task.completed else ""


def _elapsed(task: Task) -> str:
    return str(timedelta(seconds=int(task.elapsed or 0)))


class Bar:
    """Progress bar over simulated seconds, which is a context manager. ``note`` is free text beside it.

    It takes one line at any width: first the bar shrinks, then elapsed time and note are left out, and then the label is cut.
    """

    def __init__(
        self,
        label: str,
        total: float | None = None,
        console: Console | None = None,
        clock: Callable[[], float] | None = None,
    ) -> None:
        console = console or Console(file=sys.stderr)
        room = console.width - 1 - BAR_LEAST - PERCENT - RATE - LEFT
        free = room - min(len(label), room)
        note = free >= NOTE
        elapsed = free >= NOTE + ELAPSED
        bar = min(BAR_LEAST + free - NOTE * note - ELAPSED * elapsed, BAR_MOST)
        columns: list[ProgressColumn] = [
            _Cell(lambda task: task.description, most=max(room, 8)),
            BarColumn(bar_width=bar),
            _Cell(_percent, "magenta", PERCENT - 1),
            _Cell(_rate, "cyan"),
            *([_Cell(_elapsed, "yellow")] if elapsed else []),
            _Cell(_left, "cyan"),
            *([_Cell(lambda task: task.fields["note"])] if note else []),
        ]
        self._line = notebook.line(label)
        hidden = not console.is_terminal
        self._progress = Progress(*columns, console=console, transient=True, disable=hidden, get_time=clock)
        self._task = self._progress.add_task(label, total=total, note="")

    def __rich__(self) -> RenderableType:
        return self._progress.get_renderable()

    def __enter__(self) -> Bar:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def update(self, done: float | None = None, total: float | None = None, note: str = "") -> None:
        """Show the work done and its total; None leaves a number as it is."""
        self._progress.update(self._task, completed=done, total=total, note=note)
        if self._line:
            self._line(done, total, note)
