"""Sensors as others write them: other units, the words of datasheets, files, and texts of the command line.

:func:`in_own_units` turns the keys of a dict into the fields of a specification. :func:`told` makes such a dict of a text:
the name of a preset, a JSON or YAML file, or ``key=value,...``.
"""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from sins_env import checks
from sins_env.reading.documents import YAML_ENDINGS, parse_json, read_document
from sins_env.units import UNITS

#: Peak of the Allan deviation of a first-order Gauss-Markov process over its standard deviation, at 1.89 correlation times.
MARKOV_PEAK = 0.6173643

#: Words of datasheets for the first part of a field's name, before the unit.
WORDS = {
    "angle_random_walk": "arw",
    "gyro_noise": "arw",
    "gyro_noise_density": "arw",
    "velocity_random_walk": "vrw",
    "accel_noise": "vrw",
    "accel_noise_density": "vrw",
    "gyro_bias_repeatability": "gyro_bias",
    "gyro_turn_on_bias": "gyro_bias",
    "accel_bias_repeatability": "accel_bias",
    "accel_turn_on_bias": "accel_bias",
    "scale_factor": "scale",
}
#: Bias instability: the lowest Allan deviation, which becomes the peak of the Gauss-Markov bias.
INSTABILITY = {
    "gyro_bias_instability": "gyro_markov",
    "gyro_in_run_bias": "gyro_markov",
    "accel_bias_instability": "accel_markov",
    "accel_in_run_bias": "accel_markov",
}
#: A bias that walks, K: the Gauss-Markov bias that begins like it has sigma = K sqrt(T / 2).
WALKS = {
    "gyro_bias_random_walk": ("gyro_markov", "rate random walk", "rate"),
    "rate_random_walk": ("gyro_markov", "rate random walk", "rate"),
    "accel_bias_random_walk": ("accel_markov", "acceleration random walk", "acceleration"),
}
#: Keys of the IMU files of Kalibr, and of the EuRoC data, in SI.
KALIBR = {
    "gyroscope_noise_density": "arw_rad_s_sqrt_hz",
    "gyroscope_random_walk": "gyro_bias_random_walk_rad_s2_sqrt_hz",
    "accelerometer_noise_density": "vrw_mps2_sqrt_hz",
    "accelerometer_random_walk": "accel_bias_random_walk_mps3_sqrt_hz",
}


class Converted(NamedTuple):
    """Fields of a specification, and under which names they were given."""

    values: dict[str, Any]
    names: dict[str, str]  #: the name that was given for each field
    given: Mapping[str, Any]

    def with_origins(self, text: str) -> str:
        """Add to an error the settings behind the fields that it names, if these were given in other words."""
        behind = [name for field, name in self.names.items() if name != field and f".{field} " in text]
        return "; ".join([text, *(f"it was given as {name} = {checks.shown(self.given[name])}" for name in behind)])


def in_own_units(given: Mapping[str, Any], own: Mapping[str, Any], whose: str) -> Converted:
    """Turn settings into fields of a specification.

    A name may end with another unit of the same kind than the field (:data:`sins_env.units.UNITS`), and may begin with a
    word of :data:`WORDS`: ``{"vrw_mps_sqrt_h": 0.03}`` becomes ``{"vrw_ug_sqrt_hz": 51.0}``. ``own`` has the values of all
    fields, which the settings replace. A field by its own name keeps its value, bit for bit.

    Raises:
        ValueError: an unknown name (the nearest is offered), an unknown unit, or two settings for one field.
    """
    out = Converted({}, {}, given)
    for name in sorted(given, key=lambda name: _split(str(name))[0] in WALKS):  # these need a correlation time
        field, value = name, given[name]
        if name not in own:
            field, factor = _field(str(name), {**own, **out.values}, whose)
            value = _scaled(str(name), value, factor)
        if field in out.values:
            both = f"{out.names[field]} and {name}, which both tell {field}"
            raise ValueError(f"{whose}: {both}; allowed: one of them")
        out.values[field], out.names[field] = value, name
    return out


def _split(name: str) -> tuple[str, str]:
    """Return what is before the longest known unit at the end of a name, and the unit; an empty one if there is none."""
    ends = [unit for unit in UNITS if name.endswith(f"_{unit}")]
    unit = max(ends, key=len, default="")
    return name.removesuffix(f"_{unit}") if unit else name, unit


def _field(name: str, own: Mapping[str, Any], whose: str) -> tuple[str, float]:
    """Return the field that a setting tells, and the factor from its unit to that of the field.

    Raises:
        ValueError: no such field.
    """
    stem, unit = _split(name)
    kind, size = UNITS.get(unit, ("", math.nan))
    if stem in WALKS and kind == WALKS[stem][1]:
        target, _, of = WALKS[stem]
        field = _of_kind(target, of, own)
        if field:
            return field, size * math.sqrt(own[f"{target}_s"] / 2.0) / UNITS[_split(field)[1]][1]
    unstable = stem in INSTABILITY and kind != "time"
    target = INSTABILITY[stem] if unstable else WORDS.get(stem, stem)
    field = _of_kind(target, kind, own)
    if field is None:
        raise _unknown(name, own, whose)
    return field, size / UNITS[_split(field)[1]][1] / (MARKOV_PEAK if unstable else 1.0)


def _of_kind(stem: str, kind: str, own: Collection[str]) -> str | None:
    """Return the field with that first part whose unit is of that kind."""
    for field in own:
        first, unit = _split(field)
        if first == stem and unit and UNITS[unit][0] == kind:
            return field
    return None


