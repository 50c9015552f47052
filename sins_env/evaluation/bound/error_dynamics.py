"""Linear error dynamics at the truth, for the Cramer-Rao bound. docs/mathematics/bound.md#error-dynamics.

    x = [dV (E, N, U) | phi (E, N, U) | dp (E, N, U) | nabla (R, F, U) | eps (R, F, U)]      SI, dp in metres

    dV'  = f x phi + C nabla - (2 omega_ie + omega_en) x dV - (2 domega_ie + domega_en) x V + dg
    phi' = -omega_in x phi + domega_ie + domega_en - C eps                   omega_en = T V, domega_en = T dV + (dT) V
    dp'  = dV + [(V_E tan L dp_N - V_E dp_U + (V_U - V_N tan L) dp_E) / (R_N + h), (V_U dp_N - V_N dp_U) / (R_M + h), 0]

dp is the difference of the coordinates in metres, by the radii at the truth; so it is scored. Its small terms follow from
d((R_N + h) cos L) / dL = -(R_M + h) sin L. Biases are constant, Gauss-Markov, or both. C, f, V and the place are true means
over an epoch. The solvers have error dynamics of their own on purpose; tests compare the two.

A base that does not travel has the same dynamics without the rows and columns of dV_U and dp. Only the horizontal
velocity of its fixes enters. Vertical velocity and position would lower the bound of azimuth by 0.2 % on sway-white and
by 1 % on sway-told-wrong. On the latter they would lower that of level by up to 14 %. The verdict is on azimuth
(metrics.py).

States are not scaled: matrix products and Joseph's form do not depend on units. Scaling by powers of two would not change
one bit.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np

from sins_env import attitude, earth
from sins_env.arrays import Array, Mask
from sins_env.evaluation.bound.aids import Instant, term
from sins_env.evaluation.bound.fisher import fix_noise
from sins_env.evaluation.tasks.task import EvaluationTask, run_numbers
from sins_env.sensors.gps import Gps, ZeroVelocity
from sins_env.specs import ImuSpec
from sins_env.states import ERRORS, FIX, Block, Layout, answered
from sins_env.types import Task
from sins_env.units import DEG, DEG_PER_H, UG
from sins_env.worlds.simulated import SimulatedWorld

CHUNK_EPOCHS = 100
CORE = ERRORS.only("dv", "phi", "dp")  #: states before those of the biases
AT_REST = Layout((Block("dv", 2, "m/s"), Block("phi", 3, "rad")))  #: the same states for a base that does not travel
DV, PHI, DP = (CORE[name] for name in CORE.names)
UNKNOWN_ATTITUDE_STD = math.pi / math.sqrt(3.0)  #: rad, standard deviation of an angle uniform over the circle
UNKNOWN_VELOCITY_STD = 10.0  #: m/s, standard deviation of an unknown velocity
STEP_RAD, STEP_M = 1e-4, 100.0  #: steps of the central differences in latitude and height, which are exact to 1e-8


class Truth(NamedTuple):
    """True motion of some runs over some epochs."""

    first: int  #: number of epochs before these
    C: Array  #: (runs, epochs, 3, 3) C_nb, mean over the epoch
    force: Array  #: (runs, epochs, 3) specific force in n, m/s^2, mean over the epoch
    vel: Array  #: (runs, epochs, 3) velocity in n, m/s, mean over the epoch
    pos: Array  #: (runs, epochs, 3) latitude rad, longitude rad, height m, mean over the epoch
    C_end: Array  #: (runs, epochs, 3, 3) C_nb at the end of the epoch
    rate_end: Array  #: (runs, epochs, 3) omega_eb^b at the end of the epoch, rad/s
    fix: Mask  #: (epochs,) whether there is a fix at the end
    vel_end: Array  #: (runs, epochs, 3) velocity in n at the end of the epoch, m/s
    age: Array  #: (epochs,) s, how old a fix is at the end of the epoch


class Reading(NamedTuple):
    """What a sensor beside the IMU shows in some epochs."""

    name: str  #: "fix", or that of the aid
    there: Mask  #: (epochs,) which epochs end with one
    H: Array  #: (runs, epochs, m, n)
    R: Array  #: (m, m)


FIXES = "fix"  #: name of the readings of the receiver


def simulated(task: EvaluationTask) -> tuple[Task, SimulatedWorld] | None:
    """Return what a task tells, and its world; None if it has no bound.

    A recording has no simulated truth. Zero-velocity updates have none either, because no noise model describes how far a
    parked car moves.
    """
    if task.windows:
        return None
    env: Any = task.make(1)
    public, world = env.unwrapped.task, env.unwrapped.episode.world
    env.close()
    if not isinstance(world, SimulatedWorld) or isinstance(world.gps, ZeroVelocity):
        return None
    return public, world


def true_motion(
    task: EvaluationTask, public: Task, runs: int | Iterable[int], suite_seed: int | None = None
) -> Iterator[Truth]:
    """Yield the truth of runs of the suite in chunks. Means are by Simpson's rule, from states at half epochs.

    Args:
        task: a simulated task.
        public: what its environment tells.
        runs: number of runs, or their numbers.
        suite_seed: seed of the suite; None takes that of the task.
    """
    h, wanted = public.epoch_s, run_numbers(runs)
    env: Any = task.make(len(wanted), epoch=0.5 * h, n_sub=1, reveal_truth=True)
    _, info = task.reset(env, wanted, suite_seed)
    world: SimulatedWorld = env.unwrapped.episode.world
    model = earth.get(public.site.earth)
    gps = Gps(world.gps.spec, h, public.duration_s, model)
    last = [info["truth"][name][:, None] for name in ("q_nb", "vel", "pos")]
    for first in range(0, public.num_epochs, CHUNK_EPOCHS):
        count = min(CHUNK_EPOCHS, public.num_epochs - first)
        motion = world.trajectory.chunk(2 * first, 2 * count)
        fix, age = gps.schedule(first, count)
        q, vel, pos = (np.concatenate([a, b], axis=1) for a, b in zip(last, motion.state, strict=True))
        last = [part[:, -1:] for part in (q, vel, pos)]
        C = attitude.to_dcm(q)
        mean = [x[:, :-2:2] / 6 + x[:, 1:-1:2] * (2 / 3) + x[:, 2::2] / 6 for x in (C, vel, pos)]
        force = (vel[:, 2::2] - vel[:, :-2:2]) / h + _apparent(model, mean[1], mean[2])
        rate, end = motion.rate_eb_b[:, 1::2], vel[:, 2::2]
        yield Truth(first, mean[0], force, mean[1], mean[2], C[:, 2::2], rate, fix, end, age)
    env.close()


def _apparent(model: earth.Earth, vel: Array, pos: Array) -> Array:
    """Return specific force minus V', which is (2 omega_ie + omega_en) x V - g."""
    rate_ie, rate_en = _rates(model, vel, pos)
    out: Array = np.cross(2 * rate_ie + rate_en, vel)
    out[..., 2] += earth.gravity(model, pos[..., 0], pos[..., 2])
    return out


