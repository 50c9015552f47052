"""One episode of the bank: from epoch to epoch through strapdown, models, rest, fix, reset and merger."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TypeVar, cast

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.states import ERRORS, NAVIGATION, answered
from sins_env.types import NavState, Observation, Task
from solvers.blocks.conditioning import condition, log_likelihood
from solvers.blocks.moments import correlated_moments
from solvers.filters.inputs import patterns
from solvers.pipeline import coarse as coarse_methods
from solvers.pipeline import feedback, switch_on
from solvers.pipeline.aiding.aid import Ins
from solvers.pipeline.aiding.gps import Gps, noise_law
from solvers.pipeline.aiding.stillness import Stillness, rest
from solvers.pipeline.aiding.together import Aids, fits, sensors, there, with_parameters
from solvers.pipeline.bank import regimes, start
from solvers.pipeline.bank.models import Models, propagate
from solvers.pipeline.bank.settings import BankSettings
from solvers.pipeline.bank.slices import Frame, Reading, Slices, join, normalised, replaced, sum_by_run, taken
from solvers.pipeline.errors.invariant import Invariant, Seen
from solvers.pipeline.errors.model import Parameter, each_by, told
from solvers.pipeline.errors.navigation import NavigationErrors
from solvers.pipeline.rewind import Samples
from solvers.pipeline.strapdown import EpochMotion, Strapdown, StrapdownState, bridge_noise, carried_sample
from solvers.pipeline.switch_on import SecondPass
from solvers.types import Gaussian, Health, Measurement

T = TypeVar("T")

TIDY_EVERY = 5  #: epochs from one merger of slices to the next
OFFSET = "fix_offset"  #: name of the states of the offset of the fixes


class Episode:
    """The state of the bank in an episode of ``task``."""

    def __init__(self, task: Task, num_runs: int, settings: BankSettings) -> None:
        self.task, self.settings = task, settings
        self._k, self._single = 0, False  # until the first observation tells whether it is a single run
        self._spacing = math.radians(settings.spacing_deg)
        model, site = earth.get(task.site.earth), task.site.pos
        self._strapdown = Strapdown(model, task.epoch_s, task.n_sub, site, hold_position=not task.navigate)
        offset = (Parameter(OFFSET, 3, "m/s", std=0.0),)
        self._errors = with_parameters(NavigationErrors(task.navigate), task, behind=Gps.parameters(task) + offset)
        states = self._errors.states
        self._offset, self._phi = states[OFFSET], states["phi"]
        self._coordinates = Invariant(model, site, states)
        self._frame = Frame(model, self._coordinates, self._errors, own=self._offset.start)
        self._aid, self._aids = Gps(task, states), Aids(sensors(task, self._errors))
        self._rate_ie, carry = earth.rate_n(model, task.site.latitude), self._errors.carry(task.epoch_s)
        self._carry = None if carry is None else linalg.block_diag(np.eye(self._errors.core.size), carry)
        self._added = self._errors.added(task.epoch_s)
        factors = settings.fix_factors
        self._models = Models(tuple((g, a) for g, a in settings.imu_factors), settings.fix_offsets)
        self._chain = self._models.chain(task.epoch_s)
        self._factors = np.array(factors)
        self._told = regimes.cells(noise_law(task.gps))
        self._as_told = list(factors).index(1.0)  # index of the regime of the told noise
        self._stationary = regimes.stationary(len(factors), self._as_told)
        self._Q_gyro = self._errors.noise(replace(task.prior, vrw_ug_sqrt_hz=0.0))
        self._Q_accel = self._errors.noise(replace(task.prior, arw_deg_sqrt_h=0.0))
        self._wander = self._errors.wandering(task.imu, task.epoch_s) if settings.bias_walk else None
        self.slices: Slices | None = None  #: None before any run has a slice
        self._begin(num_runs)

    def _begin(self, runs: int) -> None:
        self._runs, self._most = runs, 0
        self._samples = Samples(self.task)
        self._failed_at = np.full(runs, -1)
        self._waiting: Mask = np.ones(runs, dtype=bool)  # for the first fix, or for the first epoch of a told start
        self._nav = NavState(np.zeros((runs, 4)), np.zeros((runs, 3)), np.tile(self.task.site.pos, (runs, 1)))  # answer
        # epochs in which the told noise is not the likeliest, and all epochs with slices
        self._doubted, self._epochs = np.zeros((2, runs))
        self._stillness = Stillness(self.task, runs) if self.settings.stillness else None
        self._parked: Mask = np.zeros(runs, dtype=bool)  # in the last epoch
        self._coarse: coarse_methods.Coarse | None = None
        self._past: list[Observation] = []  # epochs of the coarse phase
        self._read: list[tuple[dict[str, slice], Reading]] = []  # of the last epoch, with the rows of each aid

    def step(self, obs: Observation) -> Array:
        """Return the answer at the end of the epoch."""
        self._single = obs["dtheta"].ndim == 2
        if self._single:
            obs = cast(Observation, {name: np.asarray(value)[None] for name, value in obs.items()})
        self._k += 1
        if self._k == 1:
            self._begin(len(obs["dtheta"]))
            self._open()
        if self._coarse is None:
            self._epoch(obs)
        else:
            self._gather(self._coarse, obs)
        return self._answer()

    def _open(self) -> None:
        """Add the slices of a told start, or begin a coarse phase."""
        task, method = self.task, self.settings.coarse
        if task.start is not None:
            nav = NavState(*(np.reshape(part, (self._runs, part.shape[-1])) for part in task.start))
            P0 = task.prior.P0
            cut = start.told(nav, P0[switch_on.UP, switch_on.UP], self._spacing)
            self._add(np.arange(self._runs), StrapdownState(cut[0], None), *cut[1:], P0)
        elif method is not None and task.coarse_s:
            self._coarse = coarse_methods.start(method, task, (self._runs,))

    def _gather(self, coarse: coarse_methods.Coarse, obs: Observation) -> None:
        """Take an epoch of the coarse phase; at its end, filter all of them."""
        coarse.add(obs)
        self._past.append(switch_on.kept(obs))
        self._nav = self._nav._replace(q_nb=coarse.attitude())
        if self._k * self.task.epoch_s < self.task.coarse_s - 1e-9 * self.task.epoch_s:
            return
        again = switch_on.second_pass(self.task, self._past, self._nav.q_nb, coarse.spread())
        self._coarse, self._past, self._k = None, [], 0
        for obs in again.past:
            self._k += 1
            self._epoch(obs, again)

    def _epoch(self, obs: Observation, again: SecondPass | None = None) -> None:
        """Take an epoch, or one of the coarse phase ``again``."""
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # such runs are marked instead
            still = None if self._stillness is None else self._stillness.seen(obs)
            self._samples.add(obs)
            if self.slices is not None:
                self.slices = self._advance(self.slices, obs, still)
                self._note(self.slices)
        if self._waiting.any():
            self._wait(obs, again)

    def _note(self, s: Slices) -> None:
        """Count the epochs in which the told noise has less than half of the weight."""
        told = s.weight[:, 0] * s.regimes[:, 0, self._as_told]
        told, all_of_it = sum_by_run(np.stack([told, s.weight.sum(axis=-1)], axis=-1), s.run, self._runs).T
        self._doubted += told < 0.5 * all_of_it
        self._epochs += all_of_it > 0.0

    def _add(self, runs: NDArray[np.int64], ins: StrapdownState, weights: Array, variance: Array, P0: Array) -> None:
        """Add the slices (len(runs), G, ...) of runs, with the prior P0 (15, 15) but for the ``variance`` of the heading."""
        G, M = len(weights), self._models.count
        self._most = max(self._most, G)
        N = len(runs) * G
        nav = NavState(*(part.reshape(N, -1) for part in ins.nav))
        x = self._errors.prior(P0, (N,))
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
            regimes=np.tile(self._stationary, (N, M, 1)),
        )
        self.slices = added if self.slices is None else join(self.slices, added)
        self._waiting[runs] = False

    def _wait(self, obs: Observation, again: SecondPass | None) -> None:
        """Start the runs that have their first fix in this epoch; the answer of the others is the level.

        In a second pass the attitude is known, a run has as many slices as its own heading needs, and the last epoch of the coarse
        phase needs no fix.
        """
        waits, k = self._waiting.copy(), self._k - 1
        q_nb = switch_on.level(obs) if again is None else again.q_nb[k]
        self._nav = self._nav._replace(q_nb=np.where(waits[:, None], q_nb, self._nav.q_nb))
        now = obs["gps_valid"][:, 0] == 1
        if again is None:
            runs = np.flatnonzero(waits & now)
            if len(runs):
                cut = start.anywhere(NavState(*(part[runs] for part in self._nav)), self._spacing)
                self._start(obs, runs, *cut, switch_on.switch_on_prior(self.task.prior).P0)
            return
        for run in np.flatnonzero(waits & (now | (k == len(again.past) - 1)))[:, None]:
            P0 = again.P0[run[0]]
            nav = NavState(*(part[run] for part in self._nav))
            self._start(obs, run, *start.told(nav, P0[switch_on.UP, switch_on.UP], self._spacing), P0)

    def _start(
        self, obs: Observation, runs: NDArray[np.int64], nav: NavState, weights: Array, variance: Array, P0: Array
    ) -> None:
        """Add slices (len(runs), G, ...) with the velocity and the place of the fix."""
        seen = _rows(obs, np.repeat(runs, len(weights)))
        nav = Gps(self.task, self._errors.states).start(seen, nav.q_nb.reshape(-1, 4))
        ins = StrapdownState(nav, carried_sample(seen["dtheta"], seen["dvel"]))
        self._add(runs, ins, weights, variance, P0)

    def _advance(self, s: Slices, obs: Observation, still: Mask | None) -> Slices:
        """Return the slices one epoch later; ``still`` (runs,) are the runs that are seen to stand still."""
        rows, before = _rows(obs, s.run), s.ins.nav
        self._read = []
        bias = self.task.epoch_s / self.task.n_sub * s.bias[:, None]
        dtheta, last = rows["dtheta"] - bias[..., :3], s.ins.last
        ins, motion = self._strapdown.advance(s.ins, dtheta, rows["dvel"] - bias[..., 3:6])
        s = self._predict(s._replace(ins=ins), motion, before, bridge_noise(rows))
        if still is not None:
            s = self._at_rest(s, dtheta.sum(axis=-2), still)
        s, of_epoch = self._lose(s, (before, dtheta, last))
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

    def _predict(self, s: Slices, motion: EpochMotion, before: NavState, bridged: Array | None) -> Slices:
        """Mix the models, and take them through the epoch of the INS; ``bridged`` is the noise of bridged samples, if any."""
        a, b = self._coordinates.at(before), self._coordinates.at(s.ins.nav)
        F = b.growth(a, motion)
        mixed = self._models.mix(s.weight, s.x, s.regimes, self._chain, self._offset)
        gyro = b.spread_noise(self._Q_gyro)  # the noise of the accelerometers stays as it is
        x = propagate(mixed.x, F, gyro, self._Q_accel, self._models.noise, self._frame.moving)
        if self._carry is not None:  # what wanders, in the INS and in the models
            own, fed = slice(self._errors.core.size, None), slice(self._frame.moving, self._frame.own.stop)
            s = s._replace(bias=each_by(self._carry[fed, fed], s.bias))
            x = Gaussian(each_by(self._carry, x.mean), self._carry @ x.cov @ self._carry.T)
            x.cov[..., own, own] += self._added
        if self._wander is not None:
            x = x._replace(cov=x.cov + self._wander)
        if bridged is not None:
            x = x._replace(cov=x.cov + b.spread_noise(self._errors.disturbed(motion, bridged))[:, None])
        return s._replace(weight=mixed.weight, mean=x.mean, cov=x.cov, regimes=mixed.regimes)

    def _at_rest(self, s: Slices, dtheta: Array, still: Mask) -> Slices:
        """Correct the slices of runs that stand ``still`` (runs,), and of those that are parked but rocked.

        While a base is parked, its fixes have the told noise: for seconds they wander smoothly, and are no better for that.
        """
        assert self._stillness is not None
        level = np.where(still, np.nan, self._stillness.level())
        self._parked = np.isfinite(level)
        if still.any():
            s = self._rest(s, dtheta, np.flatnonzero(still[s.run]))
        if self._parked.any():
            sigma = level[s.run, None]
            H = np.eye(3, self._errors.states.size, self._errors.states["dv"].start) / sigma[..., None]
            H = self._coordinates.at(s.ins.nav).divided(H)
            seen = np.flatnonzero(self._parked[s.run])
            s = self._corrected(s, s.ins.nav.vel / sigma, H, np.eye(3), seen, as_told=True)
        return s

    def _rest(self, s: Slices, dtheta: Array, still: NDArray[np.int64]) -> Slices:
        """Correct the slices at ``still``, which stand still after they turned by dtheta (N, 3) in the epoch.

        The gyros' noise in the reading is that of the prediction, with the factor of each model.
        """
        part = s.take(still)
        shown = rest(self.task, self._errors.states, dtheta[still], part.ins.nav)
        chart = self._coordinates.at(part.ins.nav)
        gyros = self._models.noise[:, 0, None, None]
        R, M = shown.motion + gyros * shown.noise, gyros * (chart.slope() @ shown.cross)[:, None]
        y = correlated_moments(chart.divided(shown.H)[:, None], part.x, R, M)
        x, innovation, _ = condition(part.x, y, shown.z[:, None])
        return self._weighed(s, part, still, x, log_likelihood(innovation), part.regimes)

    def _fix(self, s: Slices, me: Measurement, seen: NDArray[np.int64]) -> Slices:
        """Return the slices after the fixes, which those at ``seen`` have, with their means fed back into the INS.

        Components that are NaN are missing. Slices that miss the same ones are corrected together.
        """
        if not len(seen):
            return s
        z, H = Seen(self._coordinates.at(s.ins.nav), me.h).at_zero
        if "dv" in self._aid.shown:
            H[..., self._aid.shown["dv"], self._offset] -= np.eye(3)  # INS minus fix shows the offset with a minus sign
        nu, R = me.z - z, me.R
        self._read.append(({"gps": slice(R.shape[-1])}, Reading(s, nu, H, R, seen)))
        there = ~np.isnan(nu[seen])
        if there.all():
            return self._corrected(s, nu, H, R, seen)
        for rows, here in patterns(there):
            s = self._corrected(s, nu[:, rows], H[:, rows], R[..., rows, :][..., rows], seen[here])
        return s

    def _aided(self, s: Slices, me: Measurement) -> Slices:
        """Return the slices after readings of aids, whose noise is as told, with their means fed back into the INS."""
        z, H = Seen(self._coordinates.at(s.ins.nav), me.h).at_zero
        nu, R = np.where(there(me), me.z - z, np.nan), me.R
        self._read.append((self._aids.rows, Reading(s, nu, H, R, np.arange(len(nu)))))
        for rows, here in patterns(~np.isnan(nu)):
            if rows.any():
                seen = np.flatnonzero(here)
                s = self._corrected(s, nu[:, rows], H[:, rows], R[..., rows, :][..., rows], seen, as_told=True)
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
        samples = self._samples.last
        if samples is not None:
            bias = self.task.epoch_s / self.task.n_sub * s.bias[:, None]
            samples = samples[0][s.run] - bias[..., :3], samples[1][s.run] - bias[..., 3:6]
        return Ins(s.ins.nav, before, dtheta, last, self.task.epoch_s, self._rate_ie, own, samples)

    def _corrected(
        self, s: Slices, nu: Array, H: Array, R: Array, seen: NDArray[np.int64], as_told: bool = False
    ) -> Slices:
        """Correct the slices at ``seen``, given INS minus fix nu (N, m) and H (N, m, n) at zero error, and R (m, m) or (N, m, m).

        The noise is that of the regimes, or ``as_told``.
        """
        if R.ndim > 2:  # another in each slice, alike for its models
            R = R[seen][:, None]
        part, nu, H = (s, nu, H) if len(seen) == len(s.run) else (s.take(seen), nu[seen], H[seen])
        nu = nu[:, None] - part.mean @ H.mT
        if as_told:
            p, one = np.ones((*part.weight.shape, 1)), np.ones(1)
            after = regimes.update(part.x, nu, H[:, None], R, p, one, regimes.Cells(one, one))
            after = after._replace(regimes=part.regimes)
        else:
            p = regimes.ahead(part.regimes, self._stationary)
            parked = self._parked[part.run]
            p[parked] = np.arange(len(self._factors)) == self._as_told
            after = regimes.update(part.x, nu, H[:, None], R, p, self._factors, self._told)
            after.regimes[parked] = part.regimes[parked]
        return self._weighed(s, part, seen, after.x, after.log_likelihood, after.regimes)

    def _weighed(
        self, s: Slices, part: Slices, seen: NDArray[np.int64], x: Gaussian, likelihood: Array, probabilities: Array
    ) -> Slices:
        """Return the slices with those at ``seen``, ``part``, corrected to x, weighed by the log-likelihood and reset.

        The ``probabilities`` are those of the regimes.
        """
        logs = np.log(part.weight, out=np.full(part.weight.shape, -np.inf), where=part.weight > 0.0)
        weight = normalised(logs + likelihood, part.run, self._runs)
        part = part._replace(weight=weight, mean=x.mean, cov=x.cov, regimes=probabilities)
        part = self._frame.reset(part)
        return part if len(seen) == len(s.run) else s.put(seen, part)

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
        begun = self.task.start is not None or self._coarse is not None
        told = self.task.prior if begun else switch_on.switch_on_prior(self.task.prior)
        reported = answered(self.task.navigate)
        places = ERRORS.places(reported)
        P = np.tile(told.P0[np.ix_(places, places)], (self._runs, 1, 1))
        if self.slices is not None and len(self.slices.run):
            runs, _, x = self._errors_of_best(self.slices)
            here = self._errors.states.span(*reported.names)
            P[runs] = feedback.corrected_covariance(x.mean[..., self._phi], x.cov[..., here, here])
        return P[0] if self._single else P

    def _errors_of_best(self, s: Slices) -> tuple[NDArray[np.int64], NDArray[np.int64], Gaussian]:
        """Return the runs that have slices, the best slice of each, and the Gaussian of the errors of its INS."""
        view = self._frame.view(s, self._runs)
        runs = np.flatnonzero(view.top >= 0)
        top, xi = view.top[runs], self._frame.gaussian(s, view, self._runs)
        nav = NavState(*(part[top] for part in s.ins.nav))
        return runs, top, self._coordinates.gaussian(Gaussian(xi.mean[runs], xi.cov[runs]), nav)

    def _constants(self, s: Slices) -> dict[str, Array]:
        """Return biases and parameters of aids, each with its standard deviation; NaN in runs without slices."""
        runs, top, x = self._errors_of_best(s)
        states, first = self._errors.states.without(OFFSET), self._frame.moving
        fed = {
            name: s.bias[top, states[name].start - first : states[name].stop - first]
            for name in states.without(*NAVIGATION.names).names
        }
        found = told(states, fed, x.mean, x.cov)
        return {
            name: replaced(np.full((self._runs, value.shape[-1]), np.nan), runs, value) for name, value in found.items()
        }

    def health(self) -> Health:
        """Return which runs were lost, and when."""
        failed_at = self._failed_at[0] if self._single else self._failed_at.copy()
        zeros = np.zeros_like(failed_at)
        return Health(self._k, zeros, failed_at, zeros, bool((self._failed_at >= 0).any()))

    def diagnostics(self) -> dict[str, Array]:
        """Return weights and headings of the slices, and probabilities of models and regimes, of each run.

        Beside them are the biases ``gyro_bias`` (..., 3) rad/s and ``accel_bias`` (..., 3) m/s^2 and the parameters of aids in SI
        units, each with ``<name>_sigma``. After an epoch with a fix or reading, ``<aid>_residual`` (..., m) is the INS minus the
        reading less its prediction in the best slice. Its covariance is ``<aid>_covariance`` (..., m, m), and ``<aid>_nis`` (...)
        its normalised square; NaN without one.

        ``doubt`` is the share of epochs so far in which the told noise was less likely than all other hypotheses together. The
        answer then rests on these. It is near zero if the task tells the truth, and a warning else.

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
            "doubt": self._doubted / np.maximum(self._epochs, 1.0),
            "slices": (weights > 0.0).sum(axis=-1).astype(float),
            "slice_weights": weights,
            "slice_headings_rad": headings,
            "model_probabilities": sum_by_run(s.weight, s.run, runs),
            "regime_probabilities": sum_by_run((s.weight[..., None] * s.regimes).sum(axis=1), s.run, runs),
        }
        if len(s.run):
            found |= self._constants(s)
        for rows, reading in self._read:
            found |= fits(self._frame.innovation(reading, runs), rows)
        return {name: value[0] for name, value in found.items()} if self._single else found


def _rows(obs: Observation, run: NDArray[np.int64]) -> Observation:
    """Return the observation of the run of each slice."""
    if len(run) == len(obs["dtheta"]) and (run[1:] > run[:-1]).all():
        return obs  # one slice in each run
    return cast(Observation, {name: np.asarray(value)[run] for name, value in obs.items()})
