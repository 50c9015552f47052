"""One episode of the bank: from epoch to epoch through strapdown, models, fix, reset and merger."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.prior import Prior
from sins_env.states import ERRORS, FIX, answered
from sins_env.types import NavState, Observation, Task
from solvers.filters.inputs import patterns
from solvers.pipeline import feedback, switch_on
from solvers.pipeline.aiding.aid import Ins
from solvers.pipeline.aiding.gps import Gps, noise_law
from solvers.pipeline.aiding.together import Aids, sensors, there, with_parameters
from solvers.pipeline.bank import regimes, start
from solvers.pipeline.bank.models import Models, propagate
from solvers.pipeline.bank.slices import Frame, Slices, join, normalised, replaced, sum_by_run, taken
from solvers.pipeline.errors.invariant import Invariant, Seen
from solvers.pipeline.errors.model import Parameter
from solvers.pipeline.errors.navigation import NavigationErrors
from solvers.pipeline.strapdown import EpochMotion, Strapdown, StrapdownState, carried_sample
from solvers.types import Gaussian, Health, Measurement

T = TypeVar("T")

TIDY_EVERY = 5  #: epochs from one merger of slices to the next
OFFSET = "fix_offset"  #: name of the states of the offset of the fixes


class Episode:
    """The state of the bank in an episode of ``task``."""

    def __init__(
        self,
        task: Task,
        num_runs: int,
        spacing_deg: float,
        imu_factors: Sequence[Sequence[float]],
        fix_factors: Sequence[float],
        fix_offsets: bool,
    ) -> None:
        self.task, self._k = task, 0
        self._single = False  # until the first observation tells it
        self._spacing = math.radians(spacing_deg)
        model, site = earth.get(task.site.earth), task.site.pos
        self._strapdown = Strapdown(model, task.epoch_s, task.n_sub, site, hold_position=not task.navigate)
        offset = (Parameter(OFFSET, 3, "m/s", std=0.0),)
        self._errors = with_parameters(NavigationErrors(task.navigate), task, behind=Gps.parameters(task) + offset)
        states = self._errors.states
        self._offset, self._phi = states[OFFSET], states["phi"]
        self._coordinates = Invariant(model, site, states)
        self._frame = Frame(model, self._coordinates, self._errors, own=self._offset.start)
        self._aid, self._aids = Gps(task, states), Aids(sensors(task, self._errors))
        self._decay, self._rate_ie = self._errors.decay(task.epoch_s), earth.rate_n(model, task.site.latitude)
        self._added = np.square([p.driven(task.epoch_s) / p.si for p in self._errors.parameters for _ in range(p.size)])
        self._models = Models(tuple((g, a) for g, a in imu_factors), fix_offsets)
        self._chain = self._models.chain(task.epoch_s)
        self._factors = np.array(fix_factors)
        self._told = regimes.cells(noise_law(task.gps))
        self._rest = regimes.stationary(len(fix_factors), list(fix_factors).index(1.0))
        self._Q_gyro = self._errors.noise(replace(task.prior, vrw_ug_sqrt_hz=0.0))
        self._Q_accel = self._errors.noise(replace(task.prior, arw_deg_sqrt_h=0.0))
        self.slices: Slices | None = None  #: None before any run has a slice
        self._begin(num_runs)

    def _begin(self, runs: int) -> None:
        self._runs = runs
        self._failed_at = np.full(runs, -1)
        self._waiting: Mask = np.ones(runs, dtype=bool)  # for the first fix, or for the first epoch of a told start
        self._nav = NavState(np.zeros((runs, 4)), np.zeros((runs, 3)), np.tile(self.task.site.pos, (runs, 1)))  # answer

    def step(self, obs: Observation) -> Array:
        """Return the answer at the end of the epoch."""
        self._single = obs["dtheta"].ndim == 2
        if self._single:
            obs = cast(Observation, {name: np.asarray(value)[None] for name, value in obs.items()})
        self._k += 1
        if self._k == 1:
            self._begin(len(obs["dtheta"]))
            if self.task.start is not None:
                nav = NavState(*(np.reshape(part, (self._runs, part.shape[-1])) for part in self.task.start))
                cut = start.told(nav, self.task.prior, self._spacing)
                self._add(np.arange(self._runs), StrapdownState(cut[0], None), *cut[1:], self.task.prior)
        if self.slices is not None:
            with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # such runs are marked instead
                self.slices = self._advance(self.slices, obs)
        if self._waiting.any():
            self._wait(obs)
        return self._answer()

    def _add(self, runs: NDArray[np.int64], ins: StrapdownState, weights: Array, variance: Array, prior: Prior) -> None:
        """Add the slices (len(runs), G, ...) of runs."""
        G, M = len(weights), self._models.count
        self._most = G
        N = len(runs) * G
        nav = NavState(*(part.reshape(N, -1) for part in ins.nav))
        x = self._errors.prior(prior.P0, (N,))
        up = self._phi.stop - 1
        x.cov[:, up, up] = variance
        x = self._coordinates.prior(x, nav)
        added = Slices(
            run=np.repeat(runs, G),
            ins=ins._replace(nav=nav),
            bias=np.zeros((N, self._frame.own.stop - self._frame.moving)),
            weight=np.tile(weights[:, None] * self._models.first, (len(runs), 1)),
            mean=np.repeat(x.mean[:, None], M, axis=1),
            cov=np.repeat(x.cov[:, None], M, axis=1),
            regimes=np.tile(self._rest, (N, M, 1)),
        )
        self.slices = added if self.slices is None else join(self.slices, added)
        self._waiting[runs] = False

    def _wait(self, obs: Observation) -> None:
        """Start the runs that have their first fix in this epoch; the answer of the others is the level."""
        level, waits = switch_on.level(obs), self._waiting.copy()
        self._nav = self._nav._replace(q_nb=np.where(waits[:, None], level, self._nav.q_nb))
        runs = np.flatnonzero(waits & (obs["gps_valid"][:, 0] == 1))
        if not len(runs):
            return
        nav, weights, variance = start.anywhere(NavState(*(part[runs] for part in self._nav)), self._spacing)
        seen = _rows(obs, np.repeat(runs, len(weights)))
        nav = Gps(self.task, self._errors.states).start(seen, nav.q_nb.reshape(-1, 4))
        ins = StrapdownState(nav, carried_sample(seen["dtheta"], seen["dvel"]))
        self._add(runs, ins, weights, variance, switch_on.switch_on_prior(self.task.prior))

    def _advance(self, s: Slices, obs: Observation) -> Slices:
        """Return the slices one epoch later."""
        rows, before = _rows(obs, s.run), s.ins.nav
        bias = self.task.epoch_s / self.task.n_sub * s.bias[:, None]
        dtheta, last = rows["dtheta"] - bias[..., :3], s.ins.last
        ins, motion = self._strapdown.advance(s.ins, dtheta, rows["dvel"] - bias[..., 3:6])
        s, of_epoch = self._lose(self._predict(s._replace(ins=ins), motion, before), (before, dtheta, last))
        rows = _rows(obs, s.run)
        me = self._aid.read(rows, self._ins(s, of_epoch))
        if me is not None:
            s, of_epoch = self._lose(self._fix(s, me, np.flatnonzero(rows["gps_valid"][:, 0] == 1)), of_epoch)
        if self._aids.aids:
            me = self._aids.read(_rows(obs, s.run), self._ins(s, of_epoch))
            if me is not None:
                s, _ = self._lose(self._aided(s, me), of_epoch)
        if self._k % TIDY_EVERY == 0 and (s.run[1:] == s.run[:-1]).any():
            s = self._frame.tidy(s, self._runs)
        return s

    def _predict(self, s: Slices, motion: EpochMotion, before: NavState) -> Slices:
        """Mix the models, and take them through the epoch of the INS."""
        a, b = self._coordinates.at(before), self._coordinates.at(s.ins.nav)
        F = b.growth(a, motion)
        mixed = self._models.mix(s.weight, s.x, s.regimes, self._chain, self._offset)
        gyro = b.spread_noise(self._Q_gyro)  # the noise of the accelerometers stays as it is
        x = propagate(mixed.x, F, gyro, self._Q_accel, self._models.noise, self._frame.moving)
        if self._decay is not None:  # what wanders, in the INS and in the models
            own = slice(self._errors.core.size, None)
            s = s._replace(bias=s.bias * self._decay[self._frame.moving : self._frame.own.stop])
            x = Gaussian(x.mean * self._decay, x.cov * np.outer(self._decay, self._decay))
            x.cov[..., own, own] += np.diag(self._added)
        return s._replace(weight=mixed.weight, mean=x.mean, cov=x.cov, regimes=mixed.regimes)

    def _fix(self, s: Slices, me: Measurement, seen: NDArray[np.int64]) -> Slices:
        """Return the slices after the fixes, which those at ``seen`` have, with their means fed back into the INS.

        Components that are NaN are missing. Slices that miss the same ones are corrected together.
        """
        if not len(seen):
            return s
        z, H = Seen(self._coordinates.at(s.ins.nav), me.h).at_zero
        H[..., : FIX["dv"].stop, self._offset] -= np.eye(3)  # INS minus fix shows the offset with a minus sign
        R = me.R if me.R.ndim == 2 else me.R[seen[0]]
        nu = me.z - z
        there = ~np.isnan(nu[seen])
        if there.all():
            return self._corrected(s, nu, H, R, seen)
        for rows, here in patterns(there):
            s = self._corrected(s, nu[:, rows], H[:, rows], R[np.ix_(rows, rows)], seen[here])
        return s

    def _aided(self, s: Slices, me: Measurement) -> Slices:
        """Return the slices after readings of aids, whose noise is as told, with their means fed back into the INS."""
        z, H = Seen(self._coordinates.at(s.ins.nav), me.h).at_zero
        nu, R = np.where(there(me), me.z - z, np.nan), me.R if me.R.ndim == 2 else me.R[0]
        for rows, here in patterns(~np.isnan(nu)):
            if rows.any():
                seen = np.flatnonzero(here)
                s = self._corrected(s, nu[:, rows], H[:, rows], R[np.ix_(rows, rows)], seen, as_told=True)
        return s

    def _ins(self, s: Slices, of_epoch: tuple[NavState, Array, Array | None]) -> Ins:
        """Return what an aid may ask of the INS of each slice."""
        before, dtheta, last = of_epoch
        first = self._frame.moving
        own = {
            p.name: s.bias[:, self._errors.states[p.name].start - first : self._errors.states[p.name].stop - first]
            for p in self._errors.parameters
            if p.fed
        }
        return Ins(s.ins.nav, before, dtheta, last, self.task.epoch_s, self._rate_ie, own)

    def _corrected(
        self, s: Slices, nu: Array, H: Array, R: Array, seen: NDArray[np.int64], as_told: bool = False
    ) -> Slices:
        """Correct the slices at ``seen``, given INS minus fix nu (N, m) and H (N, m, n) at zero error, and R (m, m).

        The noise is that of the regimes, or ``as_told``.
        """
        every = len(seen) == len(s.run)
        part, nu, H = (s, nu, H) if every else (s.take(seen), nu[seen], H[seen])
        nu = nu[:, None] - part.mean @ H.mT
        if as_told:
            p, one = np.ones((*part.weight.shape, 1)), np.ones(1)
            after = regimes.update(part.x, nu, H[:, None], R, p, one, regimes.Cells(one, one))
            after = after._replace(regimes=part.regimes)
        else:
            p = regimes.ahead(part.regimes, self._rest)
            after = regimes.update(part.x, nu, H[:, None], R, p, self._factors, self._told)
        logs = np.log(part.weight, out=np.full(part.weight.shape, -np.inf), where=part.weight > 0.0)
        weight = normalised(logs + after.log_likelihood, part.run, self._runs)
        part = part._replace(weight=weight, mean=after.x.mean, cov=after.x.cov, regimes=after.regimes)
        part = self._frame.reset(part)
        return part if every else s.put(seen, part)

    def _lose(self, s: Slices, beside: T) -> tuple[Slices, T]:
        """Drop slices that are not finite, and what is ``beside`` them; a run without any is lost."""
        parts = (s.mean, s.cov, s.weight)
        if all(math.isfinite(np.add.reduce(part, axis=None)) for part in parts):
            return s, beside
        well = np.all([np.isfinite(part).reshape(len(part), -1).all(axis=-1) for part in parts], axis=0)
        self._failed_at[np.setdiff1d(s.run, s.run[well])] = self._k
        touched = np.isin(np.arange(self._runs), s.run[~well])
        s = s.take(well)
        total = np.where(touched, sum_by_run(s.weight.sum(axis=-1), s.run, self._runs), 1.0)
        return s._replace(weight=s.weight / total[s.run][:, None]), taken(beside, well)

    def _answer(self) -> Array:
        """Return the corrected state of each run; a run that is lost keeps its last one."""
        if self.slices is not None and len(self.slices.run):
            s = self.slices
            view = self._frame.view(s, self._runs)
            runs = np.flatnonzero(view.top >= 0)
            at = NavState(*(part[view.top[runs]] for part in s.ins.nav))
            nav = self._coordinates.corrected(self._frame.mean(s, view, self._runs)[runs], at)
            self._nav = replaced(self._nav, runs, nav)
        answer = np.concatenate(self._nav, axis=-1) if self.task.navigate else self._nav.q_nb.copy()
        return answer[0] if self._single else answer

    def covariance(self) -> Array:
        """Return the covariance of the corrected errors; that of the start for a run without slices."""
        told = self.task.prior if self.task.start is not None else switch_on.switch_on_prior(self.task.prior)
        reported = answered(self.task.navigate)
        places = ERRORS.places(reported)
        P = np.tile(told.P0[np.ix_(places, places)], (self._runs, 1, 1))
        if self.slices is not None and len(self.slices.run):
            s = self.slices
            view = self._frame.view(s, self._runs)
            runs = np.flatnonzero(view.top >= 0)
            xi = self._frame.gaussian(s, view, self._runs)
            x = self._coordinates.gaussian(
                Gaussian(xi.mean[runs], xi.cov[runs]), NavState(*(part[view.top[runs]] for part in s.ins.nav))
            )
            here = self._errors.states.span(*reported.names)
            P[runs] = feedback.corrected_covariance(x.mean[..., self._phi], x.cov[..., here, here])
        return P[0] if self._single else P

    def health(self) -> Health:
        """Return which runs were lost, and when."""
        failed_at = self._failed_at[0] if self._single else self._failed_at.copy()
        zeros = np.zeros_like(failed_at)
        return Health(self._k, zeros, failed_at, zeros, bool((self._failed_at >= 0).any()))

    def diagnostics(self) -> dict[str, Array]:
        """Return weights and headings of the slices, and probabilities of models and regimes, of each run.

        The slots of slices that a run no longer has carry weight zero and a heading of NaN.
        """
        if self.slices is None:
            return {}
        s, runs = self.slices, self._runs
        weights = np.zeros((runs, self._most))
        headings = np.full(weights.shape, np.nan)
        slot = np.arange(len(s.run)) - np.searchsorted(s.run, s.run)
        weights[s.run, slot] = s.weight.sum(axis=-1)
        headings[s.run, slot] = attitude.to_euler(attitude.to_dcm(s.ins.nav.q_nb))[0]
        found = {
            "slices": (weights > 0.0).sum(axis=-1).astype(float),
            "slice_weights": weights,
            "slice_headings_rad": headings,
            "model_probabilities": sum_by_run(s.weight, s.run, runs),
            "regime_probabilities": sum_by_run((s.weight[..., None] * s.regimes).sum(axis=1), s.run, runs),
        }
        return {name: value[0] for name, value in found.items()} if self._single else found


def _rows(obs: Observation, run: NDArray[np.int64]) -> Observation:
    """Return the observation of the run of each slice."""
    if len(run) == len(obs["dtheta"]) and (run[1:] > run[:-1]).all():
        return obs  # one slice in each run
    return cast(Observation, {name: np.asarray(value)[run] for name, value in obs.items()})