def _rates(model: earth.Earth, vel: Array, pos: Array) -> tuple[Array, Array]:
    """Return omega_ie and omega_en in n, rad/s."""
    T = earth.transport_matrix(model, pos[..., 0], pos[..., 2])
    return earth.rate_n(model, pos[..., 0]), np.matmul(T, vel[..., None])[..., 0]


class _Bias(NamedTuple):
    """One kind of bias of the three gyros or of the three accelerometers."""

    name: str
    gyro: bool
    std: float  #: standard deviation, rad/s or m/s^2
    time_constant_s: float  #: correlation time; inf for a constant bias

    @property
    def block(self) -> Block:
        return Block(self.name, 3, "rad/s" if self.gyro else "m/s^2")


def _biases(imu: ImuSpec) -> list[_Bias]:
    """Return the kinds of bias that the IMU has.

    Scale factors, misaligned axes and quantisation count as known, which leaves the bound a lower one.
    """
    kinds = [
        _Bias("accel_bias", False, imu.accel_bias_ug * UG, math.inf),
        _Bias("accel_markov", False, imu.accel_markov_ug * UG, imu.accel_markov_s),
        _Bias("gyro_bias", True, imu.gyro_bias_deg_h * DEG_PER_H, math.inf),
        _Bias("gyro_markov", True, imu.gyro_markov_deg_h * DEG_PER_H, imu.gyro_markov_s),
    ]
    return [kind for kind in kinds if kind.std]


