"""Train the network: ``python -m learned_noise.train``, ten minutes on one core. This module alone needs PyTorch.

Motions come from a data set of ``sins_env``, whose seeds no suite has. The invariant filter passes over them once, and its error
model at each epoch, the matrix F, is kept. In invariant coordinates these matrices hardly depend on the errors. So errors of
start, IMU and fixes can be drawn anew in each pass, along with how wrong the told noises are:

    d <- F d + w,   nu = d_v + v,   d <- d - K nu,   with K from the told noises times the network's factors.

The loss is the negative log likelihood of the true error d of attitude and velocity under the filter's own covariance. It goes
back through the filter over ``WINDOW`` epochs, then memory and covariance are carried on without gradient. The likelihood is
that of Student's t with ``DOF`` degrees of freedom, for a run that is lost must not outweigh all others.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

import sins_env
from learned_noise import network
from learned_noise.estimator import WEIGHTS
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.types import NavState
from sins_env.units import DEG, DEG_PER_H, DEG_PER_SQRT_H, UG
from solvers.filters.kalman.inekf import InEKF
from solvers.pipeline.estimator import Aligner

TASK, SEED, MOTIONS = "sway-white-v0", 20261130, 24  #: the data set of the motions
RUNS, WINDOW, UPDATES = 128, 100, 600
RATE, LAST_RATE = 4e-3, 1e-4  #: learning rate at the start and at the end
DOF = 30.0
EVERY = 5  #: epochs from one term of the loss to the next
SAMPLES = 6  #: increments of an epoch in the data set
#: Units of phi, dv, gyro and accelerometer bias in training, in which all are about one; rad, m/s, rad/s, m/s^2.
SCALE = np.repeat([DEG, 0.1, 0.02 * DEG_PER_H, 100.0 * UG], 3)
#: Told spread of the start in these units.
SPREAD = np.array([1.0, 1.0, 15.0, 2.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Recorder(InEKF):
    """The invariant filter, which keeps the matrix F of each epoch."""

    kept: list[Any] = field(default_factory=list)

    def step(self, b: Any, tr: Any, me: Any) -> Any:
        self.kept.append(tr.f.value_and_jacobian(b.mean)[1])
        return super().step(b, tr, me)


def motions(runs: int) -> torch.Tensor:
    """Return F (runs, epochs, 12, 12) along the motions of a data set, in float32."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "motions.npz")
        sins_env.dataset(TASK, runs, file, seed=SEED, samples=SAMPLES)
        with np.load(file) as data:
            seen = {name: data[name] for name in ("dtheta", "dvel", "gps_vel", "gps_pos", "gps_valid")}
            start = NavState(*(data[f"start_{name}"] for name in NavState._fields))
    env = get_task(TASK).make(1)
    task = replace(env.unwrapped.task, n_sub=SAMPLES, start=start)
    env.close()
    recorder = Recorder()
    aligner = Aligner(recorder)
    aligner.reset(task, np.random.default_rng(0), runs)
    for k in range(task.num_epochs):
        aligner.step({name: value[:, k] for name, value in seen.items()})
    units = SCALE / aligner.states.si
    return torch.from_numpy(np.stack([(F / units[:, None] * units).astype(np.float32) for F in recorder.kept], 1))


