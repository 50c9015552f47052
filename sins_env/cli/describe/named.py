"""The verb ``describe``: everything about one environment, task, solver, preset, flight or recording."""

from __future__ import annotations

import dataclasses
import inspect
from argparse import Namespace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.markup import escape

from sins_env import recordings
from sins_env.checks import unknown
from sins_env.cli.describe import figures, layout
from sins_env.cli.describe.flight import describe_flight, draw_flight, is_motion
from sins_env.cli.describe.listing import KINDS, environments
from sins_env.cli.describe.recording import describe_recording, is_recording
from sins_env.cli.describe.scenario import as_yaml, describe_keys, is_scenario_file
from sins_env.cli.output import check_plot, save_figure
from sins_env.envs.base import EpisodeEnv
from sins_env.envs.environments import ENVIRONMENTS
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.show.footer import order
from sins_env.evaluation.tasks.catalogue import find, get_task
from sins_env.evaluation.tasks.fingerprint import digest
from sins_env.evaluation.tasks.task import EvaluationTask, suite_hash
from sins_env.reading.datasheets import told
from sins_env.reading.documents import YAML_ENDINGS
from sins_env.sensors import aids
from sins_env.sensors.gps import AGE, FIELDS, STD
from sins_env.specs import GPS_PRESETS, IMU_PRESETS, imu_spec
from sins_env.worlds.bridges import BRIDGED
from sins_env.worlds.profiles import PROFILES

#: Fields of an observation, with the shapes of one run, and their meaning.
OBSERVATION = {
    "t": ("(1,)", "s, end of the epoch"),
    "dtheta": ("(n_sub, 3)", "rad, gyro increments along the body's Right, Forward, Up"),
    "dvel": ("(n_sub, 3)", "m/s, accelerometer increments (specific force) along the same axes"),
    **{name: (f"{field.low.shape}", field.what) for name, field in {**FIELDS, **AGE, **STD, **BRIDGED}.items()},
}
ALIGNMENT = ("(4,)", "q_nb, scalar first, body to East, North, Up")
NAVIGATION = ("(10,)", "q_nb, v_n m/s East, North, Up, latitude rad, longitude rad, height m")


def describe(given: Namespace, console: Console) -> int:
    """Print everything of that name; a preset of both IMU and GPS is shown as both. Return the exit code.

    Raises:
        ValueError: an unknown name, or a figure that the thing does not have.
    """
    name, found = given.name, False
    if given.allan:
        _check_allan(name, given.allan)
    if given.plot:
        _check_flight(name, given.plot)
    if given.imu and not is_recording(name):
        raise ValueError(f"--imu for {name!r}; allowed: for a recording, whose first heading it judges")
    if given.yaml:
        print(as_yaml(name), end="")
        return 0
    if name == "scenario":
        describe_keys(console)
        found = True
    if is_scenario_file(name):
        found = _task(get_task(name), console)
    elif (task := find(name)) is not None:
        found = _task(task, console)
    if name in KINDS["environments"].names():
        found = _environment(name, console)
    for kind, presets in (("IMU", IMU_PRESETS), ("GPS", GPS_PRESETS)):
        if name in presets:
            found = _preset(kind, name, presets[name], console)
    if name in aids.known():
        found = _aid(aids.known()[name], console)
    if is_motion(name):
        found = describe_flight(name, console)
    if not found and is_recording(name):
        imu = None if given.imu is None else imu_spec(told(given.imu, IMU_PRESETS, "IMU preset"))
        found = describe_recording(name, console, imu)
    if not found and (
        ":" in name or name in finding.names()
    ):  # last: the names of other packages take a process to list
        found = _solver(name, console)
    if not found and Path(name).suffix.lower() in YAML_ENDINGS:
        raise FileNotFoundError(f"no file {name!r}; allowed: the path of a scenario or a flight")
    if not found:
        described = [kind for title, kind in KINDS.items() if title != "tables"]
        raise unknown("name", name, dict.fromkeys(found for kind in described for found in kind.names()))
    if given.allan:
        _allan(name, given.allan)
    if given.plot:
        draw_flight(name, given.plot)
    return 0


def _task(task: EvaluationTask, console: Console) -> bool:
    env = task.make(1)
    public = env.unwrapped.task  # type: ignore[attr-defined]
    env.close()
    table = layout.table(task.name, "", "")
    rows = {
        "what": task.what,
        "source": task.source,
        "environment": f"{task.env_id} {dict(task.kwargs)}",
        "aligned": f"{task.thresholds} until the end, for {task.hold_s:g} s or more",
        "scored": f"from {max(task.score_from_s, public.coarse_s):g} s on; order: {order(task)}"
        if public.navigate
        else "",
        "duration": f"{public.duration_s:g} s ({public.coarse_s:g} s coarse), {public.num_epochs} epochs",
        "runs": f"up to {task.max_runs}, the windows of the recording" if task.max_runs else "as many as asked for",
        "suite": f"seed {task.suite_seed}, hash {suite_hash(task)}",
        "digest": digest(task),
    }
    for name, text in filter(all, rows.items()):
        table.add_row(name, escape(text))
    console.print(table)
    _fields("told prior (1 sigma)", public.prior, console)
    return True


