"""An INS held by aids: strapdown, an error model and any filter of the zoo, after coarse alignment for an unknown start.

Alignment and navigation share this. :mod:`solvers.pipeline.estimator` says which errors there are, which aid, and what the
answer is.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from sins_env import earth
from sins_env.arrays import Array, Mask
from sins_env.kernels import kernel
from sins_env.kernels.algebra import put_row, row, subtract, vector
from sins_env.states import ERRORS, Layout, answered
from sins_env.types import NavState, Observation, Rng, Task
from solvers.blocks.correlated import independent
from solvers.filters.base import choose, mixed
from solvers.filters.brief import changed
from solvers.pipeline import coarse as coarse_methods
from solvers.pipeline import feedback as reset
from solvers.pipeline import switch_on
from solvers.pipeline.aiding.aid import Aid, Ins
from solvers.pipeline.aiding.gps import Gps
from solvers.pipeline.aiding.together import Aids, decayed, fits, sensors, with_parameters
from solvers.pipeline.aiding.zero_velocity import ZeroRate, ZeroVelocity
from solvers.pipeline.coarse.spread import told_by
from solvers.pipeline.errors.equivariant import Equivariant
from solvers.pipeline.errors.invariant import Euler, Invariant
from solvers.pipeline.errors.model import ErrorModel, told
from solvers.pipeline.noise_factors import NoiseFactors
from solvers.pipeline.rewind import Samples
from solvers.pipeline.settings import Settings
from solvers.pipeline.strapdown import Strapdown, StrapdownState, bridge_noise, carried_sample
from solvers.pipeline.switch_on import SecondPass
from solvers.types import Filter, Gaussian, Health, Innovation


class Integration(ABC):
    """Base of the estimators around a filter. A told start leads straight to the fine phase, an unknown one to the coarse.

    The coarse phase of a base that travels goes on until its heading is known. If a task of navigation has none, its filter begins
    after one of its own. A filter that stands any heading, and alignment, begin at the first fix
    (:mod:`solvers.pipeline.switch_on`).
    """

    navigates: ClassVar[bool]  #: whether the INS and the answer have a position
    default: ClassVar[Settings]  #: values for what neither the settings nor the filter say
    aid: ClassVar[type[Gps]]  #: the sensor that starts the INS and holds it; the aids of a task come beside it

    def __init__(self, filter: Filter[Any], errors: ErrorModel, settings: Settings) -> None:
        self.filter, self.errors, self.settings = filter, errors, settings
        self.batched: bool = getattr(filter, "batched", True)
        self._task: Task | None = None

    def __repr__(self) -> str:
        return f"{type(self).__name__}({', '.join([repr(self.filter), *changed(Settings, vars(self.settings))])})"

    @property
    def running(self) -> Integration:
        """The estimator in use, which is this one."""
        return self

    @property
    def task(self) -> Task:
        """The task of the last ``reset``.

        Raises:
            RuntimeError: there has been none.
        """
        if self._task is None:
            raise RuntimeError(f"{self!r} has no task yet; call reset(task, rng) first")
        return self._task

    def reset(self, task: Task, rng: Rng, num_runs: int = 1) -> None:
        """Begin an episode of ``task`` with ``num_runs`` runs; ``rng`` is one Generator, or a sequence with one per run."""
        self._task, self._rng, self._k = task, rng, 0
        single = num_runs == 1 and (rng is None or isinstance(rng, np.random.Generator))
        self._batch: tuple[int, ...] = () if single else (num_runs,)  # until the first observation tells it
        self._earth, pos = earth.get(task.site.earth), task.site.pos
        self._strapdown = Strapdown(self._earth, task.epoch_s, task.n_sub, pos, hold_position=not self.navigates)
        self._errors = with_parameters(self.error_model(task), task, behind=self.aid.parameters(task))
        states = self._errors.states
        self._phi, self._fed = states["phi"], states.span(*self._errors.fed)
        self._Q, self._aid = self._errors.noise(task.prior), self.aid(task, states)
        if self.settings.bias_walk:
            self._Q = self._Q + self._errors.wandering(task.imu, task.epoch_s)
        rest: list[Aid] = []
        if self.settings.stillness:
            seen = ZeroVelocity(task, states)
            rest = [seen, ZeroRate(task, states, seen)] if self.settings.zero_rate else [seen]
        self._aids = Aids((self._aid, *sensors(task, self._errors), *rest))
        self._rate_ie = earth.rate_n(self._earth, task.site.latitude)
        self._samples = Samples(task)
        #: Parameters of aids that have been fed back so far by name, (..., size) in SI units.
        self.own: dict[str, Array] = {}
        self._innovation: Innovation | None = None  # of the last epoch
        self._factors: NoiseFactors | None = None  # of the assumed noise; None: as told
        self._coarse: coarse_methods.Coarse | None = None
        self._past: list[Observation] = []  # epochs of the coarse phase, if they are filtered again
        self._waiting: Mask = np.zeros(
            self._batch, dtype=bool
        )  # runs that have had no fix since switch-on, or are not aligned
        self._late = False  # whether the coarse phase goes on beyond its time
        self.ins: StrapdownState | None = None  #: state of the INS; None before the fine phase
        #: Biases of gyro and accelerometer that have been fed back so far, per increment; None if there are none.
        self.bias: tuple[Array, Array] | None = None
        self.belief: Any = None  #: belief of the filter; None before the fine phase
        charts = {"invariant": Invariant, "equivariant": Equivariant}
        kind = charts.get(str(self.settings.coordinates))
        self._coordinates = Euler() if kind is None else kind(self._earth, pos, states)

    def step(self, obs: Observation) -> Array:
        """Return the estimate at the end of the epoch.

        Raises:
            RuntimeError: there has been no ``reset``.
        """
        task = self.task
        self._k += 1
        if self._k == 1:
            self._begin(obs["dtheta"].shape[:-2])
        self._samples.add(obs)
        if self._coarse is None:
            nav = None if self.ins is None else self._fine(obs)
            return self.answer(self._wait(obs, nav))
        self._coarse.add(obs)
        if self.settings.coarse_again:
            self._past.append(switch_on.kept(obs))
        nav = self._coarse.state(self._aid.start(obs, self._coarse.attitude()))
        if self._k * task.epoch_s >= task.coarse_s - 1e-9 * task.epoch_s:
            nav = self._after_coarse(self._coarse, obs, nav)
        return self.answer(nav)

    def covariance(self) -> Array:
        """Return the covariance of the corrected errors: phi_ENU rad and, in navigation, velocity m/s and position m.

        The shape is (..., 3, 3) or (..., 9, 9). Before the fine phase it is the told one.
        """
        prior, reported = self.task.prior, answered(self.navigates)
        prior = switch_on.switch_on_prior(prior) if self._late else prior
        places = ERRORS.places(reported)
        told = np.broadcast_to(prior.P0[np.ix_(places, places)], (*self._batch, reported.size, reported.size))
        if self.belief is None:
            return told.copy()
        assert self.ins is not None
        x, P = self._coordinates.gaussian(self.filter.estimate(self.belief), self.ins.nav)
        here = self._errors.states.span(*reported.names)
        found = reset.corrected_covariance(x[..., self._phi], P[..., here, here])
        late = self._waiting if self._coarse is not None else np.array(False)
        return np.where(late[..., None, None], told, found) if late.any() else found

    def health(self) -> Health | None:
        """Return repairs and failures of each run so far; None in the coarse phase."""
        return None if self.belief is None else self.belief.health

    def diagnostics(self) -> dict[str, Array]:
        """Return what the filter knows beside its estimate, by name; nothing in the coarse phase.

        These are the biases ``gyro_bias`` (..., 3) rad/s and ``accel_bias`` (..., 3) m/s^2 and the parameters of aids in SI units,
        each with ``<name>_sigma``. Biases in navigation axes are left out.

        After an epoch with a fix or reading, ``<aid>_residual`` (..., m) is the INS minus the reading less its prediction. Its
        covariance is ``<aid>_covariance`` (..., m, m), and ``<aid>_nis`` (...) its normalised square; NaN without one.
        """
        if self.belief is None:
            return {}
        found = {**self.filter.diagnostics(self.belief), **self._constants()}
        return found if self._innovation is None else {**found, **fits(self._innovation, self._aids.rows)}

    @property
    def readings(self) -> dict[str, int]:
        """Number of components of the fixes and of each aid by name; known after ``reset``."""
        return {name: rows.stop - rows.start for name, rows in self._aids.rows.items()}

    def scale_noise(self, q: ArrayLike = 1.0, r: ArrayLike | Mapping[str, ArrayLike] = 1.0) -> None:
        """Multiply the told Q by ``q`` and the told R by ``r``, from the next epoch until another call or ``reset``.

        A factor is one number, or one for each run (...). ``r`` may be a mapping from the names of ``readings`` to factors.

        Raises:
            RuntimeError: there has been no ``reset``.
            ValueError: an unknown sensor, a factor that is not positive and finite, or an estimator with ``zero_rate``, whose
                measurement has the noise of the prediction.
        """
        _ = self.task
        if self.settings.zero_rate:
            raise ValueError("scale_noise with zero_rate = True; allowed: with zero_rate = False")
        self._factors = NoiseFactors.of(q, r, self._aids.rows)

    def _constants(self) -> dict[str, Array]:
        """Return biases and parameters of aids, each with its standard deviation; NaN in runs that have not begun."""
        assert self.ins is not None
        _, errors, P = self.solution(self.filter.estimate(self.belief), self.ins.nav)
        fed = dict(self.own)
        if self.bias is not None:
            per_sample = self.task.epoch_s / self.task.n_sub
            fed |= {"gyro_bias": self.bias[0] / per_sample, "accel_bias": self.bias[1] / per_sample}
        found = told(self.states, fed, errors, P)
        turned = ("gyro_bias", "accel_bias") if self.settings.bias_frame == "nav" else ()
        begun = self.begun[..., None]
        return {
            name: np.where(begun, value, np.nan)
            for name, value in found.items()
            if name.removesuffix("_sigma") not in turned
        }

    @property
    def states(self) -> Layout:
        """The states of the filter by name, in their own units; known after ``reset``."""
        return self._errors.states

    @property
    def begun(self) -> Mask:
        """Whether each run (...) has begun; one that starts at switch-on waits for its first fix."""
        return ~self._waiting

    def solution(self, x: Gaussian, nav: NavState) -> tuple[NavState, Array, Array]:
        """Return what an estimate of the filter makes of a state of the INS, for any axes in front.

        These are the corrected state, the errors (..., n) taken from it, and the covariance (..., n, n) of the errors left.
        Both have the units of ``states``.
        """
        errors, P = self._coordinates.gaussian(x, nav)
        J = reset.reset_maps(errors, self._phi, self._fed)[1](errors)
        return self._errors.corrected(self._earth, nav, errors), errors, J @ P @ J.mT

    def error_model(self, task: Task) -> ErrorModel:
        """Return the error model for a task, without parameters of aids."""
        return self.errors

    @abstractmethod
    def answer(self, nav: NavState) -> Array:
        """Return the action for a corrected state."""

    def _begin(self, batch: tuple[int, ...]) -> None:
        self._batch, start = batch, self.task.start
        at_once = start is None and not self.task.coarse_s
        aligns = self.navigates and not getattr(self.filter, "any_heading", False) and not self.settings.coarse_again
        self._waiting = np.full(batch, at_once and not aligns)
        if self._waiting.any():
            return
        if start is None:
            self._coarse = self._begin_coarse(batch)
        else:
            nav = NavState(*(np.reshape(part, (*batch, part.shape[-1])) for part in start))
            self._start_fine(nav, self.task.prior.P0)

    def _begin_coarse(self, batch: tuple[int, ...]) -> coarse_methods.Coarse:
        """Begin the coarse phase by the method that was asked for, else by the one that the data ask for."""
        if self.settings.coarse is not None:
            return coarse_methods.start(self.settings.coarse, self.task, batch)
        assert self.default.coarse is not None
        return coarse_methods.FromData(self.task, batch, self.default.coarse)

    def _wait(self, obs: Observation, nav: NavState | None, again: SecondPass | None = None) -> NavState:
        """Start the runs that have their first fix, and return the answer: ``nav`` in the runs that have started before.

        In a second pass the attitude is known, and the last epoch of the coarse phase needs no fix.
        """
        if nav is not None and not self._waiting.any():
            return nav
        start = self._aid.start(obs, switch_on.level(obs) if again is None else again.q_nb[self._k - 1])
        last = again is not None and self._k == len(again.past)
        now = self._waiting & ((obs["gps_valid"][..., 0] == 1) | last)
        if nav is None or now.any():
            P0 = switch_on.switch_on_prior(self.task.prior).P0 if again is None else again.P0
            self._join(now, start, P0, carried_sample(obs["dtheta"], obs["dvel"]), first=nav is None)
        answer: NavState = start if nav is None else choose(self._waiting, start, nav)
        self._waiting = self._waiting & ~now
        return answer

    def _join(self, now: Mask, start: NavState, P0: Array, last: Array | None, first: bool) -> None:
        """Begin the fine phase in the runs ``now`` (...), and if they are the ``first`` provisionally in all."""
        ins, bias, belief, own = self.ins, self.bias, self.belief, self.own
        self._start_fine(start, P0)
        self.ins = StrapdownState(start, last)
        if first:
            return
        self.ins, self.belief = choose(now, self.ins, ins), mixed(now, self.belief, belief)
        if bias is not None:
            gyro, accel = (np.where(now[..., None], 0.0, part) for part in bias)
            self.bias = gyro, accel
        self.own = {name: np.where(now[..., None], 0.0, part) for name, part in own.items()}

    def _after_coarse(self, coarse: coarse_methods.Coarse, obs: Observation, start: NavState) -> NavState:
        """Begin the fine phase in the runs that are due after the coarse one, which has led to ``start``; return the answer."""
        if self.settings.coarse_again:
            return self._again(coarse, start)
        nav = None if self.ins is None else self._fine(obs)
        if not self._late:
            self._waiting = np.ones(self._batch, dtype=bool)
        now = self._waiting & (coarse.due if self.navigates else True)
        if now.any():
            last = carried_sample(obs["dtheta"], obs["dvel"]) if self._late else None
            self._join(now, start, self._found(coarse, start), last, first=nav is None)
        answer = start if nav is None else choose(self._waiting, start, nav)
        self._waiting, self._late = self._waiting & ~now, True
        if not self._waiting.any():
            self._coarse = None
        return answer

    def _found(self, coarse: coarse_methods.Coarse, nav: NavState) -> Array:
        """Return the covariance P0 of the errors after the coarse phase, (15, 15) or (..., 15, 15)."""
        prior, spread = self.task.prior, coarse.spread()
        if spread is None or (self.task.coarse_told and self.task.coarse_s):
            return prior.P0
        q_nb = nav.q_nb if self.settings.bias_frame == "nav" else None
        if not coarse.travels.any():
            return told_by(spread, prior, q_nb)
        travels = coarse.travels[..., None, None]
        return np.where(travels, *(told_by(spread, one, q_nb) for one in (switch_on.switch_on_prior(prior), prior)))

    def _again(self, coarse: coarse_methods.Coarse, nav: NavState) -> NavState:
        """Filter the epochs of the coarse phase, which ends at ``nav``, again, and return the answer."""
        self._coarse = None
        again = switch_on.second_pass(self.task, self._past, nav.q_nb, coarse.spread())
        self._past, self._k, self._waiting = [], 0, np.ones(self._batch, dtype=bool)
        self._samples.clear()
        for obs in again.past:
            self._k += 1
            self._samples.add(obs)
            nav = self._wait(obs, None if self.ins is None else self._fine(obs), again)
        return nav

    def _start_fine(self, nav: NavState, P0: Array) -> None:
        """Begin the fine phase with a state of the INS, and the covariance P0 (..., 15, 15) of its errors."""
        self.ins = self._strapdown.start(nav)
        self.own = {p.name: np.zeros((*self._batch, p.size)) for p in self._errors.parameters if p.fed}
        errors = self._errors.prior(P0, self._batch)
        self.belief = self.filter.init(self._coordinates.prior(errors, nav), self._rng)

    def _fine(self, obs: Observation) -> NavState:
        assert self.ins is not None
        (before, last), (dtheta, dvel) = self.ins, self._increments(obs["dtheta"], obs["dvel"])
        self.ins, motion = self._strapdown.advance(self.ins, dtheta, dvel)
        self.own = decayed(self._errors.parameters, self.own, self.task.epoch_s)
        samples = self._samples.last
        samples = None if samples is None else self._increments(*samples)
        seen = Ins(self.ins.nav, before, dtheta, last, self.task.epoch_s, self._rate_ie, self.own, samples)
        ins = self._aid.hold(obs, seen)
        if ins is not self.ins.nav:
            self.ins, seen = self.ins._replace(nav=ins), replace(seen, nav=ins)
        measurement = self._aids.read(obs, seen)
        Q = self._Q
        if (bridged := bridge_noise(obs)) is not None:
            Q = Q + self._errors.disturbed(motion, bridged)
        transition = self._coordinates.transition(self._errors.transition(motion, Q), before, ins)
        if self._factors is not None:
            transition = self._factors.process(transition)
            measurement = None if measurement is None else self._factors.measurement(measurement)
        if measurement is not None:
            measurement = self._coordinates.measurement(measurement, ins)
            if self.settings.aid_gate < 1.0:
                now = self.filter.estimate(self.belief)
                measurement = self._aids.gated(measurement, transition, now, self.settings.aid_gate)
            if self._aids.shared is not None:
                part, M = self._aids.shared
                part = self._coordinates.measurement(part, ins)
                if measurement.present is not None:  # a gate may have left it out
                    part = part._replace(present=measurement.present[..., self._aids.rows["zero_rate"]])
                transition = independent(transition, part, self._coordinates.noise(M, ins))
        self.belief, self._innovation = self.filter.step(self.belief, transition, measurement)
        x = self._coordinates.errors(self.filter.estimate(self.belief).mean, ins)
        nav = self._errors.corrected(self._earth, ins, x)
        if self.settings.feedback == "closed" and measurement is not None:
            self._feed_back(nav, x)
        return nav

    def _increments(self, dtheta: Array, dvel: Array) -> tuple[Array, Array]:
        """Return increments without the biases fed back so far."""
        if self.bias is None:
            return dtheta, dvel
        dtheta, dvel = _without(dtheta, dvel, *self.bias)
        return dtheta, dvel

    def _feed_back(self, nav: NavState, x: Array) -> None:
        assert self.ins is not None
        before, self.ins = self.ins.nav, self.ins._replace(nav=nav)
        biases = self._errors.biases(x)
        if biases is not None:
            per_sample = self.task.epoch_s / self.task.n_sub
            so_far = self.bias or (0.0, 0.0)
            self.bias = so_far[0] + per_sample * biases[0], so_far[1] + per_sample * biases[1]
        states = self._errors.states
        self.own = {name: fed + states.si[states[name]] * x[..., states[name]] for name, fed in self.own.items()}
        maps = reset.reset_maps(x, self._phi, self._fed)
        self.belief = self.filter.relocate(self.belief, *self._coordinates.reset(maps, before, nav))


@kernel("(s,3),(s,3),(3),(3)->(s,3),(s,3)")
def _without(dtheta: Array, dvel: Array, gyro: Array, accel: Array, new_dtheta: Array, new_dvel: Array) -> None:
    """Fill in the increments of an epoch without the biases of gyro and accelerometer, per increment."""
    for i in range(len(dtheta)):
        put_row(subtract(row(dtheta, i), vector(gyro)), new_dtheta, i)
        put_row(subtract(row(dvel, i), vector(accel)), new_dvel, i)


def refuse_navigation(task: Task, what: str) -> None:
    """Check that a task wants no more than an attitude; ``what`` names the estimator.

    Raises:
        ValueError: the task navigates.
    """
    if task.navigate:
        raise ValueError(
            f"{what} gives the attitude alone; {task.id} navigates: allowed are the solvers made of a filter"
        )
