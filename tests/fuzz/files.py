"""Recordings of every format, changed byte by byte, word by word and array by array, and what is no file at all."""

import io
import json
import os
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from oracles import made, recorded
from scipy.io import loadmat, savemat

from fuzz.kind import folder, kind, put
from fuzz.outcome import attempt, check_finite
from fuzz.values import as_bytes, byte_edits, edited_bytes, edited_mapping, edited_text, mapping_edits, some, text_edits
from sins_env import recordings
from sins_env.recordings.guessing import guess


@cache
def _plain() -> dict[str, dict[str, bytes]]:
    place, found = folder() / "base", {}
    place.mkdir()
    recording = made.recording(samples=300, rate=20.0, t0=0.0)
    for kind_, name in (
        ("npz", "x.npz"),
        ("csv", "x.csv"),
        ("kfgins", "x.txt"),
        ("psins-imu", "x.imu"),
        ("psins-mat", "x.mat"),
    ):
        paths = recordings.save(recording, place / name, format=kind_, overwrite=True)
        found[kind_] = {path.name: path.read_bytes() for path in paths}
    found["counts"] = {"x.npz": Path(recorded.counts(place / "c.npz", 200)).read_bytes()}
    found["increments"] = {"x.npz": Path(recorded.increments(place / "i.npz", 900)).read_bytes()}
    return found


@cache
def base() -> dict[str, dict[str, bytes]]:
    """Return the files of a sound recording by format, the recording's own first."""
    found = dict(_plain())
    for name in ("npz", "counts", "increments"):
        found[f"{name} compressed"] = {"x.npz": zipped(arrays(name), np.savez_compressed)}
    variables = matlab()
    found |= foreign()
    for name, more in (("plain", {}), ("v4", {"format": "4"})):
        found[f"mat {name}"] = {"x.mat": saved(variables, **more)}
    found["mat trj"] = {"x.mat": saved({"trj": variables})}
    return found


def foreign() -> dict[str, dict[str, bytes]]:
    """Return a NovAtel log, a KF-GINS text with the fixes of RTKLIB, and one table of dates with fixes in some rows."""
    whole = {"axes": "RFU", "site": [48.1, 11.6, 520.0]}
    log, rows, one = [], [], ["# t, wx, wy, wz, ax, ay, az, lat, lon, h"]
    for k in range(1, 200):
        log.append(f"%RAWIMUSXA,2100,{k / 10:.1f};00,26,2100,{k / 10:.1f},77,49000000,{k % 7},-3,{k % 5},9,-8*00")
        rows.append(f"{k / 10:.1f} 0.001 0.002 0.003 0,1 0.2 -0.98".replace(",", "."))
        fix = "48.1, 11.6, 520" if k % 10 == 0 else ", ,"
        one.append(f"2026-06-01T10:00:{k / 10:04.1f}Z, 0.01, 0.02, {k % 7}.D-3, 0.1, 0.2, 9.81, {fix}")
    fixes = [
        "% GPST latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m) age(s) ratio"
    ]
    fixes += [f"2020/04/05 00:00:{k:02d}.000 48.1 11.6 520 1 9 1 1 2 0 0 0 0 9" for k in range(1, 19)]
    gnss = {"time": {"column": 1}, "position": {"columns": [8, 9, 10]}}
    table = {
        **whole,
        "time": {"column": "t"},
        "gyro": {"columns": ["wx", "wy", "wz"], "unit": "rad/s"},
        "accel": {"columns": [5, 6, 7], "unit": "m/s2"},
        "gnss": gnss,
    }

    def text(lines: list[str]) -> bytes:
        return ("\n".join(lines) + "\n").encode()

    return {
        "novatel": {"x.asc": text(log), "x.json": json.dumps(whole).encode()},
        "rtklib": {"x.txt": text(rows), "x.pos": text(fixes), "x.json": b'{"gnss": "x.pos"}'},
        "one table": {"x.csv": text(one), "x.json": json.dumps(table).encode()},
    }


def zipped(given: dict[str, Any], save: Any = np.savez) -> bytes:
    out = io.BytesIO()
    save(out, **given)
    return out.getvalue()


def saved(given: dict[str, Any], **more: Any) -> bytes:
    out = io.BytesIO()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        savemat(out, given, **more)
    return out.getvalue()


@cache
def _arrays(name: str) -> dict[str, Any]:
    return dict(np.load(io.BytesIO(_plain()[name]["x.npz"])))


def arrays(name: str) -> dict[str, Any]:
    return dict(_arrays(name))


@cache
def matlab() -> dict[str, Any]:
    return {k: v for k, v in loadmat(io.BytesIO(_plain()["psins-mat"]["x.mat"])).items() if not k.startswith("__")}


