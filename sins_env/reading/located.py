"""Documents with the line of every key, so that an error of meaning can name it as one of form does."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from sins_env.reading.documents import MOST_BYTES, YAML_ENDINGS, parse_document
from sins_env.reading.files import read_text

Place = tuple[str | int, ...]  #: keys and numbers of items from the top of a document to a value
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\],:]|[^\s{}\[\],:"]+')


class Located(NamedTuple):
    """A document."""

    value: Any
    lines: dict[Place, int]  #: line of each key and item, from 1 on

    def line(self, place: Place) -> int:
        """Return the line of a place, or of the nearest place around it that has one."""
        while place and place not in self.lines:
            place = place[:-1]
        return self.lines.get(place, 1)


def read_located(path: Path) -> Located:
    """Read a YAML file, or a JSON file if its name does not end like one of YAML.

    Raises:
        ValueError: neither, or beyond the limits; the error has the file and the line.
        OSError: no such file, or one that cannot be read.
    """
    text = read_text(path, MOST_BYTES)
    value = parse_document(path, text)
    places = _yaml_places(text) if path.suffix.lower() in YAML_ENDINGS else _json_places(text)
    return Located(value, dict(places))


def _yaml_places(text: str) -> Iterator[tuple[Place, int]]:
    """Yield places and lines of a YAML text that has been parsed within the limits."""
    import yaml  # not needed by those who have no YAML files

    waiting: list[tuple[Place, Any]] = [((), yaml.compose(text, Loader=getattr(yaml, "CSafeLoader", yaml.SafeLoader)))]
    while waiting:
        place, node = waiting.pop()
        if isinstance(node, yaml.MappingNode):
            inner = [((*place, str(key.value)), key, value) for key, value in node.value]
        elif isinstance(node, yaml.SequenceNode):
            inner = [((*place, i), value, value) for i, value in enumerate(node.value)]
        else:
            continue
        for at, first, value in inner:
            yield at, first.start_mark.line + 1
            waiting.append((at, value))


def _json_places(text: str) -> Iterator[tuple[Place, int]]:
    """Yield places and lines of a JSON text that has been parsed."""
    path: list[str | int] = []  #: key or number of the item in each collection around
    line, last, key = 1, 0, False
    for token in _TOKEN.finditer(text):
        line, last = line + text.count("\n", last, token.start()), token.start()
        word = token[0]
        if word not in ("]", "}", ",", ":") and path and isinstance(path[-1], int):
            yield tuple(path), line
        if word in "{[":
            path.append("" if word == "{" else 0)
            key = word == "{"
        elif word in "}]":
            path.pop()
            key = False
        elif word == ",":
            key = isinstance(path[-1], str)
            if not key:
                path[-1] = int(path[-1]) + 1
        elif key and word != ":":
            path[-1] = json.loads(word)
            yield tuple(path), line
            key = False
