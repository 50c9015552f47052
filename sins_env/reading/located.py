"""Documents with the line of every key, so that an error of meaning can name it as one of form does."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from sins_env.reading.documents import MOST_BYTES, YAML_ENDINGS, Place, json_places, parse_document
from sins_env.reading.files import read_text


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
    places = _yaml_places(text) if path.suffix.lower() in YAML_ENDINGS else json_places(text)
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