def _unknown(name: str, own: Collection[str], whose: str) -> ValueError:
    """Return the error for a setting that no field has: the units of its field, or else the name that it may mean.

    A name in another unit is offered only if it is almost the same. Otherwise the part before the unit decides, and the name
    is that of the field itself.
    """
    stem, unit = _split(name)
    names = {word: [f"{word}_{unit}" for unit in units] for word, units in _words(own).items()}
    almost = difflib.get_close_matches(
        name, [*own, *(one for all_of in names.values() for one in all_of)], 1, cutoff=0.9
    )
    begins = [word for word in names if f"{name}_".startswith(f"{word}_")]
    if begins and (stem in names or not almost):
        listed = names[max(begins, key=len)]
        near = next((one for one in listed if one in own), listed[0])
        return ValueError(
            f"unknown setting of {whose} {checks.shown(name)}; did you mean {near!r}? Allowed: {', '.join(listed)}"
        )
    offered = {one: [one] for one in own if _split(one)[0] not in names} | names
    for word in [] if almost else difflib.get_close_matches(stem, offered, 1, cutoff=0.6):
        fitting = [one for one in offered[word] if unit and one == f"{word}_{unit}"]
        almost = fitting or [one for one in offered[word] if one in own] or offered[word]
    return checks.unknown(f"setting of {whose}", name, own, next(iter(almost), None))


def _words(own: Collection[str]) -> dict[str, list[str]]:
    """Return the first parts of all names that tell a field of ``own``, each with its units."""
    found: dict[str, list[str]] = {}
    for field in own:
        first, unit = _split(field)
        if not unit:
            continue
        kinds = {word: UNITS[unit][0] for word in (first, *_words_for(WORDS, first), *_words_for(INSTABILITY, first))}
        kinds |= {word: kind for word, (target, kind, of) in WALKS.items() if (target, of) == (first, UNITS[unit][0])}
        if UNITS[unit][0] == "time":
            kinds = {first: "time"}
        for word, kind in kinds.items():
            found.setdefault(word, []).extend(unit for unit, (of, _) in UNITS.items() if of == kind)
    return found


def _words_for(words: Mapping[str, str], first: str) -> list[str]:
    return [word for word, target in words.items() if target == first]


def _scaled(name: str, value: Any, factor: float) -> Any:
    """Return a number, or a list of numbers, times a factor.

    Raises:
        ValueError: anything else.
    """
    parts = checks.items(value)
    if parts is not None:
        return tuple(_scaled(name, part, factor) for part in parts)
    return factor * checks.number(name, value)


def told(text: str, presets: Collection[str], kind: str = "preset") -> str | dict[str, Any]:
    """Return what a text of the command line tells of a sensor: the name of a preset, or a dict of settings.

    The text begins with the name of a preset, with a JSON or YAML file, or with a setting. Settings follow after commas:
    ``navigation,arw_deg_sqrt_h=0.002``, ``my_imu.yaml``, ``vel_std_mps=[0.1,0.1,0.2],pos_std_m=2``. A file holds the
    settings as keys, or is an IMU file of Kalibr.

    Raises:
        ValueError: an unknown preset, no NAME=VALUE, or a file that holds no settings.
        FileNotFoundError: no such file.
    """
    first, *more = _parts(text)
    settings: dict[str, Any] = {}
    if "=" in first:
        more = [first, *more]
    elif first in presets:
        settings["preset"] = first
    elif Path(first).suffix.lower() in (".json", *YAML_ENDINGS) or Path(first).is_file():
        settings |= read_sensor(Path(first))
    else:
        raise checks.unknown(kind, first, presets)
    given: dict[str, Any] = {}
    for part in more:
        name, equals, value = part.partition("=")
        if not (name and equals):
            raise checks.refused(f"setting of {kind}", part, "NAME=VALUE, with commas between")
        if name in given:
            raise ValueError(f"{kind}: {name} twice in {checks.shown(text)}; allowed: each setting once")
        given[name] = _value(value)
    return first if settings.keys() == {"preset"} and not given and first in presets else {**settings, **given}


def _parts(text: str) -> list[str]:
    """Split at the commas that are not within brackets."""
    parts, depth = [""], 0
    for letter in text:
        depth += (letter in "[(") - (letter in "])")
        if letter == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += letter
    return [part.strip() for part in parts]


def _value(text: str) -> Any:
    try:
        return parse_json(text)
    except json.JSONDecodeError:  # a name, such as that of a track
        return text


def read_sensor(path: Path) -> dict[str, Any]:
    """Read the settings of a sensor from a JSON or YAML file; those of Kalibr's IMU files become ours.

    Raises:
        ValueError: no object with settings.
        FileNotFoundError: no such file.
    """
    if not path.is_file():
        raise FileNotFoundError(
            f"no file {checks.shown(str(path))}; allowed: a preset's name, a JSON or YAML file, NAME=VALUE"
        )
    found = read_document(path)
    if isinstance(found, dict) and isinstance(found.get("imu0"), dict):
        found = found["imu0"]
    if not isinstance(found, dict) or not found or not all(isinstance(name, str) for name in found):
        raise ValueError(f"{path}: a {type(found).__name__}; allowed: an object with settings of a sensor, name: value")
    if not found.keys() & KALIBR.keys():
        return found
    return {ours: found[name] for name, ours in KALIBR.items() if name in found}


def to_kalibr(own: Mapping[str, float]) -> dict[str, float]:
    """Return the values of a Kalibr file for the fields of an IMU; its random walks are those that begin like the biases."""
    out = {}
    for theirs, ours in KALIBR.items():
        field, factor = _field(ours, own, "an IMU")
        out[theirs] = own[field] / factor
    return out
