"""Text that a script writes into a document: what stands between <!-- NAME:begin --> and <!-- NAME:end -->."""

from __future__ import annotations


def between(document: str, name: str) -> str:
    """What now stands between the markers of ``name``, without the line breaks at them."""
    return _parts(document, name)[1].strip("\n")


def replaced(document: str, name: str, text: str) -> str:
    """``document`` with ``text`` between the markers of ``name``, an empty line at each, as Markdown wants beside HTML."""
    before, _, after = _parts(document, name)
    body = text.strip("\n")
    return f"{before}\n\n{body}\n\n{after}"


def _parts(document: str, name: str) -> tuple[str, str, str]:
    """Up to and with the first marker, what stands between, and the rest from the second marker on.

    Raises:
        ValueError: the markers do not stand there once each, in this order.
    """
    begin, end = f"<!-- {name}:begin -->", f"<!-- {name}:end -->"
    if document.count(begin) != 1 or document.count(end) != 1 or document.index(begin) > document.index(end):
        raise ValueError(f"needed once each, in this order: {begin} and {end}")
    before, rest = document.split(begin)
    text, after = rest.split(end)
    return before + begin, text, end + after
