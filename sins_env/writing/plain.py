"""Text for a terminal whose encoding does not have all of it: the nearest ASCII, or an escape."""

from __future__ import annotations

import codecs
import io
import unicodedata
from typing import TextIO

ERRORS = "sins_env.plain"  #: name of the error handler of an encoding
#: ASCII for what the package prints; letters with accents lose them, and anything else becomes an escape.
_ASCII = str.maketrans(
    {"–": "-", "—": "-", "−": "-", "─": "-", "━": "-", "╸": "-", "╺": "-", "│": "|", "…": "~", "″": '"', "′": "'",
     "°": "d", "·": ".", "×": "x", "µ": "u", "μ": "u", "≥": ">", "≤": "<", "±": "+", "σ": "s", "•": "*", "\xa0": " "}
)  # fmt: skip


def nearest(text: str) -> str:
    """Return a text in ASCII; a character that the package prints keeps its width of one."""
    return "".join(map(_nearest, text.translate(_ASCII)))


def _nearest(character: str) -> str:
    if character.isascii():
        return character
    parts = [one for one in unicodedata.normalize("NFKD", character) if one.isascii()]
    return "".join(parts) or character.encode("unicode_escape").decode()


def _replace(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    return nearest(error.object[error.start : error.end]), error.end


def fit(stream: TextIO) -> None:
    """Make a stream write the nearest ASCII for what its encoding does not have, instead of an error."""
    if isinstance(stream, io.TextIOWrapper):
        codecs.register_error(ERRORS, _replace)
        stream.reconfigure(errors=ERRORS)
