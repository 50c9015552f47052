"""Text that a script writes into a document, between <!-- NAME:begin --> and <!-- NAME:end -->."""

from __future__ import annotations


def between(document: str, name: str) -> str:
    """Return the text between the markers of ``name``, without the line breaks at its ends."""
    return _parts(document, name)[1].strip("\n")


def replaced(document: str, name: str, text: str) -> str:
    """Return ``document`` with ``text`` between the markers of ``name``, and an empty line at each for Markdown."""
    before, _, after = _parts(document, name)
    body = text.strip("\n")
    return f"{before}\n\n{body}\n\n{after}"


def _parts(document: str, name: str) -> tuple[str, str, str]:
    """Return the document up to the first marker with it, the text between, and the rest from the second marker on.

    Raises:
        ValueError: the document does not have both markers once, in this order.
    """
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    if document.count(begin) != 1 or document.count(end) != 1 or document.index(begin) > document.index(end):
        raise ValueError(f"needed once each, in this order: {begin} and {end}")
    before, rest = document.split(begin)
    text, after = rest.split(end)
    return before + begin, text, end + after
