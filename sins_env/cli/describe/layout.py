"""Layout of tables and sentences for ``list`` and ``describe``."""

from __future__ import annotations

import re

from rich.table import Table

from sins_env.evaluation.show.rich_tables import titled


def table(title: str, *columns: str) -> Table:
    """Return an empty table, which has no header if all names of columns are empty. Its first column is never cut."""
    made = titled(title)
    made.show_header = any(columns)
    for i, name in enumerate(columns):
        made.add_column(name, overflow="fold", no_wrap=i == 0)
    return made


def prose(text: str) -> str:
    """Return a paragraph of a docstring on one line, without markup."""
    return re.sub(r"(?::\w+:)?`+~?([^`]*)`+", r"\1", " ".join(text.split()))


def summary(text: str | None) -> str:
    """Return the first sentence of a docstring, without markup."""
    return re.split(r"(?<=[.!?])\s+(?=[A-Z])", prose((text or "").split("\n\n")[0]), maxsplit=1)[0]