class World:
    """Runs whose errors and wrongly told noises are drawn anew whenever one ends; each stands at its own epoch."""

    def __init__(self, F: torch.Tensor, runs: int, generator: torch.Generator) -> None:
        self.F, self.runs, self.generator = F, runs, generator
        #: Epochs (runs,) after which a run ends; the first ones end early, so that all epochs are met.
        self.left = (self.uniform(0.02, 1.0) * F.shape[1]).long()
        self.k = torch.zeros(runs, dtype=torch.long)
        self.drawn: dict[str, torch.Tensor] = {}
        self.d, self.P = torch.zeros(runs, 12), torch.zeros(runs, 12, 12)
        self.memory = network.Memory(*map(torch.as_tensor, network.blank((runs,))))
        self.log_factors = torch.zeros(runs, network.ANSWERS)
        self.begin(torch.ones(runs, dtype=torch.bool))

    def uniform(self, low: float, high: float) -> torch.Tensor:
        return low + (high - low) * torch.rand(self.runs, generator=self.generator)

    def powers(self, low: float, high: float, share: float = 1.0) -> torch.Tensor:
        """Return factors between 10^low and 10^high in a share of the runs, and 1 in the others."""
        return torch.where(self.uniform(0.0, 1.0) < share, 10.0 ** self.uniform(low, high), 1.0)

    def normal(self, *shape: int) -> torch.Tensor:
        return torch.randn(self.runs, *shape, generator=self.generator)

    def begin(self, now: torch.Tensor) -> None:
        """Draw the runs of the mask anew."""
        start = torch.as_tensor(SPREAD) * torch.ones(self.runs, 12)
        start[:, :3] *= self.powers(-1.0, 0.1)[:, None]
        start[:, 6:] *= self.powers(-0.3, 0.3)[:, None]
        fix = (10.0 ** self.uniform(-2.0, -0.7) / SCALE[3]) ** 2
        gyro = (0.01 * DEG_PER_SQRT_H / SCALE[0]) ** 2 * 0.1 * self.powers(-0.6, 0.6)
        accel = (5.0 * UG / SCALE[3]) ** 2 * 0.1 * self.powers(-0.6, 0.6)
        direction, off = self.uniform(0.0, 2 * math.pi), self.powers(-0.7, 0.7) * (self.uniform(0.0, 1.0) < 0.35)
        jump = torch.stack([torch.sin(direction), torch.cos(direction), torch.zeros(self.runs)], -1)
        begin = self.uniform(0.0, 1.0) * self.F.shape[1]
        new = {
            "motion": torch.randint(len(self.F), (self.runs,), generator=self.generator),
            "fix": fix,
            "told_fix": fix * self.powers(-1.2, 2.5, 0.5),
            "gyro": gyro,
            "told_gyro": gyro * self.powers(-2.0, 1.0, 0.5),
            "accel": accel,
            "told_accel": accel * self.powers(-1.0, 6.5, 0.4),
            "jump": off[:, None] / SCALE[3] * jump,
            "jump_begin": begin,
            "jump_end": begin + 10.0 * self.powers(0.0, 1.3),
            "share": self.uniform(0.05, 0.4) * (self.uniform(0.0, 1.0) < 0.25),
            "outlier": self.powers(0.6, 2.0),
            "dof": torch.where(self.uniform(0.0, 1.0) < 0.2, self.uniform(2.5, 6.0), math.inf),
        }
        for name, value in new.items():
            old = self.drawn.get(name, value)
            self.drawn[name] = torch.where(now.reshape(-1, *(1,) * (value.ndim - 1)), value, old)
        self.k = torch.where(now, 0, self.k)
        self.d = torch.where(now[:, None], start * self.normal(12), self.d)
        self.P = torch.where(now[:, None, None], torch.diag_embed(start**2), self.P)
        blank = torch.where(now, 0.0, 1.0)[:, None]
        self.memory = network.Memory(*(blank * part for part in self.memory))
        self.log_factors = blank * self.log_factors

    def renew(self, epochs: int) -> None:
        """Begin the runs anew that have less than so many epochs left, and forget the gradients of all."""
        self.d, self.P, self.log_factors = self.d.detach(), self.P.detach(), self.log_factors.detach()
        self.memory = network.Memory(*(part.detach() for part in self.memory))
        ends = self.k + epochs > self.left
        if ends.any():
            self.left = torch.where(ends, self.F.shape[1], self.left)
            self.begin(ends)

    def fix_errors(self) -> torch.Tensor:
        """Return the errors of the fixes (runs, 3) at this epoch."""
        w, t = self.drawn, self.k.double()
        hit = torch.where(self.uniform(0.0, 1.0) < w["share"], w["outlier"].sqrt(), 1.0)
        dof = torch.where(w["dof"] < math.inf, w["dof"], 4.0)
        chi2 = 2.0 * torch._standard_gamma(0.5 * dof, generator=self.generator)
        tail = torch.where(w["dof"] < math.inf, (dof / chi2).sqrt(), 1.0)
        inside = (t > w["jump_begin"]) & (t <= w["jump_end"])
        return (w["fix"].sqrt() * hit * tail)[:, None] * self.normal(3) + inside[:, None] * w["jump"]

    def step(self, weights: network.Weights) -> None:
        """Take one epoch of the truth and of the filter."""
        w = self.drawn
        F, factors = self.F[w["motion"], self.k].double(), self.log_factors.exp()
        noise = torch.cat([w["gyro"].sqrt()[:, None].expand(-1, 3), w["accel"].sqrt()[:, None].expand(-1, 3)], -1)
        d = (F @ self.d[..., None])[..., 0]
        d = torch.cat([d[:, :6] + noise * self.normal(6), d[:, 6:]], -1)
        Q = torch.stack([w["told_gyro"] * factors[:, 1], w["told_accel"] * factors[:, 2]], -1).repeat_interleave(3, -1)
        P = F @ self.P @ F.mT + torch.diag_embed(torch.nn.functional.pad(Q, (0, 6)))
        nu, seen, told = d[:, 3:6] + self.fix_errors(), P[:, 3:6, 3:6], w["told_fix"]
        spread = seen.diagonal(dim1=-2, dim2=-1).sum(-1) / (3.0 * told)
        e = nu / told.sqrt()[:, None]
        self.log_factors, self.memory = network.answer(torch, weights, self.memory, e, spread)
        S = seen + (told * self.log_factors[:, 0].exp())[:, None, None] * torch.eye(3)
        cross = P[:, :, 3:6]
        K = cross @ torch.linalg.inv_ex(S)[0]
        P = P - K @ cross.mT
        self.d, self.P, self.k = d - (K @ nu[..., None])[..., 0], 0.5 * (P + P.mT), self.k + 1

    def surprise(self) -> torch.Tensor:
        """Return the negative log likelihood (runs,) of the errors of attitude and velocity, up to a constant."""
        L, _ = torch.linalg.cholesky_ex(self.P[:, :6, :6])
        y = torch.linalg.solve_triangular(L, self.d[:, :6, None], upper=False)[..., 0]
        log_det = L.diagonal(dim1=-2, dim2=-1).log().sum(-1)
        return log_det + 0.5 * (DOF + 6.0) * torch.log1p((y * y).sum(-1) / DOF)


