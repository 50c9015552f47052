"""Keyword arguments of environments, actions, seeds and options of a reset, and flights as files."""

import contextlib
import dataclasses
import json
import warnings
from functools import cache
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from hypothesis import strategies as st
from oracles import made

from fuzz.kind import folder, kind, put
from fuzz.outcome import attempt, check_finite
from fuzz.values import (
    JSON_VALUES,
    as_bytes,
    edited_mapping,
    edited_text,
    junk,
    mapping_edits,
    mild,
    numbers,
    play,
    text_edits,
)
from sins_env import recordings
from sins_env.envs import ENV_IDS
from sins_env.envs.environments import ENVIRONMENTS, NavFlightEnv
from sins_env.specs import GPS_PRESETS, IMU_PRESETS, GpsSpec, ImuSpec
from sins_env.trajectory.plan import FlightPlan

MOST_SAMPLES = 1e5  #: samples of an episode that is played; longer ones are made and reset


def names(cls: type) -> list[str]:
    return [f.name for f in dataclasses.fields(cls)]


def spec(fields: list[str], presets: dict[str, Any]) -> Any:
    changes = st.dictionaries(st.sampled_from([*fields, "preset"]), junk | numbers | mild, min_size=1, max_size=2)
    named = st.fixed_dictionaries({"preset": st.sampled_from(sorted(presets))}, optional={f: mild for f in fields[:3]})
    return changes | named | st.sampled_from(sorted(presets))


imu, gps = spec(names(ImuSpec), IMU_PRESETS), spec(names(GpsSpec), GPS_PRESETS)
row = st.lists(junk | numbers, max_size=6) | st.tuples(
    st.sampled_from(["cruise", "turn", "climb", "roll"]), numbers, numbers
)
event = st.fixed_dictionaries(
    {"t": numbers, "kind": st.sampled_from(["in", "out", "door", "rock", "x"])},
    optional={"seat": junk, "scale": numbers},
)
SPECIAL = {
    "imu": imu,
    "gps": gps,
    "profile": st.fixed_dictionaries(
        {"latitude_deg": junk, "longitude_deg": junk, "segments": st.lists(row, max_size=3)}
    )
    | st.fixed_dictionaries(
        {"latitude_deg": st.just(30), "longitude_deg": st.just(110), "segments": st.lists(row, min_size=1, max_size=3)},
        optional={"speed_mps": numbers, "height_m": numbers, "heading_deg": numbers, "earth": junk},
    ),
    "heading_deg": st.lists(numbers, max_size=3),
    "events": st.lists(event, max_size=3),
    "misalignment_deg": st.lists(numbers, min_size=3, max_size=3),
    "duration": st.sampled_from([1.0, 5.0, 3.0, 300.0]),
    "start": st.sampled_from(["told", "unknown"]),
    "coarse": st.sampled_from([0.0, 1.0, 90.0]),
}


GOOD = {
    "epoch": [0.1, 0.2, 0.05],
    "n_sub": [1, 2, 10], "vibration": [True], "motion": ["random"], "earth": ["thesis"], "prior": ["thesis"],
    "imu": ["mems", "tactical", "rlg-car"], "gps": ["dgps", "perfect"], "any_heading": [True], "latitude_deg": [0.0, -60.0, 89.0],
    "heading_deg": [None, 100.0, [0.0, 90.0]], "misalignment_deg": [(1.0, 2.0, 30.0)], "events": ["mixed", "rocking"],
    "event_rate_per_min": [30.0], "mode": ["navigate"], "window": [(1.0, 5.0)], "stride": [1.0], "errors": ["fixed"],
    "attitude_std_deg": [(1.0, 1.0, 20.0)], "velocity_std_mps": [1.0], "position_std_m": [5.0], "profile": ["lu-gauss", "zhao2010"],
    "reveal_truth": [True], "render_mode": ["rgb_array"],
}  # fmt: skip


