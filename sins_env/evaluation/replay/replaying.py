"""Replay of one solver on windows of any recording: heading, pitch, roll, and their scatter over the windows.

If the recording has a reference, the scatter is that of the errors against it. Without one it is that of the angles, which
is meaningful if the base stands still. A solver that navigates has velocity and position, too
(:mod:`sins_env.evaluation.replay.track`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import gymnasium
import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array
from sins_env.envs.reward import score_navigation
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.guard import Guard, Guarded
from sins_env.evaluation.estimators.isolation import hosted
from sins_env.evaluation.play.loop import Loop
from sins_env.evaluation.replay.told import SIGMA, Told
from sins_env.evaluation.replay.track import Track
from sins_env.evaluation.tasks.task import is_scored
from sins_env.recordings import Recording, heading_pitch_roll
from sins_env.states import FIX
from sins_env.types import NavState, Task

ANGLES = ("heading", "pitch", "roll")


@dataclass(frozen=True, repr=False)
class Replay:
    """A solver on W windows of one length. Angles are heading in [0, 2 pi), pitch, roll, rad; NaN in failed epochs."""

    recording: str
    solver: str
    starts: Array  #: (W,) start of each window, s on the recording's clock
    t: Array  #: (K,) time of each epoch, s from the start of the window
    coarse_s: float
    angles: Array  #: (W, K, 3) estimated angles
    reference: Array | None  #: (W, K, 3) angles of the reference; None without one
    failed: tuple[str, ...]  #: (W,) reason why a window failed; empty if it did not
    track: Track | None = None  #: velocity and position; None in alignment
    told: Told | None = None  #: what the solver tells of itself
    source: Recording | None = None
    #: What :func:`sins_env.evaluation.replay.consistency.judge` has found of windows so far.
    judged: dict[int, Any] = field(default_factory=dict, init=False, compare=False)

    @property
    def zero_velocity(self) -> bool:
        """Whether zero-velocity updates stand in for fixes."""
        return self.source is not None and self.source.gnss is None

    @property
    def scatter(self) -> Array:
        """Errors against the reference, or without one differences from the mean over the windows, (W, K, 3) rad."""
        if self.reference is not None:
            return attitude.wrap(self.angles - self.reference)
        good = self.angles[[not why for why in self.failed]]
        return attitude.wrap(self.angles - mean_angle(good if len(good) else self.angles))

    @property
    def spread(self) -> Array:
        """Standard deviation over the windows that did not fail, (K, 3) rad; NaN for fewer than two."""
        good = self.scatter[[not why for why in self.failed]]
        return good.std(axis=0, ddof=1) if len(good) > 1 else np.full(self.angles.shape[1:], np.nan)

    def __repr__(self) -> str:
        failed = sum(map(bool, self.failed))
        windows = f"{len(self.starts)} windows of {self.t[-1]:g} s{f', {failed} failed' if failed else ''}"
        return f"<Replay of {self.solver} on {self.recording}: {windows}>"


def mean_angle(angles: Array) -> Array:
    """Return the mean angle over the first axis, on the circle, rad."""
    return np.arctan2(np.sin(angles).mean(axis=0), np.cos(angles).mean(axis=0))


def replay(
    recording: str | Recording,
    solver: finding.Solver,
    windows: Sequence[tuple[float, float]] = (),
    stride: float | None = None,
    *,
    settings: Mapping[str, Any] | None = None,
    env: Mapping[str, Any] | None = None,
    seed: int = 0,
    epoch_timeout_s: float | None = None,
    progress: Callable[[float, float, str], None] | None = None,
    smooth: bool = False,
) -> Replay:
    """Play a solver on windows of a recording.

    Args:
        recording: path of the recording, or of its mapping; or a recording.
        solver: a name, ``module:Factory``, or a class or function.
        windows: pairs (start, length) in s, all of one length; none is one window over the whole recording.
        stride: step in s from one window to the next; a single window is then repeated as often as fits.
        settings: settings of the solver.
        env: further keyword arguments of ``SINS/Replay-v0``.
        seed: seed of the solver's random numbers.
        epoch_timeout_s: longest time of one call of the solver, s, as in ``evaluate``.
        progress: function called with the seconds done, their total, and a note.
        smooth: whether the states are those of the solver's smoother, from all fixes of a window.

    Raises:
        ValueError, FileNotFoundError: names, windows or settings that do not fit, or a solver that has no smoother.
        EstimatorError: the solver raised, took too long or ended its process.
    """
    if len({length for _, length in windows}) > 1:
        raise ValueError(f"windows of {len(windows)} lengths; allowed: one length for all")
    if stride is not None and len(windows) != 1:
        raise ValueError(f"stride with {len(windows)} windows; allowed: a single window, (start, length)")
    parts = [{"window": list(window)} for window in windows] or [{}]
    played, done = [], 0.0
    with hosted(solver, settings, epoch_timeout_s) as host:
        made = [one for part in parts for one in _make(recording, {**part, **(env or {})}, stride, host.batched)]
        public = made[0].unwrapped.task
        total = public.duration_s * sum(one.num_envs for one in made)
        for one in made:

            def report(part: float, note: str, before: float = done) -> None:
                if progress:
                    progress(before + part, total, note)

            host.renew()
            if smooth:
                guard = host.smoother(one.num_envs)
                played.append(_smoothed(_play(one, guard, seed, report), guard, public))
            else:
                played.append(_play(one, host.guard(one.num_envs), seed, report))
            done += public.duration_s * one.num_envs
            one.close()
    actions, fixes, errors, truth = (np.concatenate(part) for part in list(zip(*played, strict=True))[:4])
    world = made[0].unwrapped.episode.world
    starts = np.concatenate([one.unwrapped.episode.world.windows.starts for one in made])
    t = (1 + np.arange(public.num_epochs)) * public.epoch_s
    fine = t > public.coarse_s + 1e-9
    states = (actions[..., :4], actions[..., 7:], fixes, errors[..., FIX["dv"]], errors[..., FIX["dp"]])
    more = (actions[..., 4:7], tuple(world.gps.outages_s), public.gps)
    return Replay(
        world.recording.name,
        finding.solver_name(solver),
        starts,
        t,
        public.coarse_s,
        _angles(actions[..., :4]),
        _angles(truth[..., :4]) if world.recording.reference is not None else None,
        tuple(why for part in played for why in part.failed),
        Track(world.recording, starts, t, fine, *states, *more) if public.navigate else None,
        Told.joined([part.told for part in played]),
        world.recording,
    )


def _make(recording: str | Recording, settings: Mapping[str, Any], stride: float | None, batched: bool) -> list[Any]:
    """Make one vector environment of all windows, or for a solver that is not batched one of each."""

    def make(count: int, **more: Any) -> Any:
        return gymnasium.make_vec("SINS/Replay-v0", num_envs=count, recording=recording, **{**settings, **more})

    env = make(1, **({} if stride is None else {"stride": stride}))
    world, scored = env.unwrapped.episode.world, is_scored(env)
    starts, length = world.windows.starts, env.unwrapped.task.duration_s
    env.close()
    if batched or len(starts) == 1:
        return [make(len(starts), reveal_truth=scored, **({} if stride is None else {"stride": stride}))]
    return [make(1, reveal_truth=scored, window=[float(start), length]) for start in starts]


class _Played(NamedTuple):
    """What the windows of an environment gave. Unknown values are NaN."""

    actions: Array  #: (W, K, 4) or (W, K, 10)
    fixes: Array  #: (W, K, 3), positions of the fixes
    errors: Array  #: (W, K, 6), errors of velocity and position
    truth: Array  #: (W, K, 10), attitude, velocity and position of the reference
    failed: list[str]  #: reason why each window failed; empty if it did not
    told: Told


def _play(env: Any, guard: Guarded, seed: int, report: Callable[[float, str], None]) -> _Played:
    """Play the windows of an environment."""
    count, task, scored = env.num_envs, env.unwrapped.task, is_scored(env)
    obs, _ = env.reset(seed=seed, options={"window": list(range(count))})
    rngs = [np.random.default_rng([seed, row]) for row in range(count)]
    loop, told = Loop(env, guard, obs, rngs), Told(count, task.num_epochs, task.navigate)
    actions = np.empty((count, task.num_epochs, env.single_action_space.shape[0]))
    fixes, errors, truth = (np.full((count, task.num_epochs, n), np.nan) for n in (3, 6, 10))
    bad = np.zeros(count, dtype=np.int64)
    while loop.left:
        k = loop.k
        fixes[:, k] = np.where(loop.obs["gps_valid"] == 1, loop.obs["gps_pos"], np.nan)
        _, actions[:, k], info, _, _ = next(loop)
        told.ask(k, guard)
        bad += info["failed"]
        if scored:
            truth[:, k] = np.concatenate([info["truth"][name] for name in NavState._fields], axis=1)
        if scored and task.navigate:
            errors[:, k] = np.concatenate([info["errors"]["vel"], info["errors"]["pos"]], axis=1)
        if k % 10 == 9:
            heading = np.degrees(_angles(actions[0, k, :4])[0])
            report((k + 1) * task.epoch_s * count, f"heading {heading:8.3f} deg" if np.isfinite(heading) else "")
    _, _, frozen = loop.guard.health()
    why = [
        f"{bad[i]} failed epochs"
        if bad[i]
        else f"gave up at {frozen[i] * task.epoch_s:.1f} s"
        if frozen[i] >= 0
        else ""
        for i in range(count)
    ]
    return _Played(actions, fixes, errors, truth, why, told)


def _smoothed(played: _Played, guard: Guard, task: Task) -> _Played:
    """Return the windows with the smoothed states in place of the filter's; epochs before them are NaN."""
    track, told = guard.smoothed(), played.told
    first = task.num_epochs - len(track.t)
    actions, errors = np.full_like(played.actions, np.nan), np.full_like(played.errors, np.nan)
    states = track.nav if task.navigate else track.nav[:1]
    actions[:, first:] = np.moveaxis(np.concatenate(states, axis=-1), 0, 1)
    places = track.states.places(told.layout)
    told.cov[:] = np.nan
    told.cov[:, first:] = np.moveaxis(track.cov, 0, 1)[..., places[:, None], places]
    std = np.sqrt(np.diagonal(np.moveaxis(track.cov, 0, 1), axis1=-2, axis2=-1))
    for name in told.constants:  # parameters of aids are not smoothed
        told.values[name][:] = told.values[f"{name}{SIGMA}"][:] = np.nan
        if (value := getattr(track, name, None)) is not None:
            told.put(name, slice(first, None), np.moveaxis(value, 0, 1))
            told.put(f"{name}{SIGMA}", slice(first, None), std[..., track.states[name]])
    if task.navigate and np.isfinite(played.truth).any():
        rows = actions[:, first:].reshape(-1, 10)
        truth = played.truth[:, first:].reshape(-1, 10)
        found, _, _ = score_navigation(rows, NavState(*np.split(truth, [4, 7], axis=1)), earth.get(task.site.earth))
        errors[:, first:] = np.concatenate([found["vel"], found["pos"]], axis=1).reshape(errors[:, first:].shape)
    return played._replace(actions=actions, errors=errors)


def _angles(q: Array) -> Array:
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = attitude.normalize(q)
    lost = ~np.isfinite(unit).all(axis=-1, keepdims=True)
    return np.where(lost, np.nan, heading_pitch_roll(np.where(lost, 0.5, unit)))
