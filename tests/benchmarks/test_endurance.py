"""benchmarks/endurance.py: what must hold all day long holds for a while, and what does not hold is named."""

import mmap
import runpy

import numpy as np
import pytest
from evaluation.plugins import DeadReckoning
from places import ROOT

ENDURANCE = runpy.run_path(str(ROOT / "benchmarks" / "endurance.py"))
RUNS = 8


@pytest.mark.parametrize("solver", ["ckf", "inekf", "two_pass", "smoother"])
def test_what_must_hold_all_day_long(solver):
    """80 minutes in 600 epochs."""
    seen = ENDURANCE["endure"](solver, ENDURANCE["task_of"](80 / 60, 8.0), RUNS)
    assert (seen.epochs, len(seen.nees)) == (600, 24)
    assert seen.faults() == []


class Ageing(DeadReckoning):
    """Its quaternion grows, its covariance is neither symmetric nor definite, and it forgets nothing."""

    def reset(self, task, rng, num_runs=1):
        super().reset(task, rng, num_runs)
        self.past = []

    def step(self, obs):
        self.past.append(mmap.mmap(-1, 160_000))  # pages of its own, not those that earlier tests have freed
        self.past[-1].write(bytes(range(250)) * 640)
        return super().step(obs) * (1.0 + 1e-12 * self.k)

    def covariance(self):
        P = super().covariance()
        P[..., 0, 1] = 3.0 * P[..., 0, 0]
        return P


def test_what_does_not_hold_is_named():
    found = ENDURANCE["endure"](Ageing, ENDURANCE["task_of"](0.1, 1.0), RUNS).faults()
    assert [text.split(" by ")[0].split(",")[0].split(" 2")[0] for text in found] == [
        "|q| off", "P asymmetric", "P not positive definite", "NEES outside its band", "memory grew",
    ]  # fmt: skip


def test_the_band_is_that_of_chi_square():
    """Its ends are quantiles: a thousandth of many means lies outside."""
    low, high = ENDURANCE["band"](RUNS)
    means = np.random.default_rng(0).chisquare(3 * RUNS, 400_000) / (3 * RUNS)
    outside = np.mean((means < low) | (means > high))
    assert outside == pytest.approx(1e-3, abs=4 * np.sqrt(1e-3 / 400_000))