def loaded(path: Path, **more: Any) -> str:
    """Load and summarise a recording."""

    def go() -> None:
        recording = recordings.load(path, **more)
        there = ~recording.missing
        check_finite("increments", {"dtheta": recording.dtheta[there], "dvel": recording.dvel[there]})
        check_finite("rate", [recording.rate_hz, recording.t0])
        for part in (recording.gnss, recording.reference):
            for field, values in part._asdict().items() if part is not None else ():
                if values is not None:
                    check_finite(field, values)
        recordings.summarise(recording)

    return attempt(go, (path.stem, path.parent.name, "/proc/"))


VALUES = (np.nan, np.inf, -1, 0, 1e300, 1e-300, 3, 1e9, -1e300, 1e30, -1e9)
FACTORS = (0, -1, 1e-9, 1e9, 1e200)
array_edits = st.lists(st.tuples(some, st.integers(0, 13), some), min_size=1, max_size=3)


def edited_arrays(given: dict[str, Any], edits: list[tuple[int, int, int]]) -> dict[str, Any]:
    """Return arrays with changes of values, shapes and types."""
    out = dict(given)
    for which, how, at in edits:
        if not out:
            return out
        key = list(out)[which % len(out)]
        v = np.asarray(out[key])
        number = v.dtype.kind in "iuf"
        if how == 0:
            del out[key]
        elif how == 1:
            out[key] = np.array(VALUES[at % len(VALUES)])
        elif how in (2, 3) and v.size and number:
            out[key] = v.astype(float)
            out[key].flat[(at // 16) % v.size] = VALUES[at % len(VALUES)]
        elif how == 4:
            out[key] = v[: at % 4] if v.ndim else v
        elif how == 5:
            out[key] = np.array("text")
        elif how == 6 and number:
            out[key] = v.astype(["c16", "f2", "f4", "i1", "U5", "S5", "O", "g", "u8", "?"][at % 10])
        elif how == 7:
            out[key] = v[None]
        elif how == 8:
            out[key] = v[::-1] if v.ndim else v
        elif how == 9 and number:
            out[key] = v * FACTORS[at % len(FACTORS)]
        elif how == 10:
            out[key] = v[..., None]
        elif how == 11 and v.ndim:
            out[key] = np.repeat(v, 2, axis=0)
        elif how == 12:
            out[key] = v.T
        else:
            out[key] = np.zeros((at % 4, at % 7))
    return out


def saving(given: dict[str, Any], edits: Any, save: Any) -> bytes:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return save(edited_arrays(given, edits))
        except Exception:  # what savez or savemat itself refuses
            return save({})


NPZ = ("npz", "counts", "increments", "npz compressed", "counts compressed", "increments compressed")


@kind("NPZ, bytes", st.tuples(st.sampled_from(NPZ), byte_edits), share=10, slice=60, prepare=base)
def npz_bytes(example: Any) -> str:
    name, edits = example
    return loaded(put("f.npz", edited_bytes(base()[name]["x.npz"], edits)))


@kind("NPZ, arrays", st.tuples(st.sampled_from(NPZ[:3]), array_edits), share=10, slice=60, prepare=base)
def npz_arrays(example: Any) -> str:
    name, edits = example
    base()
    return loaded(put("f.npz", saving(arrays(name), edits, zipped)))


MAT = ("psins-mat", "mat plain", "mat v4", "mat trj")


@kind("MAT, bytes", st.tuples(st.sampled_from(MAT), byte_edits), share=0.1, slice=2, prepare=base)
def mat_bytes(example: Any) -> str:
    name, edits = example
    return loaded(put("f.mat", edited_bytes(base()[name]["x.mat"], edits)))


@kind("MAT, arrays", array_edits, share=0.1, slice=2, prepare=base)
def mat_arrays(example: Any) -> str:
    base()
    return loaded(put("f.mat", saving(matlab(), example, saved)))


TEXTS = ("csv", "kfgins", "psins-imu", "novatel", "rtklib", "one table")
which_text = st.tuples(st.sampled_from(TEXTS), some)


def changed(form: str, which: int, change: Any) -> Path:
    """Write the files of a format, one of them changed, and return the recording's own."""
    files = base()[form]
    target = list(files)[which % len(files)]
    paths = [put(f"d/{name}", change(name, data) if name == target else data) for name, data in files.items()]
    return paths[0]


@kind("text, words", st.tuples(which_text, text_edits), share=12, slice=60, prepare=base)
def text_words(example: Any) -> str:
    (form, which), edits = example
    return loaded(changed(form, which, lambda name, data: as_bytes(edited_text(data.decode(), edits))))


@kind("text, bytes", st.tuples(which_text, byte_edits), share=6, slice=40, prepare=base)
def text_bytes(example: Any) -> str:
    (form, which), edits = example
    return loaded(changed(form, which, lambda name, data: edited_bytes(data, edits)))


@kind("map", st.tuples(st.sampled_from(("csv", "kfgins", "one table")), text_edits), share=3, slice=12, prepare=base)
def first_mappings(example: Any) -> str:
    form, edits = example
    path = changed(form, 0, lambda name, data: as_bytes(edited_text(data.decode(), edits)))
    return attempt(lambda: guess(path), (path.stem,))


@kind(
    "mappings",
    st.tuples(st.sampled_from(["csv", "kfgins", "one table", "novatel"]), mapping_edits),
    share=10,
    slice=60,
    prepare=base,
)
def mappings(example: Any) -> str:
    form, edits = example

    def change(name: str, data: bytes) -> bytes:
        return json.dumps(edited_mapping(json.loads(data), edits)).encode()

    return loaded(changed(form, len(base()[form]) - 1, change))


def _none(path: Path) -> None:
    """Make nothing."""


def _text(data: bytes) -> Any:
    return lambda path: path.write_bytes(data)


#: Nine to the fourteenth values.
BILLION = b"a: &a [x,x,x,x,x,x,x,x,x]\n" + b"".join(
    b"%c: &%c [%s]\n" % (i + 1, i + 1, b",".join([b"*%c" % i] * 9)) for i in range(97, 110)
)
ROW = b"1 0 0 0 0 0 0.0981\n"
#: What stands where a recording, a mapping or a flight is expected.
PLACES = {
    "folder": os.mkdir,
    "pipe": os.mkfifo,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "full": lambda path: path.symlink_to("/dev/full"),
    "loop": lambda path: path.symlink_to(path),
    "dangling": lambda path: path.symlink_to(path.with_name("nowhere")),
    "endless": lambda path: path.symlink_to("/proc/self/pagemap"),
    "nothing": _none,
    "empty": _text(b""),
    "newline": _text(b"\n" * 100),
    "sparse": lambda path: (path.touch(), os.truncate(path, 9 << 30)),
    "zeros": lambda path: (path.touch(), os.truncate(path, 300 << 20)),
    "long line": _text(b"1 " * (8 << 20)),
    "utf-16": _text(ROW.decode().encode("utf-16")),
    "utf-16 bare": _text(ROW.decode().encode("utf-16-le") * 30),
    "bom": _text(b"\xef\xbb\xbf" + ROW * 30),
    "crlf": _text(ROW.replace(b"\n", b"\r\n") * 30),
    "cr": _text(ROW.replace(b"\n", b"\r") * 30),
    "commas": _text(b"0,01 0 0 0 0 0 0,1\n" * 30),
    "gz": _text(b"\x1f\x8b" + ROW * 30),
    "latin": _text(b"\xe9t\xe9 1 2 3\n" * 30),
    "deep": _text(b"[" * 100000),
    "deep closed": _text(b"[" * 40 + b"]" * 40),
    "deep object": _text(b'{"a":' * 5000 + b"1" + b"}" * 5000),
    "digits": _text(b'{"site": ' + b"9" * 100000 + b"}"),
    "keys": _text(b"{" + b",".join(b'"k%d": 1' % i for i in range(200000)) + b"}"),
    "twice": _text(b'{"site": 1, "site": 2}'),
    "billion": _text(BILLION),
    "itself": _text(b"a: &a [*a]"),
    "big": _text(b'{"a": "' + b"x" * (5 << 20) + b'"}'),
}  # fmt: skip
ENDINGS = (".npz", ".csv", ".txt", ".imu", ".json", ".mat", ".yaml")


@kind(
    "places of files",
    st.tuples(st.sampled_from(sorted(PLACES)), st.sampled_from(ENDINGS), st.booleans()),
    share=1.5,
    slice=12,
)
def places(example: Any) -> str:
    what, ending, as_mapping = example
    path = folder() / f"place{ending}"
    if path.is_dir() and not path.is_symlink():
        path.rmdir()
    path.unlink(missing_ok=True)
    PLACES[what](path)
    if ending in (".json", ".yaml"):
        from sins_env.trajectory.plan import FlightPlan

        if not as_mapping:
            return attempt(lambda: FlightPlan.of(path), (path.stem,))
    if as_mapping:
        other = put("sound.npz", base()["npz"]["x.npz"])
        return attempt(lambda: recordings.load(other, mapping=path), (path.stem,))
    return loaded(path)
