"""The verbs ``convert`` and ``replay``: a recording in another format, and a solver on a recording."""

from __future__ import annotations

import sys
from argparse import Namespace
from pathlib import Path

from rich.console import Console

from sins_env import recordings
from sins_env.cli.failing import failing
from sins_env.cli.output import RunFailed, check_plot, remark, save_figure
from sins_env.cli.verbs.sensors import sensor_settings
from sins_env.cli.verbs.solutions import written
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.replay import consistency, replaying, tables
from sins_env.evaluation.replay.angles_figure import replay_figure
from sins_env.evaluation.replay.track_figure import track_figure
from sins_env.evaluation.solution import files
from sins_env.evaluation.solution.solution import Solution
from sins_env.reading.files import following
from sins_env.specs import imu_spec
from sins_env.worlds.replay_settings import ReplaySettings


def convert(given: Namespace, console: Console) -> int:
    """Convert a recording; print the files written, gaps, and parts that the format has no place for."""
    target = Path(given.target)
    kind = given.to or recordings.format_of(target, writes=True)
    with Bar(f"{given.source} to {given.target}", total=1.0) as bar, following(bar.update):
        recording = recordings.load(
            given.source,
            format=given.format,
            mapping=given.mapping,
            axes=given.axes,
            resample_hz=given.resample,
            drop_duplicates=given.drop_duplicates or None,
            velocity_from_positions=given.velocity_from_positions or None,
            bridge_s=0.0,
            accept=given.accept or None,
        )
        written = recordings.save(recording, target, format=kind, overwrite=given.force)
    for path in written:
        print(path)
    sys.stdout.flush()
    for gap in recording.gaps:
        remark(f"missing: {gap}")
    left = recordings.left_out(recording, kind)
    if left:
        remark(f"{kind} has no place for: {', '.join(left)}")
    return 0


def replay(given: Namespace, console: Console) -> int:
    """Run a solver on windows of a recording, print the table, and draw the figure.

    Raises:
        RunFailed: the estimator failed in a window.
    """
    check_plot(given.plot)
    for path in given.out:
        files.check(path, given.frame)
    if given.out and (given.stride is not None or len(given.window) > 1):
        raise ValueError("--out of several windows; allowed: a single window, --window START LENGTH without --stride")
    settings = {
        name: value for name in ("coarse", "epoch", "bridge", "mode") if (value := getattr(given, name)) is not None
    } | sensor_settings(given)
    if given.accept:
        settings["accept"] = tuple(given.accept)
    what = f"{given.solver} on {given.recording}"
    with failing(what), Bar(what) as bar:
        one = replaying.replay(
            given.recording,
            given.solver,
            [tuple(window) for window in given.window],
            given.stride,
            settings=dict(given.set),
            env=settings,
            seed=given.seed,
            epoch_timeout_s=given.timeout,
            progress=bar.update,
        )
    recording = recordings.load(given.recording, accept=given.accept or None, bridge_s=given.bridge)
    for found in recordings.findings(recording):
        remark(f"warning: {found}")
    north = recordings.north(recording, imu_spec(settings.get("imu", ReplaySettings.imu)))
    if not north.found:
        remark(f"no first heading: {north}")
    for line in consistency.lines(one):
        remark(f"warning: {line}")
    console.print(tables.table(one))
    if one.track is not None:
        console.print(tables.track_table(one, tables.MOST_ROWS))
    if given.plot:
        save_figure(replay_figure(one) if one.track is None else track_figure(one), given.plot)
    for start, why in zip(one.starts, one.failed, strict=True):
        if why:
            raise RunFailed(f"{given.solver} on {one.recording}, window from {recordings.seconds(start)} s: {why}")
    if given.out:
        written(Solution.of(one), given)
    return 0
