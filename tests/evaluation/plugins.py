"""Small estimators, good and bad, for the tests. As plug-ins may, they import nothing of the evaluation."""

import dataclasses
import multiprocessing
import os
import re
import signal
import time
from functools import partial

import numpy as np
from threadpoolctl import threadpool_info

from sins_env.types import NavState

EARTH_RATE = 7.292115e-5


def product(q, p):
    """Hamilton product of quaternions (..., 4); kernels would cost each process that plays one half a second."""
    real = q[..., :1] * p[..., :1] - np.sum(q[..., 1:] * p[..., 1:], axis=-1, keepdims=True)
    return np.concatenate(
        [real, q[..., :1] * p[..., 1:] + p[..., :1] * q[..., 1:] + np.cross(q[..., 1:], p[..., 1:])], axis=-1
    )


def turn(rotvec):
    """Quaternion (..., 4) of a rotation vector, rad."""
    half = 0.5 * np.linalg.norm(rotvec, axis=-1, keepdims=True)
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * rotvec], axis=-1)


class DeadReckoning:
    """The told attitude, carried on by the gyros."""

    batched = True

    def reset(self, task, rng, num_runs=1):
        self.task, self.k = task, 0
        self.q = np.array([1.0, 0.0, 0.0, 0.0]) if task.start is None else task.start.q_nb.copy()
        lat, angle = task.site.latitude, -EARTH_RATE * task.epoch_s
        self.earth = turn(angle * np.array([0.0, np.cos(lat), np.sin(lat)]))
        if task.start is None and num_runs > 1:
            self.q = np.tile(self.q, (num_runs, 1))

    def step(self, obs):
        self.k += 1
        self.q = product(self.earth, product(self.q, turn(obs["dtheta"].sum(axis=-2))))
        return self.q.copy()

    def covariance(self):
        return np.broadcast_to(np.diag(np.radians([1.0, 1.0, 15.0]) ** 2), (*self.q.shape[:-1], 3, 3)).copy()


class Told:
    """The told attitude for ever: the cheapest estimator there is."""

    batched = True

    def reset(self, task, rng, num_runs=1):
        self.q = task.start.q_nb

    def step(self, obs):
        return self.q


class OneByOne(DeadReckoning):
    """The same, one run at a time, without a covariance."""

    batched = False
    covariance = property()


class Noisy(DeadReckoning):
    """Draws from its rng, one stream per run, at every epoch."""

    def reset(self, task, rng, num_runs=1):
        super().reset(task, rng, num_runs)
        self.rngs = [rng] if isinstance(rng, np.random.Generator) else list(rng)

    def step(self, obs):
        q = super().step(obs)
        draws = np.array([rng.standard_normal(4) for rng in self.rngs])
        return q + 1e-3 * draws.reshape(q.shape)


class At(DeadReckoning):
    """Misbehaves at an epoch in the run whose told attitude is ``q`` (in every run without one)."""

    def __init__(self, q=None, epoch=5, how="raise", batched=True):
        self.target, self.epoch, self.how, self.batched = q, epoch, how, batched

    def step(self, obs):
        q = super().step(obs)
        starts = np.atleast_2d(self.task.start.q_nb)
        hit = np.ones(len(starts), bool) if self.target is None else np.abs(starts - self.target).max(1) < 1e-12
        if self.k != self.epoch or not hit.any():
            return q
        if self.how == "raise":
            raise ArithmeticError("no square\nroot")
        if self.how == "exit":
            raise SystemExit(3)
        if self.how == "interrupt":
            raise KeyboardInterrupt
        if self.how == "kill":
            os.kill(os.getpid(), signal.SIGKILL)
        if self.how == "leave":
            os._exit(3)
        if self.how == "hang":  # in C: the interpreter is free
            while True:
                time.sleep(3600)
        if self.how == "stuck":  # in C: the interpreter is not
            re.match("(a*)*b", "a" * 1000)
        if self.how == "shape":
            return q[..., :3]
        if self.how == "text":
            return "no idea"
        q[hit if q.ndim == 2 else ...] = {"nan": np.nan, "zero": 0.0}[self.how]
        return q


class Once(At):
    """Plays once: a second ``reset`` raises, so that whoever promises a new estimator must make one."""

    used = False

    def reset(self, task, rng, num_runs=1):
        if self.used:
            raise RuntimeError("used before")
        self.used = True
        super().reset(task, rng, num_runs)


class UnknownAt(At):
    """The same in every run, after an unknown start, at the last epoch."""

    def __init__(self, how):
        super().__init__(how=how)

    def reset(self, task, rng, num_runs=1):
        super().reset(task, rng, num_runs)
        self.epoch, self.task = task.num_epochs, dataclasses.replace(task, start=NavState(self.q, None, None))


