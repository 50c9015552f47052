"""Scenarios as files: the suite's and one's own, changed word by word, with tags, and key by key."""

import json
from functools import cache
from typing import Any

import yaml
from hypothesis import strategies as st

from fuzz.kind import kind, put
from fuzz.outcome import attempt, check_finite
from fuzz.values import JSON_VALUES, as_bytes, edited_mapping, edited_text, play, text_edits
from fuzz.worlds import tagged, tags
from sins_env.envs.environments import ScenarioEnv
from sins_env.evaluation.tasks.catalogue import suite_files
from sins_env.scenarios.scenario import Scenario
from sins_env.scenarios.table import every_key

OWN = """\
name: ferry-v0
what: a ferry at the quay
motion:
  kind: sway
  roll: [{amplitude_deg: 4.0, period_s: 9.5}, {amplitude_deg: 1, period_s: 3}]
  pitch: {amplitude_deg: 1.5, period_s: 6.0, phase_deg: 30}
  surge: {amplitude_m: 0.1, period_s: 8.0}
site: {latitude_deg: 54.3, longitude_deg: 10.1, heading_deg: any}
imu: {preset: navigation, arw_deg_sqrt_h: 0.003}
gps: {vel_std_mps: 0.03, rate_hz: 5, outages_s: [[1, 2]]}
aids: {odometer: {rate_hz: 5}, depth: {}}
start: {kind: told, attitude_std_deg: [1, 1, 5]}
told: {imu: tactical, prior: thesis}
epoch_s: 0.1
samples_per_epoch: 2
duration_s: 3
score: {azimuth_deg: 1, level_arcsec: 60, rank_by: azimuth}
"""
FLIGHT = """\
motion:
  kind: flight
  speed_mps: 20
  segments:
    - [cruise, 1]
    - [accelerate, 3, 0.2]
    - {duration_s: 10, accel_mps2: 0.1}
site: {latitude_deg: 10, height_m: 100, heading_deg: 45}
start: {kind: told, errors: fixed, position_std_m: 3}
duration_s: 3
"""
CAR = (
    "motion: {kind: vehicle, scene: [doors, people], events_per_min: 3}\nsite: {heading_deg: [1, 2]}\nduration_s: 93\n"
)


@cache
def texts() -> list[str]:
    return [OWN, FLIGHT, CAR, OWN, FLIGHT, *(path.read_text() for path in suite_files())]


which, key = st.integers(0, 100), st.sampled_from(sorted(every_key()))
scenarios = st.one_of(
    st.tuples(st.just("yaml"), which, text_edits),
    st.tuples(st.just("tags"), which, tags),
    st.tuples(st.just("keys"), which, st.lists(st.tuples(key, st.sampled_from(JSON_VALUES)), max_size=3)),
    st.tuples(st.just("json text"), which, text_edits),
)


def scenario_text(how: str, which: int, edits: Any) -> tuple[str, str]:
    """Return the name and the text of a scenario."""
    text = texts()[which % len(texts())]
    if how == "yaml":
        return "s.yaml", edited_text(text, edits)
    if how == "tags":
        return "s.yaml", tagged(text, edits)
    if how == "json text":
        return "s.json", edited_text(json.dumps(yaml.safe_load(text), indent=1), edits)
    made = edited_mapping(yaml.safe_load(text), [])
    for path, value in edits:
        *around, last = path.split(".")
        place = made
        for name in around:
            inner = place.setdefault(name, {})
            place = inner if isinstance(inner, dict) else place
        place[last] = play(value)
    return "s.json", json.dumps(made, indent=1)


@kind("scenarios", scenarios, share=14, slice=100)
def scenario(example: Any) -> str:
    name, text = scenario_text(*example)
    path = put(name, as_bytes(text))
    lines = (
        f"{name}: line ",
        f"{name}: a NUL byte in line ",
        f"{name}: UTF-16",
    )  # a NUL byte or another encoding is of the file
    found = attempt(lambda: Scenario.of(path), lines)
    given = Scenario.of(path) if found == "worked" else None
    if given is None or "recording" in given.kwargs or given.kwargs.get("duration", 1e9) > 100 or len(text) > 3000:
        return found

    def go() -> None:
        env: Any = ScenarioEnv(scenario=str(path))
        if env.task.n_sub > 100:
            return
        obs, _ = env.reset(seed=0)
        check_finite("observation", obs)
        check_finite("observation", env.step(env.action_space.sample())[0])

    return attempt(go)