def keywords(env_id: str) -> Any:
    """Return the strategy of keyword arguments: one or two wild ones among good ones."""
    known = [*names(ENVIRONMENTS[env_id].single.settings), "reveal_truth", "render_mode"]
    good = {name: st.sampled_from(GOOD[name]) for name in known if name in GOOD}
    base = {"recording": st.just("made.npz")} if env_id == "SINS/Replay-v0" else {}
    some_good = st.lists(st.sampled_from(sorted(good)), max_size=2, unique=True).flatmap(
        lambda some: st.fixed_dictionaries({**base, **{name: good[name] for name in some}})
    )
    wild = st.sampled_from([*known, *known, "durration"]).flatmap(
        lambda name: st.tuples(
            st.just(name), st.one_of(junk, numbers, mild, *([SPECIAL[name]] * 5 if name in SPECIAL else []))
        )
    )
    return st.tuples(
        st.just(env_id),
        st.builds(lambda one, other: {**one, **dict(other)}, some_good, st.lists(wild, min_size=1, max_size=2)),
        st.sampled_from([0, 5]),
    )


@kind("environment settings", st.sampled_from([*ENV_IDS[:-1]]).flatmap(keywords), share=14, slice=60)
def settings(example: Any) -> str:
    env_id, given, seed = play(example)
    if given.get("recording") == "made.npz":
        given["recording"] = str(replayed())
    elif env_id != "SINS/Replay-v0":
        given.setdefault("duration", 3.0)

    def go() -> None:
        env: Any = ENVIRONMENTS[env_id].single(**given)
        obs, info = env.reset(seed=seed)
        check_finite("observation", obs)
        check_finite("start", info["start"])
        if env.task.n_sub * env.task.num_epochs > MOST_SAMPLES and env.task.n_sub > 1000:
            return
        for _ in range(4):
            obs, reward, _, over, info = env.step(env.action_space.sample())
            check_finite("observation", obs)
            check_finite("reward", reward)
            check_finite("errors", info["errors"])
            if over:
                break

    return attempt(go)


@cache
def replayed() -> Path:
    path = folder() / "made.npz"
    recordings.save(made.recording(samples=1200, t0=0.0), path)
    return path


@cache
def environments() -> list[Any]:
    found: list[Any] = [
        gymnasium.make("SINS/AlignSway-v0", duration=3.0).unwrapped,
        gymnasium.make("SINS/NavFlight-v0", duration=3.0).unwrapped,
        gymnasium.make_vec("SINS/AlignSway-v0", num_envs=2, duration=3.0),
    ]
    for env in found:
        env.reset(seed=0)
    return found


SHAPES = ((4,), (10,), (2, 4))
elements = st.floats() | st.sampled_from([1e308, -1e308, 5e-324, 1e200, 3.14159, 100, 10**400, 1j, None, "1", True])
actions = st.tuples(
    st.integers(0, 2),
    junk
    | st.lists(elements, min_size=4, max_size=4)
    | st.lists(elements, min_size=10, max_size=10)
    | st.lists(st.lists(elements, min_size=4, max_size=4), min_size=2, max_size=2)
    | st.lists(st.lists(elements, max_size=4), max_size=3),
    st.sampled_from([None, None, None, "f4", "f2", "c16", "O", "U10", "i8", "M8[s]", "S3"]),
)


@kind("actions", actions, share=14, slice=120, prepare=environments)
def action(example: Any) -> str:
    which, given, dtype = play(example)
    env = environments()[which]
    if dtype:
        with warnings.catch_warnings(), contextlib.suppress(Exception):  # what has no such type stays as it is
            warnings.simplefilter("ignore")
            given = np.array(given, dtype=dtype)

    def go() -> None:
        if env.episode.k > env.episode.task.num_epochs:
            env.reset(seed=0)
        obs, reward, _, _, info = env.step(given)
        check_finite("observation", obs)
        check_finite("reward", reward)
        check_finite("errors", info["errors"])

    return attempt(go)


resets = st.tuples(
    st.integers(0, 2),
    junk,
    st.none() | junk | st.dictionaries(st.sampled_from(["record", "window", "x"]), junk, max_size=2),
)


@kind("seeds and options", resets, share=4, slice=60, prepare=environments)
def reset(example: Any) -> str:
    which, seed, options = play(example)
    try:
        return attempt(lambda: environments()[which].reset(seed=seed, options=options))
    finally:
        environments()[which].reset(seed=0)