class DiesOnce(DeadReckoning):
    """Its worker is killed, the first time only."""

    def __init__(self, marker):
        self.marker = marker

    def reset(self, task, rng, num_runs=1):
        super().reset(task, rng, num_runs)
        try:
            os.remove(self.marker)
        except FileNotFoundError:
            return
        os.kill(os.getpid(), signal.SIGKILL)


class Leaves(DeadReckoning):
    """Ends its process at the fifth epoch, with a code of its own."""

    def step(self, obs):
        q = super().step(obs)
        if self.k == 5:
            os._exit(7)
        return q


class Burns(DeadReckoning):
    """Takes some CPU time at each epoch, and sleeps for as long."""

    def __init__(self, seconds=2e-3):
        self.seconds = seconds

    def step(self, obs):
        end = time.process_time() + self.seconds
        while time.process_time() < end:
            pass
        time.sleep(self.seconds)
        return super().step(obs)


class Readings:
    """A clock that counts its readings in a file, so that all processes have the same time."""

    def __init__(self, path):
        self.path = path

    def __call__(self):
        with open(self.path, "r+") as file:
            count = int(file.read() or 0) + 1
            file.seek(0)
            file.write(str(count))
        return float(count)


class Reads(DeadReckoning):
    """Takes so many readings of that clock at each epoch. With ``lies`` the clock of its own process then stands still."""

    def __init__(self, path, readings=0, lies=False):
        self.read, self.readings = partial(Readings.__call__, Readings(path)), readings
        if lies:
            Readings.__call__ = lambda self: 0.0

    def step(self, obs):
        for _ in range(self.readings):
            self.read()
        return super().step(obs)


class Lost(DeadReckoning):
    """Never a good attitude: upside down."""

    def step(self, obs):
        return product(super().step(obs), np.array([0.0, 1.0, 0.0, 0.0]))


class Slow(DeadReckoning):
    def __init__(self, seconds=0.05, last=None):
        self.seconds, self.last = seconds, last

    def step(self, obs):
        time.sleep(self.seconds)
        if self.k == self.last:
            raise ArithmeticError("too late")
        return super().step(obs)