def _environment(env_id: str, console: Console) -> bool:
    cls = environments()[env_id]
    console.print(f"[bold]{env_id}[/]  {escape(layout.summary(cls.__doc__))}\n", highlight=False)
    for base in filter(dataclasses.is_dataclass, inspect.getmro(cls.settings)):
        for paragraph in inspect.cleandoc(base.__doc__ or "").split("\n\n"):
            if not paragraph.startswith("Raises"):
                console.print(escape(layout.prose(paragraph)) + "\n", highlight=False)
    table = layout.table("keyword arguments", "name", "default")
    for field in dataclasses.fields(cls.settings):
        table.add_row(field.name, escape(repr(field.default)))
    if env_id in ENVIRONMENTS:
        table.add_row("reveal_truth", "False")
        table.add_row("render_mode", "None")
    console.print(table)
    if env_id in ENVIRONMENTS:
        _estimates(cls, console)
    else:
        console.print("docs/learning.md#tuning has observation, action and reward.", highlight=False)
    console.print("num_envs environments, by gymnasium.make_vec, put an axis in front of all shapes.", highlight=False)
    return True


def _estimates(cls: type[EpisodeEnv], console: Console) -> None:
    """Print observation and action of an environment whose action is an estimate."""
    table = layout.table("observation of an epoch, and the action", "name", "shape", "what")
    for name, (shape, what) in OBSERVATION.items():
        table.add_row(name, shape, what)
    if "aids" in (field.name for field in dataclasses.fields(cls.settings)):
        table.add_row("<aid>", "by aid", "a reading of each sensor of aids, and <aid>_valid; see sins-env list aids")
    for navigates in cls.navigates:
        table.add_row("action", *(NAVIGATION if navigates else ALIGNMENT))
    console.print(table)


def _fields(title: str, spec: Any, console: Console) -> None:
    table = layout.table(title, "field", "value")
    for field in dataclasses.fields(spec):
        table.add_row(field.name, _plain(getattr(spec, field.name)))
    console.print(table)


def _plain(value: Any) -> str:
    if isinstance(value, tuple):
        return ", ".join(_plain(part) for part in value) or "none"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _preset(kind: str, name: str, spec: Any, console: Console) -> bool:
    _fields(f"{name}, {kind} preset", spec, console)
    return True


def _aid(sensor: type[aids.Sensor[Any]], console: Console) -> bool:
    console.print(
        f"[bold]{sensor.name}[/]  {escape(layout.prose(sensor.specification.__doc__ or ''))}", highlight=False
    )
    _fields("fields and defaults", sensor.specification(), console)
    if sensor.specification.presets:
        table = layout.table("presets", "name", "fields")
        for name, values in sensor.specification.presets.items():
            table.add_row(name, ", ".join(f"{field} {_plain(value)}" for field, value in values.items()) or "defaults")
        console.print(table)
    table = layout.table("observation", "name", "shape", "what")
    table.add_row(sensor.name, f"({sensor.size},)", sensor.what)
    table.add_row(f"{sensor.name}_valid", "(1,)", "1 with a reading at t, else 0")
    console.print(table)
    return True


def _solver(name: str, console: Console) -> bool:
    text, settings = finding.describe(name)
    console.print(f"[bold]{escape(name)}[/]  {escape(layout.prose(text) or 'no description')}", highlight=False)
    if settings:
        table = layout.table("settings", "name", "default")
        for setting, default in settings.items():
            table.add_row(setting, escape(default))
        console.print(table)
    return True


def _check_allan(name: str, path: str) -> None:
    check_plot(path, "--allan")
    if name not in IMU_PRESETS and not is_recording(name):
        allowed = f"an IMU preset ({', '.join(IMU_PRESETS)}) or a recording"
        raise ValueError(f"--allan for {name!r}; allowed: {allowed}")


def _check_flight(name: str, path: str) -> None:
    check_plot(path)
    if not is_motion(name):
        raise ValueError(
            f"--plot for {name!r}; allowed: a flight ({', '.join(PROFILES)}), a YAML or JSON file with one, or the table of a track"
        )


def _allan(name: str, path: str) -> None:
    """Draw the Allan deviation of an IMU preset or a recording."""
    with Bar("Allan deviation"):
        if name in IMU_PRESETS:
            figure = figures.allan_figure(IMU_PRESETS[name], name, np.random.default_rng(0))
        else:
            figure = figures.allan_figure(recordings.load(name), Path(name).stem)
    save_figure(figure, path)