class ErrorDynamics:
    """Linear model of a world's errors: F, Q, H, R, and P at the start.

    ``states`` is the layout of the bound's states. The dynamics are written down for the layout ``full``; a base that does
    not travel keeps only a part of it.
    """

    def __init__(self, world: SimulatedWorld) -> None:
        imu, gps, prior, site = world.imu.spec, world.gps.spec, world.task.prior, world.task.site
        self.epoch_s, self.earth, self.lever = world.task.epoch_s, earth.get(site.earth), np.asarray(gps.lever_arm_m)
        self.travels, self.script = world.task.navigate, world.imu.script
        kinds = _biases(imu)
        blocks = [kind.block for kind in kinds]
        self.aids = {name: (aid, term(aid.spec, self.epoch_s)) for name, aid in world.aids.items()}
        own = [one for _, aid in self.aids.values() for one in aid.states()]
        blocks += [one.block for one in own]
        self.full = CORE.plus(*blocks)
        at_rest = CORE.only("dv", "phi") if self.aids else AT_REST  # aids show the vertical velocity, too
        self.states = self.full if self.travels else at_rest.plus(*blocks)
        self.n, self.kept = self.states.size, self.full.places(self.states)
        self.biases = [(self.full[kind.name], kind) for kind in kinds]
        self.own = [(self.full[one.block.name], one) for one in own]
        std, drive = np.zeros((2, self.full.size))
        known = world.settings.start == "told"
        std[DV] = prior.velocity_std_mps if known else UNKNOWN_VELOCITY_STD
        std[PHI] = np.asarray(prior.attitude_std_deg) * DEG if known else UNKNOWN_ATTITUDE_STD
        std[DP] = prior.position_std_m
        drive[DV], drive[PHI] = imu.vrw**2, imu.arw**2
        spreads = [(states, kind.std, kind.time_constant_s) for states, kind in self.biases]
        for states, sigma, tau in [*spreads, *((states, one.std, one.time_constant_s) for states, one in self.own)]:
            std[states] = sigma
            drive[states] = 2 * np.square(sigma) / tau
        for states, one in self.own:
            if one.dynamics is not None:
                drive[states] = one.dynamics[1]
        shown = [name for name in FIX.names if name in self.states and (gps.velocity or name != "dv")]
        self.shown = FIX.places(self.states.only(*shown))
        self.P0, self._drive = np.diag(std[self.kept] ** 2), drive
        self.driven = drive[self.kept]  #: (n,) densities of the white noise of the states, before any wave
        self.R = fix_noise(gps)[np.ix_(self.shown, self.shown)]
        self.scored = self.states.places(answered(self.travels))  #: indices of phi, or phi, velocity and position

    def densities(self, truth: Truth) -> Array:
        """Return the densities (epochs, n) of the white noise that drives the states, in their units squared per second."""
        count = len(truth.fix)
        drive = np.repeat(self._drive[None], count, axis=0)
        for states, wave in ((DV, self.script.accel_wave), (PHI, self.script.gyro_wave)):
            if wave:
                drive[:, states] *= wave.rms(truth.first, count, self.epoch_s)[:, None] ** 2
        return drive[:, self.kept]

    def noise(self, truth: Truth, F: Array) -> Array:
        """Return Q (runs, epochs, n, n); half of the white noise of an epoch goes through F, half does not."""
        D = self.densities(truth)[..., None] * np.eye(self.n)
        return 0.5 * self.epoch_s * (D + F @ D @ F.mT)

    def transitions(self, truth: Truth) -> Array:
        """Return F (runs, epochs, n, n), the exponential of the mean dynamics to third order."""
        A = self.dynamics(truth) * self.epoch_s
        A2 = A @ A
        F: Array = np.eye(self.n) + A + A2 / 2 + A2 @ A / 6
        return F

    def dynamics(self, truth: Truth) -> Array:
        """Return the mean of A in x' = A x over each epoch, (runs, epochs, n, n)."""
        skew, vel = attitude.skew, truth.vel
        T = earth.transport_matrix(self.earth, truth.pos[..., 0], truth.pos[..., 2])
        rate_ie, rate_en = _rates(self.earth, vel, truth.pos)
        A = np.zeros((*vel.shape[:-1], self.full.size, self.full.size))
        A[..., DV, DV] = skew(vel) @ T - skew(2 * rate_ie + rate_en)
        A[..., DV, PHI] = skew(truth.force)
        A[..., PHI, DV] = T
        A[..., PHI, PHI] = -skew(rate_ie + rate_en)
        for states, kind in self.biases:
            A[..., PHI if kind.gyro else DV, states] = -truth.C if kind.gyro else truth.C
            A[..., states, states] = -np.eye(3) / kind.time_constant_s
        for states, one in self.own:
            own = -np.eye(one.block.size) / one.time_constant_s
            A[..., states, states] = own if one.dynamics is None else one.dynamics[0]
        if self.travels:
            self._add_position(A, truth)
        return A[..., self.kept[:, None], self.kept]

    def _add_position(self, A: Array, truth: Truth) -> None:
        """Add the columns and rows of dp to A in place: what it drives, and what drives it."""
        vel, pos = truth.vel, truth.pos
        R_M, R_N = (radius + pos[..., 2] for radius in earth.radii(self.earth, pos[..., 0]))
        E, N, U = range(DP.start, DP.stop)
        for state, axis, step, metres in ((N, 0, STEP_RAD, STEP_RAD * R_M), (U, 2, STEP_M, STEP_M)):
            ahead, behind = pos.copy(), pos.copy()
            ahead[..., axis] += step
            behind[..., axis] -= step
            scale = 0.5 / np.asarray(metres)[..., None]
            (ie, en), (ie_behind, en_behind) = (_rates(self.earth, vel, place) for place in (ahead, behind))
            A[..., PHI, state] = (ie + en - ie_behind - en_behind) * scale
            A[..., DV, state] = (_apparent(self.earth, vel, behind) - _apparent(self.earth, vel, ahead)) * scale
        A[..., DP, DV] = np.eye(3)
        (east, north, up), tan = np.moveaxis(vel, -1, 0), np.tan(pos[..., 0])
        A[..., E, E], A[..., E, N], A[..., E, U] = (up - north * tan) / R_N, east * tan / R_N, -east / R_N
        A[..., N, N], A[..., N, U] = up / R_M, -north / R_M

    def readings(self, truth: Truth) -> list[Reading]:
        """Return what the receiver shows, and then each aid."""
        t = np.arange(truth.first + 1, truth.first + 1 + len(truth.fix), dtype=np.float64) * self.epoch_s
        at = Instant(truth.C_end, truth.vel_end, truth.rate_end, truth.pos, t)
        found = [Reading(FIXES, truth.fix, self.sensitivity(truth), self.R)]
        places = {"phi": [PHI], "dv": [DV], "dp": [DP], "rate": [states for states, kind in self.biases if kind.gyro]}
        for aid_name, (aid, aid_term) in self.aids.items():
            variances = aid_term.noise()
            H = np.zeros((*truth.vel.shape[:-1], len(variances), self.full.size))
            for name, slope in aid_term.rows(at).items():
                for states in places[name] if name in places else [self.full[name]]:
                    H[..., states] = slope
            there = aid.present(truth.first, H.shape[1])
            found.append(Reading(aid_name, there, H[..., self.kept], np.diag(variances)))
        return found

    def sensitivity(self, truth: Truth) -> Array:
        """Return H (runs, epochs, m, n) of a fix at the antenna: V + C (omega_eb x lever arm), and p + C lever arm.

        A fix that was made before the end of its epoch shows the errors of that time, to second order in its age.
        """
        H = np.zeros((*truth.vel.shape[:-1], FIX.size, self.full.size))
        vel, pos = FIX["dv"], FIX["dp"]
        H[..., vel, DV] = H[..., pos, DP] = np.eye(3)
        if self.lever.any():
            C, skew = truth.C_end, attitude.skew
            H[..., vel, PHI] = skew(np.matmul(C, np.cross(truth.rate_end, self.lever)[..., None])[..., 0])
            H[..., pos, PHI] = skew(C @ self.lever)
            for states, kind in self.biases:
                if kind.gyro:
                    H[..., vel, states] = -(C @ skew(self.lever))
        H = H[..., self.shown[:, None], self.kept]
        if not truth.age.any():
            return H
        back = -truth.age[:, None, None] * self.dynamics(truth)
        return H @ (np.eye(self.n) + back + back @ back / 2)
