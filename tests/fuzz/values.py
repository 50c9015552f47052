"""Values that users may type or send by mistake or by intent, and changes to bytes, texts and mappings.

An example is a literal of Python. What has no literal is a :class:`Code`, the text of an expression; its repr is that text,
so that a printed example can be run.
"""

import json
import math
from typing import Any

import numpy as np
from hypothesis import strategies as st


class Code(str):
    """The text of an expression, evaluated when the example is played."""

    __slots__ = ()

    def __repr__(self) -> str:
        return str(self)


def play(value: Any) -> Any:
    """Return an example with the values of its expressions."""
    if isinstance(value, Code):
        return eval(str(value), {"np": np, "math": math})
    if isinstance(value, dict):
        return {play(k): play(v) for k, v in value.items()}
    if type(value) in (list, tuple):
        return type(value)(play(v) for v in value)
    return value


PLAIN = [
    None, True, False, 0, 1, -1, 2, 3, 0.0, -0.0, 1e-300, 1e300, 1e-3, 0.1, 10, 1e9, 10**30, "", "a", "told", "unknown", "1",
    "nan", "\x00", "ü", "\udcff", [], [1], [1, 2, 3], [[1]], {}, {"a": 1}, (), (1, 2), b"x", [None], ["a"], {"preset": "thesis"},
    {"preset": 3}, 100, 90, 180, 360, 60, 30, 12.0, 89.9, -89.9, 90.0, 5e-324, 1e-9, 1e6, 1e12, 2**63, 1.7e308, {1: 2}, {None: 1},
]  # fmt: skip
CODES = [
    Code(text)
    for text in (
        "math.nan", "math.inf", "-math.inf", "-(10**400)", "10**5000", "[math.nan] * 3", "[0.0] * 100000", "'x' * 100000",
        "1j", "{1}", "range(3)", "object()", "int", "(lambda: 0)", "Exception()", "bytearray(3)", "[[[[[[[[]]]]]]]]",
        "type('T', (), {'__repr__': lambda _: 1 / 0})()",
        "np.float64(3)", "np.int64(2)", "np.bool_(True)", "np.float32('nan')", "np.longdouble('1e4000')", "np.ma.masked",
        "np.datetime64('2020-01-01')", "np.array(2.0)", "np.array([1.0, 2, 3])", "np.array([])", "np.array([None])",
        "np.ones((2, 2, 2))", "np.ones(3, dtype='f2')", "np.array([1j] * 3)", "np.array('x')",
    )
]  # fmt: skip
junk = st.sampled_from(PLAIN + CODES)  #: any value at all
mild = (
    st.sampled_from([0, 0.0, 0.5, 1, 2, 5, 10, 100]) | st.floats(1e-3, 1e3) | st.integers(1, 300)
)  #: ordinary numbers
extreme = st.sampled_from([x for x in PLAIN if type(x) in (int, float)] + CODES[:5]) | st.floats() | st.integers()
numbers = mild | extreme
some = st.integers(0, 1 << 20)  #: a place, taken modulo the length

#: Changes of bytes: how, where, and what is put there.
byte_edits = st.lists(
    st.tuples(
        st.sampled_from(["set", "set", "set", "put", "cut", "drop"]),
        st.sampled_from("abcd"),
        some,
        st.binary(max_size=9),
    ),
    min_size=1,
    max_size=6,
)


