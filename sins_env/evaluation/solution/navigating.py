"""Navigation of a recording by a solver: from a file or a recording to a solution."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from sins_env.evaluation.estimators import finding
from sins_env.evaluation.replay import replaying
from sins_env.evaluation.solution.solution import Solution
from sins_env.recordings import Recording
from sins_env.specs import GpsSpec


def navigate(
    recording: str | Recording,
    solver: finding.Solver | None = None,
    imu: Any = None,
    gps: Any = None,
    aids: Any = None,
    smooth: bool = False,
    *,
    window: tuple[float, float] | None = None,
    outages_s: Sequence[tuple[float, float]] = (),
    settings: Mapping[str, Any] | None = None,
    seed: int = 0,
    epoch_timeout_s: float | None = None,
    progress: Callable[[float, float, str], None] | None = None,
    **env: Any,
) -> Solution:
    """Navigate a recording: attitude, velocity and position of the IMU with their sigmas, and what they say of themselves.

    Args:
        recording: path of a recording or of its mapping, or a recording.
        solver: a name, ``module:Factory``, or a class or function; None is the recommended one.
        imu: assumed errors of the IMU, a preset's name or a dict of fields; None leaves the default of ``SINS/Replay-v0``.
        gps: assumed errors of the fixes, likewise.
        aids: further sensors of the recording by name, each with a preset or a dict of fields.
        smooth: whether the states are from all fixes. The solver must have a smoother, as those around a Gaussian filter do.
        window: start and length, s on the recording's clock; None takes all of it.
        outages_s: spans (start, end), s of the window, whose fixes are withheld; the solution is then held against them.
        settings: settings of the solver. Those of the recommended one for recordings (``solvers.zoo.RECORDED``) are beside them.
        seed: seed of a solver that draws.
        epoch_timeout_s: longest time of one call of the solver, s, as in ``evaluate``.
        progress: function called with the seconds done, their total, and a note.
        env: further keyword arguments of ``SINS/Replay-v0``, such as ``epoch``, ``coarse``, ``accept``, or ``mode="align"``,
            which asks for the attitude alone.

    Raises:
        ValueError, FileNotFoundError: names, windows or settings that do not fit, or a solver that has no smoother.
        EstimatorError: the solver raised, gave up, or returned what is no estimate.
    """
    chosen = finding.recommended() if solver is None else solver
    given = {"mode": "navigate", **told(imu, gps, aids, outages_s), **env}
    if chosen == finding.recommended():
        given.setdefault("coarse", 0.0)  # it aligns from the first fix on, at rest or in motion
        settings = {**finding.recorded(), **(settings or {})}
    one = replaying.replay(
        recording,
        chosen,
        [] if window is None else [window],
        settings=settings,
        env=given,
        seed=seed,
        epoch_timeout_s=epoch_timeout_s,
        progress=progress,
        smooth=smooth,
    )
    return Solution.of(one, smoothed=smooth)


def told(imu: Any, gps: Any, aids: Any, outages_s: Sequence[tuple[float, float]]) -> dict[str, Any]:
    """Return keyword arguments of ``SINS/Replay-v0`` for what a solver is told; what is None is left out."""
    found = {name: value for name, value in (("imu", imu), ("gps", gps), ("aids", aids)) if value is not None}
    if outages_s:
        spans = [list(span) for span in outages_s]
        if isinstance(gps, GpsSpec):
            found["gps"] = replace(gps, outages_s=tuple((start, end) for start, end in spans))
        else:
            fields = {"preset": gps} if isinstance(gps, str) else dict(gps or {})
            found["gps"] = {**fields, "outages_s": spans}
    return found
