"""The world of ``SINS/Replay-v0``: a real recording, delivered epoch by epoch like a simulation.

A window of the recording is one episode, whose time begins at 0. With a ``stride`` there are as many windows as fit;
window i begins ``i * stride`` seconds after the first. ``reset(options={"window": i})`` picks a window; without this
option the seed of a run draws one. In the vector environment ``i`` is a list with an index for each row, or the index of
the first row, which the others follow.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env import recordings
from sins_env.arrays import Array, Mask, Obs, Rngs
from sins_env.prior import PRIORS, TOLD_START_STD_DEG
from sins_env.recordings import Recording
from sins_env.sensors.gps import AGE, FIELDS, STD, epochs_per_fix, in_fields, received, zero_velocity_fixes
from sins_env.sensors.imu import standard_normal
from sins_env.specs import imu_spec
from sins_env.types import NavState, Task
from sins_env.worlds.bridges import BRIDGED, Bridges
from sins_env.worlds.recorded_aids import RecordedAid, specs_of
from sins_env.worlds.replay_settings import ReplaySettings
from sins_env.worlds.settings import unknown_spread
from sins_env.worlds.windows import ON_TIME_S, Windows
from sins_env.worlds.world import ChunkedWorld, pick_rows, picked, told_start


class ReplayWorld(ChunkedWorld):
    """Windows of one recording, which all runs share.

    Raises:
        ValueError: a recording without what the settings need, or a window that does not fit it.
        FileNotFoundError: no such recording.
    """

    def __init__(self, env_id: str, settings: ReplaySettings) -> None:
        given, bridge = settings.recording, settings.bridge
        self.recording = (
            recordings.bridged(given, bridge)
            if isinstance(given, Recording)
            else recordings.load(given, accept=settings.accept or None, bridge_s=bridge)
        )
        settings = self.settings = settings.on_epochs(self.recording)
        assert settings.epoch is not None
        self.scored = self.recording.reference is not None
        if self.recording.gnss is not None and self.recording.gnss.vel is None:
            allowed = 'fixes with velocities, or "velocity_from_positions": true in its mapping'
            raise ValueError(f"{self.recording.name}: its fixes are positions only; allowed: {allowed}")
        if settings.start == "told" and not self.scored:
            raise ValueError("start = 'told'; allowed: 'unknown', the recording has no reference to start from")
        navigates, ref = settings.mode == "navigate", self.recording.reference
        if navigates and ref is not None and (ref.vel is None or ref.pos is None):
            allowed = "a reference with velocities and positions, or mode = 'align'"
            raise ValueError(
                f"mode = 'navigate' on {self.recording.name}, whose reference is short of them; allowed: {allowed}"
            )
        self.n_sub = settings.samples_per_epoch(self.recording)
        told, coarse = settings.start == "told", settings.coarse or 0.0
        self.windows = Windows(
            self.recording,
            settings.epoch,
            self.n_sub,
            coarse,
            settings.window,
            settings.duration,
            settings.stride,
            told,
        )
        self.gps, imu = settings.fixes(self.recording), imu_spec(settings.imu)
        gps = self.gps
        self._std = settings.std_of_fixes(self.recording)
        told_aids = specs_of(settings.aids, self.recording)
        half = self.windows.half_sample
        self._aids = [RecordedAid(one, self.recording.aids[one.name], settings.epoch, half) for one in told_aids]
        for aid in self._aids:
            aid.check(self.windows.starts, self.windows.num_epochs, self.recording.name)
        self.fields = {**FIELDS, **(AGE if self.windows.aged else {}), **(STD if self._std else {})}
        self._bridges = Bridges(self.recording)
        if self._bridges.in_windows(self.windows.first_samples, self.windows.num_epochs * self.n_sub):
            self.fields |= BRIDGED
        self.fields |= {name: field for aid in self._aids for name, field in aid.fields.items()}
        self._every = epochs_per_fix(gps, settings.epoch) if self.recording.gnss is None else 1
        spread = TOLD_START_STD_DEG if told else unknown_spread(coarse)
        prior = PRIORS[settings.prior](imu, gps, settings.epoch, spread)
        self.task = Task(
            id=env_id,
            site=self.recording.site,
            epoch_s=settings.epoch,
            n_sub=self.n_sub,
            duration_s=self.windows.num_epochs * settings.epoch,
            coarse_s=coarse,
            imu=imu,
            gps=gps.told(prior.gps_vel_std_mps if settings.prior == "thesis" else None),
            prior=prior,
            coarse_told=not coarse,
            navigate=navigates,
            aids=tuple(one.told() for one in told_aids),
        )

    def reset(self, rngs: Rngs, options: dict[str, Any]) -> tuple[NavState, NavState | None]:
        """Begin one window per generator, and return the reference at t = 0 and the told states, if any."""
        given, windows = picked(options, "window"), self.windows.first_samples
        streams = [rng.spawn(2) for rng in rngs]  # window, start
        self._first_samples = windows[pick_rows("window", given, len(windows), [s[0] for s in streams])]
        self._rewind()
        truth = self.truth_at(0)
        if self.settings.start == "unknown":
            return truth, None
        draws = standard_normal([s[1] for s in streams], (9,))
        pos = None if self.task.navigate else truth.pos
        return truth, told_start(self.task, self.settings.misalignment_deg, truth, draws, pos)

    def _times(self, first: int, count: int) -> Array:
        """Return the ends of epochs first ... first + count - 1 on the clock of the recording, s, (runs, count)."""
        samples = self._first_samples[:, None] + np.arange(first, first + count) * self.n_sub
        return self.recording.t0 + samples / self.recording.rate_hz

    def _chunk(self, first: int, count: int) -> tuple[Obs, NavState]:
        rows = (self._first_samples + first * self.n_sub)[:, None] + np.arange(count * self.n_sub)
        shape = (len(rows), count, self.n_sub, 3)
        dtheta, dvel = self.recording.dtheta[rows].reshape(shape), self.recording.dvel[rows].reshape(shape)
        times = self._times(first + 1, count)
        number = np.arange(first + 1, first + count + 1)
        fixes = self._aged_fixes(times, number) if self.windows.aged else self._fixes(times, number)
        for aid in self._aids:
            fixes |= aid.readings(times, number)
        if "bridge_cov" in self.fields:
            fixes["bridge_cov"] = self._bridges.cov(rows[:, :: self.n_sub], self.n_sub)
        return {"dtheta": dtheta, "dvel": dvel, **fixes}, self._truth(times)

    def _fixes(self, times: Array, number: NDArray[np.int64]) -> Obs:
        gnss, there = self.recording.gnss, received(self.gps, number * self.task.epoch_s)
        if gnss is None:
            there &= number % self._every == 0
            return in_fields(zero_velocity_fixes(there, len(times), self.task.site.pos))
        half = self.windows.half_sample
        i = np.minimum(np.searchsorted(gnss.t_s, times - half), len(gnss.t_s) - 1)
        return self._delivered(i, (np.abs(gnss.t_s[i] - times) <= half)[..., None] & there[:, None])

    def _delivered(self, i: NDArray[np.int64], valid: Mask) -> Obs:
        """Return the fields of the fixes ``i`` (runs, epochs), with the noise that the receiver states of each."""
        gnss, std = self.recording.gnss, self._std
        assert gnss is not None
        assert gnss.vel is not None
        fixes = in_fields((gnss.vel[i] * valid, gnss.pos[i] * valid, valid.astype(np.int8)))
        if std:
            fixes |= {"gps_vel_std": std.vel[i] * valid, "gps_pos_std": std.pos[i] * valid}
        return fixes

    def _aged_fixes(self, times: Array, number: NDArray[np.int64]) -> Obs:
        """Return the fields of fixes that were made within epochs, with their ages at the end.

        An epoch takes the last fix that was made in it. If there are more, the one before waits for an epoch without one,
        and is delivered late there, if that is the next.
        """
        gnss, epoch = self.recording.gnss, self.task.epoch_s
        assert gnss is not None
        assert gnss.vel is not None
        edges = times[..., None] - epoch * np.arange(3)  # ends of this epoch and of the two before it
        edges[..., 2] = np.where(number > 1, edges[..., 2], edges[..., 1])  # nothing is known before the window
        last, before, earlier = np.moveaxis(np.searchsorted(gnss.t_s, edges + ON_TIME_S, side="right"), -1, 0)
        own, late = last > before, before - earlier > 1
        i = np.maximum(np.where(own, last - 1, before - 2), 0)
        age = np.maximum(times - gnss.t_s[i], 0.0)
        there = (own | late) & received(self.gps, number * epoch - age)
        valid = there[..., None]
        return {**self._delivered(i, valid), "gps_age": np.where(there, age, 0.0)[..., None]}

    def truth_at(self, k: int) -> NavState:
        """Return the reference at the end of epoch k, (runs, ...); epochs may be asked for in any order."""
        return NavState(*(part[:, 0] for part in self._truth(self._times(k, 1))))

    def _truth(self, times: Array) -> NavState:
        return recordings.reference_at(self.recording, times, self.windows.half_sample)