def edited_bytes(data: bytes, edits: list[tuple[str, str, int, bytes]]) -> bytes:
    """Return bytes with changes; "a" means anywhere, "b" near the start, "c" near the end, "d" in the first eighth."""
    made = bytearray(data)
    for how, where, at, new in edits:
        n = max(len(made), 1)
        near = {"a": at % n, "b": at % min(n, 400), "c": n - 1 - at % min(n, 600), "d": at % max(n // 8, 1)}[where]
        if how == "set":
            made[near : near + len(new)] = new
        elif how == "put":
            made[near:near] = new
        elif how == "drop":
            del made[near : near + 1 + len(new)]
        else:
            del made[near:]
    return bytes(made)


TOKENS = (
    "nan", "inf", "-inf", "1e400", "1e300", "-1e300", "abc", "", "1_0", "0x10", "１", "1,5", "--", "#", "\x00", "\ufeff",
    "1e-400", "99999999999999999999", "\r", "\t\t", "é", "1;2", "%", "'", '"', "0", "-1", "1e9", "1e-9", "1e30", "100", "9" * 400,
    "\udc80", "\u202e", "\x1b[31m", "9" * 5000, "0 " * 3000,
)  # fmt: skip
text_edits = st.lists(
    st.tuples(st.sampled_from(["swap", "cut", "line", "add", "twice", "end", "comma", "tab", "reverse"]), some, some,
              st.sampled_from(TOKENS)),
    min_size=1,
    max_size=4,
)  # fmt: skip


def edited_text(text: str, edits: list[tuple[str, int, int, str]]) -> str:
    """Return a text of lines and words with changes."""
    lines = text.split("\n")
    for how, i, j, token in edits:
        lines = lines or [""]
        i %= len(lines)
        line = lines[i]
        if how == "swap":
            words = line.replace(",", " , ").split(" ")
            words[j % len(words)] = token
            lines[i] = " ".join(words).replace(" , ", ",")
        elif how == "cut":
            lines[i] = line[: j % (len(line) + 1)]
        elif how == "line":
            lines.insert(i, token)
        elif how == "add":
            lines[i] = f"{line} {token}"
        elif how == "twice":
            lines.insert(i, line)
        elif how == "end":
            lines = lines[: i + 1]
        elif how == "reverse":
            lines = lines[: i + 1] + lines[:i:-1]
        else:
            lines[i] = line.replace(" ", ";" if how == "comma" else "\t")
    return "\n".join(lines)


def as_bytes(text: str) -> bytes:
    """Return UTF-8 with lone surrogates as they are."""
    return text.encode("utf-8", "surrogatepass")


#: What JSON can hold and a mapping or a flight does not expect.
JSON_VALUES = [
    None, True, 0, -1, 1.5, 1e300, 1e-300, "", "x", "FRD", "deg", [], [1, 2, 3], ["a"], {}, {"columns": [1, 2, 3]}, {"column": 1},
    [1e9] * 3, [91, 0, 0], "../../../etc/passwd", "/dev/null", "/dev/zero", ".", 10**30, 1e9, [[1]], "\x00", "é", 10**299,
    "a" * 3000,
    Code("math.nan"), Code("math.inf"), [[[[[[]]]]]], {"columns": [1, 1, 1], "unit": 3}, {"column": 10**12}, {"column": "\udc80"},
]  # fmt: skip
KEYS = (
    "x",
    "file",
    "axes",
    "unit",
    "columns",
    "rate_hz",
    "resample_hz",
    "gnss",
    "reference",
    "time",
    "segments",
    "earth",
    "format",
)
mapping_edits = st.lists(
    st.tuples(
        st.lists(some, max_size=2), st.sampled_from(["set", "set", "new", "pop"]), some, st.sampled_from(JSON_VALUES)
    ),
    min_size=1,
    max_size=3,
)


def edited_mapping(given: dict[str, Any], edits: list[tuple[list[int], str, int, Any]]) -> dict[str, Any]:
    """Return a mapping with changes at any depth; ``given`` stays as it is."""
    made: dict[str, Any] = json.loads(json.dumps(given))
    for path, how, which, value in edits:
        place = made
        for step in path:
            inner = [v for v in place.values() if isinstance(v, dict)]
            place = inner[step % len(inner)] if inner else place
        key = KEYS[which % len(KEYS)] if how == "new" or not place else list(place)[which % len(place)]
        if how == "pop":
            place.pop(key, None)
        else:
            place[key] = play(value)
    return made
