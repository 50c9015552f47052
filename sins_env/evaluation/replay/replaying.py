"""``replay``: one solver on windows of any recording; heading, pitch, roll, and how far they scatter over the windows; where it
navigates, velocity and position too (:mod:`sins_env.evaluation.replay.track`).

Where the recording has a reference the scatter is that of the errors against it, else that of the angles themselves,
which says something of a base that stands.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from sins_env import attitude
from sins_env.arrays import Array
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.isolation import Host, hosted
from sins_env.evaluation.play.loop import Loop
from sins_env.evaluation.replay.track import Track
from sins_env.evaluation.tasks.task import is_scored
from sins_env.recordings import heading_pitch_roll

ANGLES = ("heading", "pitch", "roll")


@dataclass(frozen=True, repr=False)
class Replay:
    """Windows of one length on one recording. Angles in rad: heading in [0, 2 pi), pitch, roll; NaN where it failed."""

    recording: str
    solver: str
    starts: Array  #: (W,) s on the recording's clock
    t: Array  #: (K,) s in the window
    coarse_s: float
    angles: Array  #: (W, K, 3)
    reference: Array | None  #: (W, K, 3)
    failed: tuple[str, ...]  #: (W,) why a window failed; empty where it did not
    track: Track | None = None  #: None in alignment

    @property
    def scatter(self) -> Array:
        """(W, K, 3) rad: errors against the reference, or else differences from the mean over the windows."""
        if self.reference is not None:
            return attitude.wrap(self.angles - self.reference)
        good = self.angles[[not why for why in self.failed]]
        return attitude.wrap(self.angles - mean_angle(good if len(good) else self.angles))

    @property
    def spread(self) -> Array:
        """(K, 3) rad, standard deviation over the windows that did not fail; NaN for fewer than two."""
        good = self.scatter[[not why for why in self.failed]]
        return good.std(axis=0, ddof=1) if len(good) > 1 else np.full(self.angles.shape[1:], np.nan)

    def __repr__(self) -> str:
        failed = sum(map(bool, self.failed))
        windows = f"{len(self.starts)} windows of {self.t[-1]:g} s{f', {failed} failed' if failed else ''}"
        return f"<Replay of {self.solver} on {self.recording}: {windows}>"


def mean_angle(angles: Array) -> Array:
    """Over the first axis, on the circle."""
    return np.arctan2(np.sin(angles).mean(axis=0), np.cos(angles).mean(axis=0))


def replay(
    recording: str,
    solver: finding.Solver,
    windows: Sequence[tuple[float, float]] = (),
    stride: float | None = None,
    *,
    settings: Mapping[str, Any] | None = None,
    env: Mapping[str, Any] | None = None,
    seed: int = 0,
    epoch_timeout_s: float | None = None,
    progress: Callable[[float, float, str], None] | None = None,
) -> Replay:
    """Play a solver on windows of a recording.

    Args:
        windows: (start, length) s each, all of one length; none is one window over all of the recording.
        stride: s, for a single window: as many as fit, each so much later.
        settings: of the solver.
        env: further keyword arguments of ``SINS/Replay-v0``.
        epoch_timeout_s: s that one call of the solver may take; it then has a process of its own, as it has at infinity.
        progress: called with seconds done, seconds in all, and a note.

    Raises:
        ValueError, FileNotFoundError: names, windows or settings that do not fit.
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
            played.append(_play(one, host, seed, report))
            done += public.duration_s * one.num_envs
            one.close()
    actions, fixes, errors, truth = (np.concatenate([part[i] for part in played]) for i in range(4))
    recording_ = made[0].unwrapped.episode.world.recording
    starts = np.concatenate([one.unwrapped.episode.world.windows.starts for one in made])
    t = (1 + np.arange(public.num_epochs)) * public.epoch_s
    fine = t > public.coarse_s + 1e-9
    states = (actions[..., :4], actions[..., 7:], fixes, errors[..., :3], errors[..., 3:])
    return Replay(
        recording_.name,
        finding.solver_name(solver),
        starts,
        t,
        public.coarse_s,
        _angles(actions[..., :4]),
        _angles(truth) if recording_.reference is not None else None,
        tuple(why for part in played for why in part[4]),
        Track(recording_, starts, t, fine, *states) if public.navigate else None,
    )


def _make(recording: str, settings: Mapping[str, Any], stride: float | None, batched: bool) -> list[Any]:
    """The vector environment of as many windows as there are; for a solver of single runs one for each."""

    def make(count: int, **more: Any) -> Any:
        return gymnasium.make_vec("SINS/Replay-v0", num_envs=count, recording=recording, **{**settings, **more})

    env = make(1, **({} if stride is None else {"stride": stride}))
    world, scored = env.unwrapped.episode.world, is_scored(env)
    starts, length = world.windows.starts, env.unwrapped.task.duration_s
    env.close()
    if batched or len(starts) == 1:
        return [make(len(starts), reveal_truth=scored, **({} if stride is None else {"stride": stride}))]
    return [make(1, reveal_truth=scored, window=[float(start), length]) for start in starts]


def _play(
    env: Any, host: Host, seed: int, report: Callable[[float, str], None]
) -> tuple[Array, Array, Array, Array, list[str]]:
    """Actions (W, K, 4 or 10), and NaN where there are none: positions of the fixes (W, K, 3), errors of velocity and position
    (W, K, 6), attitudes of the reference (W, K, 4); and why each window failed."""
    count, task, scored = env.num_envs, env.unwrapped.task, is_scored(env)
    obs, _ = env.reset(seed=seed, options={"window": list(range(count))})
    rngs = [np.random.default_rng([seed, row]) for row in range(count)]
    loop = Loop(env, host.guard(count), obs, rngs)
    actions = np.empty((count, task.num_epochs, env.single_action_space.shape[0]))
    fixes, errors, truth = (np.full((count, task.num_epochs, n), np.nan) for n in (3, 6, 4))
    bad = np.zeros(count, dtype=np.int64)
    while loop.left:
        k = loop.k
        fixes[:, k] = np.where(loop.obs["gps_valid"] == 1, loop.obs["gps_pos"], np.nan)
        _, actions[:, k], info, _, _ = next(loop)
        bad += info["failed"]
        if scored:
            truth[:, k] = info["truth"]["q_nb"]
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
    return actions, fixes, errors, truth, why


def _angles(q: Array) -> Array:
    with np.errstate(invalid="ignore", divide="ignore"):
        unit = attitude.normalize(q)
    lost = ~np.isfinite(unit).all(axis=-1, keepdims=True)
    return np.where(lost, np.nan, heading_pitch_roll(np.where(lost, 0.5, unit)))
