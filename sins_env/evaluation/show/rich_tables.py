"""Tables of the package rich: their style, and how a notebook shows them."""

from __future__ import annotations

from collections.abc import Iterable
from io import StringIO

from rich import box
from rich.console import Console, RenderableType
from rich.table import Table
from rich.text import Text

NOTEBOOK_WIDTH = 120  #: characters of tables in a notebook


def in_html(*parts: RenderableType) -> str:
    """Return tables and texts as HTML for a notebook."""
    return _printed(parts, record=True).export_html(inline_styles=True, code_format="<pre>{code}</pre>")


def in_text(*parts: RenderableType) -> str:
    """Return tables and texts as plain text."""
    return _printed(parts).file.getvalue().rstrip("\n")  # type: ignore[attr-defined]


def _printed(parts: Iterable[RenderableType], record: bool = False) -> Console:
    console = Console(file=StringIO(), width=NOTEBOOK_WIDTH, record=record, force_jupyter=False)
    for part in parts:
        console.print(part)
    return console


def titled(title: str) -> Table:
    """Return an empty table in the style of all verbs of the command line; brackets in the title are no markup."""
    return Table(box=box.SIMPLE_HEAD, title=Text(title, style="bold"), title_justify="left", pad_edge=False)
