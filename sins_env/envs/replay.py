"""``SINS/Replay-v0``: a real recording, delivered epoch by epoch like a simulation.

A window of the recording is one episode, whose time begins at 0. With a ``stride`` there are as many windows
as fit, window i beginning ``i * stride`` seconds after the first. ``reset(options={"window": i})`` picks one;
without it each run's seed draws one. In the vector environment the option is a list with one index per row,
or one index for the first row, the others following on.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, recordings
from sins_env.envs.align import AlignEnv, AlignVectorEnv
from sins_env.envs.settings import STARTS, check_misalignment, check_number
from sins_env.envs.windows import Windows
from sins_env.envs.world import ChunkedWorld, World, told_start
from sins_env.errors import build, unknown
from sins_env.gps import epochs_per_fix
from sins_env.imu import standard_normal
from sins_env.specs import (
    COARSE_STD_DEG,
    GPS_PRESETS,
    PRIORS,
    TOLD_START_STD_DEG,
    GpsSpec,
    gps_spec,
    imu_spec,
)
from sins_env.types import NavState, Task

Array = NDArray[np.float64]

MODES = ("align",)
#: A parked base is known to stand still within its disturbances, at a surveyed place.
ZERO_VELOCITY = GpsSpec(vel_std_mps=0.03, pos_std_m=1.0)


@dataclass(frozen=True)
class ReplaySettings:
    """Settings of ``SINS/Replay-v0``; JSON-able values only.

    ``recording``: a path, sought as given and then in $SINS_ENV_DATA. ``window``: (start, length) in s on the
    recording's clock, None for all of it; it begins at the sample edge nearest to ``start``. ``stride``: s.
    ``n_sub`` None is what epoch and sample rate give. ``coarse`` None is 90 s, or 0 for a told start.

    ``imu`` and ``gps`` are what the estimators are told: a preset's name or a dict of fields. Rate and lever
    arm are the recording's own. Without GNSS the fix is a zero-velocity update at the known site, by default
    0.03 m/s at every epoch (a dict's ``rate_hz`` thins it). ``start="told"`` needs a reference;
    ``misalignment_deg`` is that of AlignSettings.

    Raises:
        ValueError: any value out of its range.
    """

    recording: str = ""
    window: tuple[float, float] | None = None
    stride: float | None = None
    epoch: float = 0.1
    n_sub: int | None = None
    coarse: float | None = None
    imu: Any = "rlg-car"
    gps: Any = None
    start: str = "unknown"
    misalignment_deg: tuple[float, ...] | None = None
    prior: str = "matched"
    mode: str = "align"

    def __post_init__(self) -> None:
        choices = (("start", self.start, STARTS), ("prior", self.prior, PRIORS), ("mode", self.mode, MODES))
        for kind, given, allowed in choices:
            if given not in allowed:
                raise unknown(kind, given, allowed)
        for name in ("epoch", "n_sub", "coarse", "stride"):
            if getattr(self, name) is not None:
                check_number(name, getattr(self, name))
        if not self.recording:
            raise ValueError("recording is missing; allowed: the path of an NPZ recording")
        set_ = object.__setattr__
        if self.coarse is None:
            set_(self, "coarse", 0.0 if self.start == "told" else 90.0)
        if self.start == "told" and self.coarse:
            raise ValueError(f"coarse = {self.coarse!r} with start = 'told'; allowed: 0")
        set_(self, "misalignment_deg", check_misalignment(self.misalignment_deg, self.start))
        if self.window is not None:
            values = np.asarray(self.window)
            if values.shape != (2,) or values.dtype.kind not in "iuf" or not np.isfinite(values).all():
                raise ValueError(f"window = {self.window!r}; allowed: (start, length) in seconds, or None")
            set_(self, "window", (float(values[0]), float(values[1])))
        if self.stride is not None and not (math.isfinite(self.stride) and self.stride > 0):
            raise ValueError(f"stride = {self.stride!r}; allowed: a positive number of seconds, or None")

    def samples_per_epoch(self, rate_hz: float) -> int:
        """n_sub at this sample rate.

        Raises:
            ValueError: epochs that are not whole samples, an ``n_sub`` that does not fit; with one that does.
        """
        if not (math.isfinite(self.epoch) and self.epoch > 0):
            raise ValueError(f"epoch = {self.epoch!r}; allowed: a positive number of seconds")
        samples = self.epoch * rate_hz
        whole = max(round(samples), 1)
        if abs(samples - whole) > 1e-6:
            raise ValueError(
                f"epoch = {self.epoch:g} s is {samples:g} samples of {rate_hz:g} Hz; allowed: whole samples, "
                f"for instance {whole / rate_hz:g} s"
            )
        if self.n_sub is not None and self.n_sub != whole:
            fitting = f"{whole} for epochs of {self.epoch:g} s at {rate_hz:g} Hz"
            raise ValueError(f"n_sub = {self.n_sub!r}; allowed: {fitting}, or None")
        return whole

    def told_gps(self, recording: recordings.Recording) -> GpsSpec:
        """What the estimators are told of the fixes.

        Raises:
            ValueError: a setting that only a simulation can grant, or a rate that is not the recording's.
        """
        gnss = recording.gnss
        if gnss is None:
            base = replace(ZERO_VELOCITY, rate_hz=1.0 / self.epoch)
        else:
            lever = np.zeros(3) if recording.lever_arm is None else recording.lever_arm
            rate = 1.0 / float(np.median(np.diff(gnss.t_s))) if len(gnss.t_s) > 1 else 1.0
            base = replace(GPS_PRESETS["dgps"], rate_hz=rate, lever_arm_m=tuple(map(float, lever)))
        if self.gps is None:
            return base
        if isinstance(self.gps, dict) and "preset" not in self.gps:
            spec = build(GpsSpec, {**asdict(base), **self.gps}, "GpsSpec")
        else:
            spec = replace(gps_spec(self.gps), rate_hz=base.rate_hz, lever_arm_m=base.lever_arm_m)
        if spec.outages_s or spec.jump_mps:
            raise ValueError(
                "outages_s or jump_mps in a replay; allowed: in a simulation only, the fixes here are real"
            )
        if gnss is not None and not math.isclose(spec.rate_hz, base.rate_hz):
            raise ValueError(f"GpsSpec.rate_hz = {spec.rate_hz:g}; allowed: {base.rate_hz:g}, the recording's own")
        return spec


class ReplayWorld(ChunkedWorld):
    """Windows of one recording; all runs share it."""

    def __init__(self, settings: ReplaySettings) -> None:
        self.settings = settings
        self.recording = recordings.load(settings.recording)
        self.scored = self.recording.reference is not None
        if settings.start == "told" and not self.scored:
            raise ValueError("start = 'told'; allowed: 'unknown', the recording has no reference to start from")
        self.n_sub = settings.samples_per_epoch(self.recording.rate_hz)
        told, coarse = settings.start == "told", settings.coarse or 0.0
        self.windows = Windows(
            self.recording, settings.epoch, self.n_sub, coarse, settings.window, settings.stride, told
        )
        gps, imu = settings.told_gps(self.recording), imu_spec(settings.imu)
        self._every = epochs_per_fix(gps, settings.epoch) if self.recording.gnss is None else 1
        spread = TOLD_START_STD_DEG if told else COARSE_STD_DEG
        prior = PRIORS[settings.prior](imu, gps, settings.epoch, spread)
        self.task = Task(
            id="SINS/Replay-v0",
            site=self.recording.site,
            epoch_s=settings.epoch,
            n_sub=self.n_sub,
            duration_s=self.windows.num_epochs * settings.epoch,
            coarse_s=coarse,
            imu=imu,
            gps=gps.told(prior.gps_vel_std_mps if settings.prior == "thesis" else None),
            prior=prior,
        )

    def reset(self, rngs: Sequence[np.random.Generator], options: dict[str, Any]) -> tuple[NavState, NavState | None]:
        for key in options:
            if key != "window":
                raise unknown("reset option", key, ("window",))
        streams = [rng.spawn(2) for rng in rngs]  # window, start
        self._first_samples = self.windows.first_samples[self._pick(options.get("window"), [s[0] for s in streams])]
        self._rewind()
        truth = NavState(*(part[:, 0] for part in self._truth(self._times(0, 1))))
        if self.settings.start == "unknown":
            return truth, None
        draws = standard_normal([s[1] for s in streams], (6,))
        return truth, told_start(self.task, self.settings.misalignment_deg, truth, draws, truth.pos)

    def _pick(self, given: Any, rngs: Sequence[np.random.Generator]) -> NDArray[np.int64]:
        count = len(self.windows.first_samples)
        if given is None:
            return np.array([rng.integers(count) for rng in rngs])
        index = np.asarray(given)
        if index.shape not in ((), (len(rngs),)) or index.dtype.kind not in "iu":
            raise ValueError(f"window = {given!r}; allowed: one whole number, or a list of {len(rngs)}")
        index = index + np.arange(len(rngs)) if index.ndim == 0 else index
        if index.min() < 0 or index.max() >= count:
            bad = int(index[(index < 0) | (index >= count)][0])
            raise ValueError(f"window {bad} does not exist; allowed: 0 to {count - 1}, for {len(rngs)} runs one each")
        return index

    def _times(self, first: int, count: int) -> Array:
        """Ends of epochs first ... first + count - 1 on the clock of the recording, (runs, count)."""
        samples = self._first_samples[:, None] + np.arange(first, first + count) * self.n_sub
        return self.recording.t0 + samples / self.recording.rate_hz

    def _chunk(self, first: int, count: int) -> tuple[tuple[Any, ...], NavState]:
        rows = (self._first_samples + first * self.n_sub)[:, None] + np.arange(count * self.n_sub)
        shape = (len(rows), count, self.n_sub, 3)
        increments = (self.recording.dtheta[rows].reshape(shape), self.recording.dvel[rows].reshape(shape))
        times = self._times(first + 1, count)
        return (*increments, *self._fixes(times, np.arange(first + 1, first + count + 1))), self._truth(times)

    def _fixes(self, times: Array, number: NDArray[np.int64]) -> tuple[Array, Array, NDArray[np.int8]]:
        gnss = self.recording.gnss
        if gnss is None:
            valid = np.broadcast_to((number % self._every == 0)[:, None], (*times.shape, 1))
            return np.zeros((*times.shape, 3)), valid * self.task.site.pos, valid.astype(np.int8)
        half = self.windows.half_sample
        i = np.minimum(np.searchsorted(gnss.t_s, times - half), len(gnss.t_s) - 1)
        valid = (np.abs(gnss.t_s[i] - times) <= half)[..., None]
        return gnss.vel[i] * valid, gnss.pos[i] * valid, valid.astype(np.int8)

    def _truth(self, times: Array) -> NavState:
        """The reference at ``times``: exact where a stamp is within half a sample, else interpolated."""
        ref = self.recording.reference
        still, place = np.zeros((*times.shape, 3)), np.broadcast_to(self.task.site.pos, (*times.shape, 3))
        if ref is None:
            return NavState(np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*times.shape, 4)), still, place)
        i = np.clip(np.searchsorted(ref.t_s, times), 1, len(ref.t_s) - 1)
        before, after = ref.t_s[i - 1], ref.t_s[i]
        half = self.windows.half_sample
        w = np.clip((times - before) / (after - before), 0.0, 1.0)
        w = np.where(np.abs(times - before) <= half, 0.0, np.where(np.abs(times - after) <= half, 1.0, w))

        def between(values: Array) -> Array:
            return (1.0 - w[..., None]) * values[i - 1] + w[..., None] * values[i]

        return NavState(
            attitude.slerp(ref.q_nb[i - 1], ref.q_nb[i], w),
            still if ref.vel is None else between(ref.vel),
            place if ref.pos is None else between(ref.pos),
        )


def _replay(**settings: Any) -> World:
    return ReplayWorld(build(ReplaySettings, settings, "SINS/Replay-v0"))


class ReplayEnv(AlignEnv):
    """``SINS/Replay-v0``: see :class:`ReplaySettings`."""

    world = staticmethod(_replay)


class ReplayVectorEnv(AlignVectorEnv):
    world = staticmethod(_replay)
