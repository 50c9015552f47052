"""JSON and YAML, bounded in bytes, depth and number of values before they are expanded.

The same limits hold for a flight, a mapping and a setting of the command line.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from sins_env.reading.files import read_text, size

MOST_BYTES = 4_000_000  #: largest document
MOST_DEPTH = 32  #: most levels of lists and objects
MOST_VALUES = 200_000  #: most keys and values, each alias counted as often as it is used
MOST_DIGITS = 300  #: most digits of a whole number; the largest float has 309
#: Numbers such as 1e-3, which YAML 1.2 and JSON take as numbers, and PyYAML as texts.
_EXPONENT = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)[eE][-+]?\d+$")
Place = tuple[str | int, ...]  #: keys and numbers of items from the top of a document to a value
_LONG = "a whole number of"  # beginning of the error about one with too many digits
_TOKEN = re.compile(r'"(?:[^"\\]|\\.)*"|[{}\[\],:]|[^\s{}\[\],:"]+')
YAML_ENDINGS = (".yaml", ".yml")  #: endings of YAML files; any other document is JSON


def read_document(path: Path) -> Any:
    """Read a YAML file, or a JSON file if its name does not end like one of YAML.

    Raises:
        ValueError: neither, or beyond the limits; the error has the file and the line.
        OSError: no such file, or one that cannot be read.
    """
    return parse_document(path, read_text(path, MOST_BYTES))


def parse_document(path: Path, text: str) -> Any:
    """Return the value of the text of a file, which is YAML or JSON by the ending of its name.

    Raises:
        ValueError: neither, or beyond the limits; the error has the file and the line.
    """
    try:
        return parse_yaml(text) if path.suffix.lower() in YAML_ENDINGS else parse_json(text)
    except json.JSONDecodeError as error:
        raise ValueError(f"{path}: line {error.lineno} is no JSON ({error.msg})") from None
    except ValueError as error:
        line = None if path.suffix.lower() in YAML_ENDINGS else _fault(text, str(error))
        raise ValueError(f"{path}: line {line}: {error}" if line else f"{path}: {error}") from None


def json_places(text: str) -> Iterator[tuple[Place, int]]:
    """Yield places and lines of the keys and items of a JSON text, which is well formed up to there."""
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


def _fault(text: str, error: str) -> int | None:
    """Return the line of a JSON text with the first key that is there twice, or the first value beyond the limits."""
    if error.startswith(_LONG):
        return text.count("\n", 0, text.index(next(iter(re.findall(rf"\d{{{MOST_DIGITS + 1},}}", text))))) + 1
    seen: set[Place] = set()
    for place, line in json_places(text):
        if place in seen or len(place) > MOST_DEPTH or len(seen) > MOST_VALUES:
            return line
        seen.add(place)
    return None


def parse_json(text: str) -> Any:
    """Return the value of a JSON text.

    Raises:
        json.JSONDecodeError: no JSON; it is a ValueError.
        ValueError: beyond the limits, or a key that is there twice.
    """
    if len(text) > MOST_BYTES:
        raise ValueError(f"{size(len(text))} of JSON; allowed: at most {size(MOST_BYTES)}")
    try:
        value = json.loads(text, parse_int=_whole, object_pairs_hook=_object)
    except RecursionError:
        raise _too_deep() from None
    _check_size(value)
    return value


def _whole(digits: str) -> int:
    if len(digits) > MOST_DIGITS:
        raise _too_long(digits)
    return int(digits)


def _too_long(digits: str) -> ValueError:
    return ValueError(f"{_LONG} {len(digits)} digits; allowed: at most {MOST_DIGITS}")


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    _check_once([name for name, _ in pairs])
    return dict(pairs)


def _check_once(names: list[Any]) -> None:
    """Check the keys of one object.

    Raises:
        ValueError: a key that is there twice.
    """
    seen: set[Any] = set()
    for name in names if len(set(names)) < len(names) else ():
        if name in seen:
            raise ValueError(f"the key {str(name)[:40]!r} twice in one object; allowed: each key once")
        seen.add(name)


def _too_deep() -> ValueError:
    return ValueError(f"lists or objects nested deeper than {MOST_DEPTH} levels; allowed: at most {MOST_DEPTH}")


def _too_many() -> ValueError:
    return ValueError(f"more than {MOST_VALUES} values; allowed: at most {MOST_VALUES}")


def _check_size(value: Any) -> None:
    """Check depth and number of values level by level, without recursion."""
    level, count = [value], 0
    for _ in range(MOST_DEPTH + 1):
        count += len(level)
        if count > MOST_VALUES:
            raise _too_many()
        inner = [one for one in level if isinstance(one, (dict, list))]
        if not inner:
            return
        level = [part for one in inner for part in (one.values() if isinstance(one, dict) else one)]
    raise _too_deep()


def parse_yaml(text: str) -> Any:
    """Return the value of a YAML text of one document, of plain types alone.

    Raises:
        ValueError: no YAML, beyond the limits, or a key that is there twice; the error has the line.
    """
    import yaml  # not needed by those who have no YAML files

    base = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # the same language, ten times as fast

    class Loader(base):  # type: ignore[misc, valid-type]
        def construct_object(self, node: Any, deep: bool = False) -> Any:
            try:
                return super().construct_object(node, deep)
            except (ValueError, TypeError, OverflowError, KeyError, AttributeError) as error:  # its tag does not fit
                what = f"it cannot be read: {' '.join(str(error).split())[:200]}"
                raise yaml.constructor.ConstructorError(None, None, what, node.start_mark) from None

        def construct_mapping(self, node: Any, deep: bool = False) -> Any:
            names = [key for key, _ in node.value if key.value != "<<" and isinstance(key.value, str)]
            try:
                _check_once([key.value for key in names])
            except ValueError as error:
                twice = next(key for i, key in enumerate(names) if key.value in [one.value for one in names[:i]])
                raise yaml.constructor.ConstructorError(None, None, str(error), twice.start_mark) from None
            return super().construct_mapping(node, deep)

    Loader.add_implicit_resolver("tag:yaml.org,2002:float", _EXPONENT, list("-+.0123456789"))
    try:
        _check_events(yaml, base, text)
        return yaml.load(text, Loader=Loader)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None) or getattr(error, "context_mark", None)
        what = getattr(error, "problem", None) or getattr(error, "reason", None) or error
        before = text.encode("utf-8", "surrogatepass")[: getattr(error, "position", 0)]  # of what cannot be read at all
        where = f"line {mark.line + 1 if mark else before.count(10) + 1} is"
        tab = mark and "\t" in "".join(text.split("\n")[mark.line : mark.line + 1])
        hint = "; allowed: spaces instead of the tab" if tab else ""
        raise ValueError(f"{where} no YAML ({' '.join(str(what).split())}){hint}") from None


def _check_events(yaml: Any, loader: Any, text: str) -> None:
    """Count values and levels before any of them is built; an alias counts as all that it stands for."""
    count = 0
    known: dict[str | None, tuple[int, int]] = {}  #: number of values and of levels of what has an anchor
    path: list[list[Any]] = [["", 0, 0]]  #: anchor, count at its start, and levels below of each collection around
    for event in yaml.parse(text, Loader=loader):
        anchor, added, levels = getattr(event, "anchor", None), 0, 0
        if isinstance(event, yaml.AliasEvent):
            if anchor in (name for name, _, _ in path):
                raise ValueError(f"line {event.start_mark.line + 1}: the alias *{anchor} stands within itself")
            added, levels = known.get(anchor, (1, 0))
        elif isinstance(event, yaml.ScalarEvent):
            added = 1
            if event.value.lstrip("+-").isdecimal() and len(event.value) > MOST_DIGITS:
                raise ValueError(f"line {event.start_mark.line + 1}: {_too_long(event.value)}")
        elif isinstance(event, yaml.CollectionStartEvent):
            path.append([anchor, count, 0])
            continue
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before, levels = path.pop()
            known[anchor] = (count - before, levels)
        count += added
        path[-1][2] = max(path[-1][2], levels + 1)
        if count > MOST_VALUES:
            raise ValueError(f"line {event.start_mark.line + 1}: {_too_many()}")
        if len(path) - 1 + path[-1][2] > MOST_DEPTH:
            raise ValueError(f"line {event.start_mark.line + 1}: {_too_deep()}")
