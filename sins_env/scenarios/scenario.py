"""A scenario: read from a file or a dict, checked key by key, and turned into settings of an environment and a task."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sins_env import checks
from sins_env.reading.documents import YAML_ENDINGS
from sins_env.reading.located import Located, Place, read_located
from sins_env.scenarios.key import TASK, Key
from sins_env.scenarios.motions import KINDS, MotionKind
from sins_env.scenarios.table import COMMON, SHORT, every_key, keys_of

FILES = (*YAML_ENDINGS, ".json")  #: endings of the names of scenario files
UNNAMED = "scenario"  #: name of a scenario from a dict without one


@dataclass(frozen=True)
class Scenario:
    """A scenario.

    ``env_id`` and ``kwargs`` make its environment, and ``task`` has the fields of its task that are given. Settings that are
    left out are those of the environment.
    """

    env_id: str
    kwargs: Mapping[str, Any]
    task: Mapping[str, Any]
    place: Reader

    @classmethod
    def of(cls, given: Any) -> Scenario:
        """Make a scenario from a YAML or JSON file, or from a dict; a scenario is returned as it is.

        Raises:
            ValueError: an unknown key (the nearest is offered), or a value that is not allowed. The error of a file has the
                line.
            OSError: no such file, or one that cannot be read.
        """
        if isinstance(given, Scenario):
            return given
        if isinstance(given, (str, os.PathLike)):
            path = Path(given)
            if path.suffix.lower() not in FILES:
                raise ValueError(f"{path}: no scenario; allowed: a file that ends in {', '.join(FILES)}, or a dict")
            return Reader(read_located(path), path).scenario()
        return Reader(Located(given, {}), None).scenario()


def is_scenario(given: Any) -> bool:
    """Return whether this may be a scenario: a dict, or a path with the ending of a file of one."""
    if isinstance(given, (str, os.PathLike)):
        return Path(given).suffix.lower() in FILES
    return isinstance(given, Mapping)


@dataclass(frozen=True)
class Reader:
    """A document that becomes a scenario."""

    document: Located
    path: Path | None

    def error(self, place: Place, text: str) -> ValueError:
        """Return an error about a place of the document, with file and line."""
        where = f"{self.path}: line {self.document.line(place)}: " if self.path else ""
        return ValueError(where + text)

    def scenario(self) -> Scenario:
        """Return the scenario.

        Raises:
            ValueError: as :meth:`Scenario.of`.
        """
        given = {} if self.document.value is None else self.document.value
        if not isinstance(given, Mapping):
            raise self.error(
                (), f"{checks.shown(given)}; allowed: keys with their values, such as motion: {{kind: sway}}"
            )
        kind = self._kind(given)
        known, values, places = keys_of(kind), dict[str, Any](), dict[str, Place]()
        for key, place, value in self._walk((), given, known, kind):
            to = kind.target(key)
            if key.path != "motion.kind":
                values[to], places[to] = self._value(key, place, value), place
        self._check_apart(kind, values, places)
        fields = {to.removeprefix(TASK): value for to, value in values.items() if to.startswith(TASK)}
        kwargs = _nested({to: value for to, value in values.items() if not to.startswith(TASK)}, kind.defaults)
        self._check_together(kind, kwargs, known, places)
        if "windows" not in fields and kind.name == "recording":
            fields["windows"] = 1
        if isinstance(kwargs.get("heading_deg"), list):
            fields["records"] = len(kwargs["heading_deg"])
        fields.setdefault("name", _stem(self.path))
        return Scenario(kind.env_id, kwargs, fields, self)

    def _kind(self, given: Mapping[str, Any]) -> MotionKind:
        motion = given.get("motion")
        name = motion.get("kind") if isinstance(motion, Mapping) else motion
        place: Place = ("motion", "kind") if isinstance(motion, Mapping) else ("motion",)
        if name is None:
            return KINDS["sway"]
        key = next(key for key in COMMON if key.path == "motion.kind")
        return KINDS[self._value(key, place, name)]

    def _walk(
        self, place: Place, given: Mapping[Any, Any], known: Mapping[str, Key], kind: MotionKind
    ) -> Iterator[tuple[Key, Place, Any]]:
        """Yield every key with its place and its value; a key without a value is left out."""
        for name, value in given.items():
            at = (*place, str(name))
            path = ".".join(map(str, at))
            inner = [one for one in known if one.startswith(f"{path}.")]
            if value is None and (inner or path in known):
                continue
            if path in known:
                yield known[path], at, value
            elif inner and isinstance(value, Mapping):
                yield from self._walk(at, value, known, kind)
            elif inner and path in SHORT and isinstance(value, str):
                yield known[SHORT[path]], at, value
            elif inner:
                names = ", ".join(one.removeprefix(f"{path}.") for one in inner)
                raise self.error(at, f"{path} = {checks.shown(value)}; allowed: an object with keys of {names}")
            else:
                raise self.error(at, self._unknown(at, name, known, kind))

    def _unknown(self, place: Place, name: Any, known: Mapping[str, Key], kind: MotionKind) -> str:
        path, around = ".".join(map(str, place)), "".join(f"{part}." for part in place[:-1])
        if path in every_key():
            kinds = ", ".join(one.name for one in every_key()[path][1])
            return f"{path} with a motion of kind {kind.name}; allowed: with {kinds} only"
        names = dict.fromkeys(one.removeprefix(around).partition(".")[0] for one in known if one.startswith(around))
        return str(checks.unknown(f"key of {around[:-1] or 'a scenario'}", name, names))

    def _value(self, key: Key, place: Place, given: Any) -> Any:
        """Return the value of a key; of a file beside the scenario, its path."""
        beside = self.path.parent / given if self.path and key.is_file and isinstance(given, str) else None
        if beside is not None and not Path(given).exists() and beside.is_file():
            given = str(beside)
        try:
            return key.value(given)
        except ValueError as error:
            raise self.error(self._named_in(str(error), place), str(error)) from None

    def _named_in(self, text: str, place: Place) -> Place:
        """Return the place, at or below another, whose key an error names first."""
        best = (len(text) + 1, place)
        for at in self.document.lines:
            if at[: len(place)] != place or len(at) == len(place):
                continue
            item = f"[{at[-1]}]" if isinstance(at[-1], int) else rf"\b{re.escape(at[-1])}\b"
            found = re.search(re.escape(item) if isinstance(at[-1], int) else item, text)
            if found and found.start() < best[0]:
                best = (found.start(), at)
        return best[1]

    def _check_apart(self, kind: MotionKind, values: Mapping[str, Any], places: Mapping[str, Place]) -> None:
        """Check that only one group of keys that exclude each other is given."""
        there = [[to for to in values if to in group] for group in kind.apart]
        if sum(map(bool, there)) > 1:
            one, other = (".".join(map(str, places[group[0]])) for group in there if group)
            raise self.error(places[there[-1][0]], f"{other} with {one}; allowed: one of them")

    def _check_together(
        self, kind: MotionKind, kwargs: Mapping[str, Any], known: Mapping[str, Key], places: Mapping[str, Place]
    ) -> None:
        """Check the settings as the environment does, and say its error in the words and with the lines of the keys."""
        try:
            checks.build(kind.settings, kwargs, kind.env_id)
        except (ValueError, FileNotFoundError) as error:
            text = str(error)
            found = [
                (at.start(), to) for to in places if (at := re.search(rf"\b{re.escape(to)}\b", text, re.IGNORECASE))
            ]
            place = places[min(found)[1]] if found else ("motion",)
            for key in known.values():
                if (to := kind.target(key)) and key.path not in text:
                    text = re.sub(rf"\b{re.escape(to)}\b(?= =| with| shorter)", key.path, text)
            raise self.error(place, text) from None


def _stem(path: Path | None) -> str:
    """Return the name of a scenario that has none."""
    return re.sub(r"[^A-Za-z0-9._-]", "-", path.stem).strip(".-_")[:80] or UNNAMED if path else UNNAMED


def _nested(values: Mapping[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings with names such as ``profile.speed_mps`` as dicts in a dict, with the defaults of those dicts."""
    out: dict[str, Any] = {}
    inner = {to.partition(".")[0] for to in values if "." in to}
    beside = {to: value for to, value in defaults.items() if to.partition(".")[0] in inner}
    for to, value in (beside | dict(values)).items():
        *around, last = to.split(".")
        at = out
        for name in around:
            at = at.setdefault(name, {})
        at[last] = value
    return out
