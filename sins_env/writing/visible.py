"""Text that somebody else wrote, as it is shown: nothing in it steers a terminal, a page or a spreadsheet.

Names, settings and messages of a results file may come from a stranger, and so may what a solver says in an exception.
"""

from __future__ import annotations

import dataclasses
import html
import math
import re
from typing import Any, TypeVar

LAYOUT = "\n\xa0"  #: line breaks and spaces without a break, which the package itself writes into pages and tables
#: Signs that a spreadsheet may take for = + - @: these, and their wide, small, raised and lowered forms.
_SIGNS = "=\uff1d\ufe66\u207c\u208c+\uff0b\ufe62\u207a\u208a\ufb29\\-\uff0d\ufe63\u207b\u208b\u2212@\uff20\ufe6b"
#: Places where a cell that is computed would begin: behind the start, a line break, or what separates cells in some locale.
_COMPUTED = re.compile(rf"\A(?=[\t\r\n])|(?:\A|(?<=[;\uff1b\u061b|\t\r\n]))(?=[\s\"]*[{_SIGNS}])")
T = TypeVar("T")


def visible(text: str, keep: str = "") -> str:
    """Return a text in which everything prints; anything else but ``keep`` becomes an escape such as ``\\x1b``.

    Anything else is what Unicode calls control, format, surrogate, private, unassigned or separator. That includes ANSI
    sequences, marks of writing direction and signs without a width.
    """
    if text.isprintable():
        return text
    return "".join(c if c.isprintable() or c in keep else c.encode("unicode_escape").decode() for c in text)


def visible_parts(value: Any) -> Any:
    """Return a JSON value whose texts are visible."""
    if isinstance(value, str):
        return visible(value)
    if isinstance(value, dict):
        return {visible(name): visible_parts(one) for name, one in value.items()}
    if isinstance(value, list):
        return [visible_parts(one) for one in value]
    return value


def visible_fields(value: T) -> T:
    """Return a dataclass of JSON values whose texts are visible."""
    given = {one.name: getattr(value, one.name) for one in dataclasses.fields(value)}  # type: ignore[arg-type]
    return dataclasses.replace(value, **visible_parts(given))  # type: ignore[type-var]


def in_csv(value: Any) -> Any:
    """Return a value of a CSV cell, in which no text is computed; numbers stay.

    An apostrophe stands before each part that a spreadsheet would compute. A program whose locale separates cells by
    semicolons reads the quotes of a cell as text, so that a cell may begin within a text.
    """
    return visible(_COMPUTED.sub("'", value), keep=LAYOUT) if isinstance(value, str) else value


def in_markdown(text: str) -> str:
    """Return a text for a paragraph, heading or cell of Markdown; it brings no HTML, no link and no further cell."""
    return html.escape(visible(text, keep=LAYOUT), quote=False).replace("](", "]\\(").replace("|", "\\|")


def in_json(value: Any) -> Any:
    """Return a value for JSON, which has neither inf nor NaN: they are None, which becomes null."""
    if isinstance(value, dict):
        return {name: in_json(one) for name, one in value.items()}
    if isinstance(value, list):
        return [in_json(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
