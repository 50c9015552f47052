"""sins_env: the filters of the zoo, batch first."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from peers.contest import UKF, Block, Entry
from peers.problem import Problem
from solvers.filters import make_filter
from solvers.types import Gaussian, Linear, Measurement, Transition

SETTINGS: dict[str, dict[str, Any]] = {"kf": {}, "ekf": {}, "ukf": UKF, "ckf": {}}


def filter_runs(name: str, problem: Problem, runs: int) -> Block:
    """Make the block of one of our filters, all runs as one batch."""
    filter, alone = make_filter(name, **SETTINGS[name]), runs == 1
    which: Any = 0 if alone else slice(0, runs)
    fs = [Linear(F) for F in problem.F[:, which]] if name == "kf" else problem.maps(which)
    h = Linear(problem.H)
    epochs = [
        (Transition(f, problem.Q), Measurement(z, h, problem.R)) for f, z in zip(fs, problem.z[:, which], strict=True)
    ]
    prior = Gaussian(np.zeros(problem.z[0, which].shape[:-1] + problem.mean.shape), problem.P0)

    def block() -> Gaussian:
        belief = filter.init(prior, None)
        for transition, fix in epochs:
            belief, _ = filter.step(belief, transition, fix)
        end = filter.estimate(belief)
        return Gaussian(end.mean[None], end.cov[None]) if alone else end

    return block


def entries() -> list[Entry]:
    """Return our filters."""
    return [
        Entry(name.upper(), "Numba", "all points and runs at once", partial(filter_runs, name), batched=True)
        for name in SETTINGS
    ]