class CountsThreads(DeadReckoning):
    """Raises where BLAS has more than one thread, asked at every tenth epoch, for that takes a while."""

    k = 0

    def step(self, obs):
        if self.k % 10:
            return super().step(obs)
        most = max(pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas")
        if most > 1:
            raise ArithmeticError(f"{most} BLAS threads")
        return super().step(obs)


class TellsWhere(Slow):
    """Leaves a file with the number of its process at its tenth epoch."""

    def __init__(self, folder, seconds):
        super().__init__(seconds)
        self.folder = folder

    def step(self, obs):
        if self.k == 9:
            open(os.path.join(self.folder, str(os.getpid())), "w").close()
        return super().step(obs)


class KillsAfter(DeadReckoning):
    """Kills its process once there are as many files as ``runs`` in a folder; leaves one itself."""

    def __init__(self, folder, runs):
        self.folder, self.runs = folder, runs

    def reset(self, task, rng, num_runs=1):
        super().reset(task, rng, num_runs)
        if len(os.listdir(self.folder)) >= self.runs:
            os.kill(os.getpid(), signal.SIGKILL)
        open(os.path.join(self.folder, str(len(os.listdir(self.folder)))), "w").close()


class TellsProcess(DeadReckoning):
    """Ends a process that is no worker."""

    def reset(self, task, rng, num_runs=1):
        super().reset(task, rng, num_runs)
        if multiprocessing.parent_process() is None:
            os._exit(4)


class Vandal(DeadReckoning):
    """Overwrites whatever it is given and has given, and changes how NumPy treats errors."""

    covariance = property()
    given = None

    def __init__(self, batched=True):
        self.batched = batched

    def reset(self, task, rng, num_runs=1):
        super().reset(task, rng, num_runs)
        for part in task.start:
            part[...] = 7.0
        np.seterr(all="raise")

    def step(self, obs):
        q = super().step(obs)
        for value in obs.values():
            value[...] = 1
        if self.given is None:
            self.given = np.empty_like(q)
        self.given[...] = q
        np.seterr(all="raise")
        return self.given


class BadProperty(DeadReckoning):
    """Raises when it is asked whether it has a ``covariance`` or ``health``."""

    def __init__(self, name):
        self.name = name

    def __getattribute__(self, name):
        if name in ("covariance", "health") and name == object.__getattribute__(self, "name"):
            raise ArithmeticError(f"no {name}")
        return object.__getattribute__(self, name)


class Base(BaseException):
    pass


class RaisesBase(DeadReckoning):
    def step(self, obs):
        raise Base("beyond Exception")


class HangsIn(DeadReckoning):
    """Hangs in ``reset``, ``covariance`` or ``health``."""

    def __init__(self, when):
        self.when = when

    def _perhaps(self, here):
        while self.when == here:
            time.sleep(3600)

    def reset(self, task, rng, num_runs=1):
        self._perhaps("reset")
        super().reset(task, rng, num_runs)

    def covariance(self):
        self._perhaps("covariance")
        return super().covariance()

    def health(self):
        self._perhaps("health")
        return Health(0, -1, 0)


class BadReset(DeadReckoning):
    def reset(self, task, rng, num_runs=1):
        raise RuntimeError("no memory left")


class BadCovariance(DeadReckoning):
    def covariance(self):
        return np.eye(4)


class Health:
    def __init__(self, repairs, failed_at, fallbacks):
        self.repairs, self.failed_at, self.fallbacks = np.array(repairs), np.array(failed_at), fallbacks


class Ailing(DeadReckoning):
    """Reports two repairs in the first run of a batch, five fallbacks in the second, and that it gave up the last at epoch 20."""

    def health(self):
        runs = len(np.atleast_2d(self.q))
        return Health([2] + [0] * (runs - 1), [-1] * (runs - 1) + [20], [0, 5, *[0] * runs][:runs])


# What check_estimator must name.
class ChangesObservations(DeadReckoning):
    def step(self, obs):
        obs["dtheta"][...] = 0.0
        return super().step(obs)


class ChangesTask(DeadReckoning):
    def reset(self, task, rng, num_runs=1):
        super().reset(task, rng, num_runs)
        if task.start is not None:
            task.start.q_nb[...] = 0.5


class GlobalRandom(DeadReckoning):
    def step(self, obs):
        return super().step(obs) + 1e-12 * np.random.standard_normal()  # noqa: NPY002


class NotReset(DeadReckoning):
    q = None

    def reset(self, task, rng, num_runs=1):
        old = self.q
        super().reset(task, rng, num_runs)
        self.q = old if old is not None and old.shape == self.q.shape else self.q


class WallClock(DeadReckoning):
    def step(self, obs):
        return super().step(obs) * [1.0, 1.0 + time.perf_counter() % 1, 1.0, 1.0]


class Neighbourly(DeadReckoning):
    def step(self, obs):
        q = super().step(obs)
        return q + 1e-6 * q.mean(axis=0)


class NeedsFixes(DeadReckoning):
    def step(self, obs):
        return super().step(obs) / obs["gps_valid"].astype(float)


class NeedsStart(DeadReckoning):
    def reset(self, task, rng, num_runs=1):
        task.start.q_nb.copy()
        super().reset(task, rng, num_runs)


class Unpicklable(DeadReckoning):
    def __init__(self):
        self.f = lambda x: x


class NegativeCovariance(DeadReckoning):
    def covariance(self):
        return -super().covariance()


class KeepsAxis(DeadReckoning):
    def step(self, obs):
        return np.atleast_2d(super().step(obs))


class Nothing:
    """No estimator at all."""


class Peeking:
    """Raises with all that its generators tell of their seeds."""

    batched = True

    def reset(self, task, rng, num_runs=1):
        raise RuntimeError(f"{[(one.bit_generator.seed_seq, one.bit_generator.state) for one in rng]} {vars(task)}")

    def step(self, obs):
        raise NotImplementedError


def with_setting(gain: float = 1.0):
    """Dead reckoning, with a setting that changes nothing.

    A second paragraph.
    """
    if gain < 0:
        raise ValueError(f"gain = {gain}; allowed: not negative")
    return DeadReckoning()


def broken_factory():
    return 1 / 0


class FollowsFixes:
    """Navigation without a filter: the told attitude, and velocity and position of the last fix."""

    batched = True

    def __init__(self, velocity_mps=0.0, fail_at=0, nan_at=0, narrow_at=0):
        self.velocity_mps = velocity_mps  #: added to the velocity east
        self.fail_at, self.nan_at, self.narrow_at = fail_at, nan_at, narrow_at  #: epochs, from 1

    def reset(self, task, rng, num_runs=1):
        self.task, self.state, self.k = task, [np.array(part) for part in task.start], 0

    def step(self, obs):
        self.k += 1
        if self.k == self.fail_at:
            raise RuntimeError("no fix")
        q, vel, pos = self.state
        fixed = obs["gps_valid"] == 1
        self.state = [q, np.where(fixed, obs["gps_vel"], vel), np.where(fixed, obs["gps_pos"], pos)]
        action = np.concatenate(self.state, axis=-1)
        action[..., 4] += self.velocity_mps
        if self.k >= self.nan_at > 0:
            action[..., 9] = np.nan
        return action[..., :4] if self.k == self.narrow_at else action

    def covariance(self):
        P = self.task.prior.P0[:9, :9].copy()
        P[3:, 3:] = self.task.prior.R
        return np.broadcast_to(P, (*self.state[0].shape[:-1], 9, 9))


class FollowsFixesAlone(FollowsFixes):
    batched = False