YAML = """latitude_deg: 30
longitude_deg: 110
height_m: 500
speed_mps: 40
heading_deg: 10
segments:
  - [cruise, 10]
  - [accelerate, 10, 0.2]
  - [turn, 20, 1.5]
  - [turn, 20, 1, -1]
  - [climb, 5, 0.5]
  - [descend, 5, 0.5]
  - [10, 0.1, 0, 0, 0.5]
  - {duration_s: 10, accel_mps2: 0.1}
"""
PLAN = {
    "latitude_deg": 30,
    "longitude_deg": 110,
    "height_m": 500,
    "speed_mps": 40,
    "segments": [["cruise", 10], ["turn", 20, 1.5], [10, 0.1], {"duration_s": 10}],
}
TAGS = (
    "&a [*a]", "!!python/object/apply:os.system ['touch PWNED']", "!!python/name:os.system", "2020-01-01", "2020-99-99",
    "!!binary aGVsbG8=", "!!set {a}", "? [a]: b", ".nan", ".inf", "0x1F", "1:30:00", "1e3", "~", "{<<: *x}", "|\n  x",
    "!!float abc", "!!timestamp x", "!!int x", "0o9", "[[[[[]]]]]", "&x", "*x", "%TAG", "---", "...", "\x07", "\t- x",
    "[" * 2000, "{a: " * 50, "&a " + "[x,x,x,x]", "[*a,*a]", "<<: {latitude_deg: 1}", "!!bool x", "!!omap [a]", "!!pairs 3",
    "0x" + "f" * 5000, "9" * 5000, "!!null 1", "=", "!<tag:yaml.org,2002:str> x", "- - - - x", "latitude_deg: 4",
)  # fmt: skip
SEGMENTS = [
    None, ["cruise", 10**300],
    [], "x", {}, [1e300], ["turn", 1, 1e300], ["turn", 1e-300, 1], [0.1] * 7, ["cruise", 1e9], ["cruise", -1], ["Cruise", 1],
    {"duration_s": None}, [True], [[1]], ["climb", 1, [1]], ["turn", 1, "a"],
    ["cruise", 1e12], [1, 1e308, -1e308], ["cruise", 1e-320],
    ["roll", 1, 1e17], ["turn", 5, 1e17, -1e17],
]  # fmt: skip
tags = st.lists(st.tuples(st.integers(0, 40), st.sampled_from("ab"), st.sampled_from(TAGS)), max_size=3)


def tagged(text: str, edits: list[tuple[int, str, str]]) -> str:
    """Return a YAML text whose lines have other values, or more behind them."""
    lines = text.split("\n")
    for at, where, tag in edits:
        key = lines[at % len(lines)].split(":")[0] if where == "a" else lines[at % len(lines)]
        lines[at % len(lines)] = f"{key}: {tag}" if where == "a" else f"{key} {tag}"
    return "\n".join(lines)


flights = st.one_of(
    st.tuples(st.just("yaml"), text_edits, st.just([])),
    st.tuples(st.just("tags"), tags, st.just([])),
    st.tuples(st.just("json"), mapping_edits, st.lists(st.sampled_from(SEGMENTS), max_size=2)),
    st.tuples(st.just("json text"), text_edits, st.just([])),
    st.tuples(
        st.just("numbers"),
        st.lists(st.tuples(st.sampled_from(JSON_VALUES), numbers), max_size=2),
        st.lists(numbers, max_size=6),
    ),
)


def flight_text(how: str, edits: Any, more: Any) -> tuple[str, str]:
    """Return the name and the text of a flight."""
    if how == "yaml":
        return "f.yaml", edited_text(YAML, edits)
    if how == "tags":
        return "f.yaml", tagged(YAML, edits)
    if how == "json text":
        return "f.json", edited_text(json.dumps(PLAN, indent=1), edits)
    if how == "numbers":
        return "f.json", json.dumps({**PLAN, "segments": [["cruise", 10], more]})
    plan = edited_mapping(PLAN, edits)
    if isinstance(plan.get("segments"), list):
        plan["segments"] += play(more)
    return "f.json", json.dumps(plan)


@kind("flights", flights, share=14, slice=120)
def flight(example: Any) -> str:
    how, edits, more = example
    name, text = flight_text(how, edits, more)
    path = put(name, as_bytes(text))

    def go() -> None:
        env: Any = NavFlightEnv(profile=str(path))
        obs, _ = env.reset(seed=0)
        check_finite("observation", obs)
        check_finite("observation", env.step(env.action_space.sample())[0])

    found = attempt(lambda: FlightPlan.of(path), (name,))
    return found if found == "refused" or len(text) > 10_000 else attempt(go)