def begin_weights(generator: torch.Generator) -> dict[str, torch.Tensor]:
    """Return weights to begin with; the last layer is zero, so that the filter is the told one."""
    weights = {}
    for name, (rows, columns) in network.SHAPES.items():
        W = torch.randn(rows, columns, generator=generator) / math.sqrt(columns)
        weights[name] = (0.0 * W if name == "answer" else W).requires_grad_()
    with torch.no_grad():
        weights["gates"][: network.SIZE, -1] -= 2.0  # memories of some fixes at first
    return weights


def train(F: torch.Tensor, updates: int, seed: int) -> dict[str, np.ndarray]:
    """Return the weights after so many updates, in float32."""
    generator = torch.Generator().manual_seed(seed)
    weights, world = begin_weights(generator), World(F, RUNS, generator)
    optimizer = torch.optim.Adam(weights.values(), lr=RATE)
    decay = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, updates, LAST_RATE)
    mean, began = math.nan, time.process_time()
    for update in range(updates):
        world.renew(WINDOW)
        terms = []
        for k in range(WINDOW):
            world.step(weights)
            if (k + 1) % EVERY == 0:
                terms.append(world.surprise())
        loss = torch.stack(terms).mean()
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(weights.values(), 1.0)
        optimizer.step()
        decay.step()
        mean = loss.item() if update == 0 else mean + 0.02 * (loss.item() - mean)
        if update % 50 == 49:
            spent = time.process_time() - began
            print(f"{update + 1:5d} of {updates}  loss {mean:8.3f}  {spent:6.0f} CPU s", flush=True)
    return {name: W.detach().numpy().astype(np.float32) for name, W in weights.items()}


def main() -> None:
    """Train, and write the weights."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=WEIGHTS, help="file of the weights (default: that of the package)")
    parser.add_argument("--updates", type=int, default=UPDATES, help=f"default: {UPDATES}")
    parser.add_argument("--seed", type=int, default=0, help="seed of the weights and of all errors that are drawn")
    given = parser.parse_args()
    torch.set_num_threads(1)  # the matrices are small
    torch.set_default_dtype(torch.float64)
    np.savez(given.out, **train(motions(MOTIONS), given.updates, given.seed))


if __name__ == "__main__":
    main()
