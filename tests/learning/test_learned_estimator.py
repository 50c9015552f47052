"""The learned estimator of the examples, with NumPy alone: its network, its weights, and what it answers to noise told wrong."""

import math
import sys
from dataclasses import replace

import numpy as np
import pytest
from places import ROOT

import solvers
from sins_env.evaluation import get_task
from solvers.filters.kalman.inekf import InEKF
from solvers.types import Gaussian, Linear, Measurement, Transition

PACKAGE = ROOT / "examples" / "learned_estimator"
RUNS, SEED = 4, 24
STORED = [3.8160956, 0.58504314, -11.876189]  #: answers of the packaged weights to the fixes of the first test


@pytest.fixture(scope="module")
def learned():
    """The package, as if it were installed; PyTorch is not asked for."""
    sys.path.insert(0, str(PACKAGE))
    try:
        import learned_noise
        import learned_noise.network

        yield learned_noise
    finally:
        sys.path.remove(str(PACKAGE))


def play(name, solver, epochs=60, row=None):
    """Play the first epochs of a task, all runs together or the one of a row alone; return the answers (epochs, ..., 4)."""
    task = get_task(name)
    env = task.make(RUNS)
    obs, _ = task.reset(env, range(RUNS), SEED)
    public = env.unwrapped.task
    rngs = [np.random.default_rng(i) for i in range(RUNS)]
    if row is None:
        solver.reset(public, rngs, RUNS)
    else:
        solver.reset(replace(public, start=type(public.start)(*(part[row] for part in public.start))), rngs[row])
    answers, still = [], np.tile([1.0, 0.0, 0.0, 0.0], (RUNS, 1))
    for _ in range(epochs):
        answers.append(solver.step(obs if row is None else {key: value[row] for key, value in obs.items()}))
        obs = env.step(still)[0]
    env.close()
    return np.array(answers)


def test_the_network_is_the_one_of_its_equations(learned):
    """Against loops over the gates, with the packaged weights; and what these answered when they were made."""
    network = learned.network
    W = network.read(PACKAGE / "learned_noise" / "weights.npz")
    fixes = np.random.default_rng(1).normal(size=(40, 3)) * np.r_[np.ones(20), 10.0 * np.ones(20)][:, None]
    memory, state, last, trend = network.blank(()), [0.0] * network.SIZE, np.zeros(3), np.zeros(3)
    for e in fixes:
        answer, memory = network.answer(np, W, memory, e, np.float64(0.3))
        cosines = [np.dot(e, a) / math.sqrt(np.dot(e, e) * np.dot(a, a) + 1e-6) for a in (last, trend)]
        trend = 0.9 * trend + 0.1 * e
        x = [math.log(v + 1e-6) / 4 for v in (np.dot(e, e) / 3, 0.3, np.dot(trend, trend) / 3 * 19)] + cosines
        gates = [1 / (1 + math.exp(-sum(row * [*x, *state, 1.0]))) for row in W["gates"]]
        update, reset = gates[: network.SIZE], gates[network.SIZE :]
        held = [r * s for r, s in zip(reset, state, strict=True)]
        new = [math.tanh(sum(row * [*x, *held, 1.0])) for row in W["candidate"]]
        state = [(1 - z) * s + z * c for z, s, c in zip(update, state, new, strict=True)]
        last = e
    expected = [m * math.tanh(sum(row * [*state, 1.0])) for m, row in zip((12, 8, 16), W["answer"], strict=True)]
    np.testing.assert_allclose(answer, expected, rtol=1e-9)
    np.testing.assert_allclose(answer, STORED, rtol=1e-6)


def test_its_answer_does_not_depend_on_the_axes(learned):
    network = learned.network
    W = network.read(PACKAGE / "learned_noise" / "weights.npz")
    turn, _ = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))
    one = other = network.blank(())
    for e in np.random.default_rng(3).normal(size=(30, 3)):
        here, one = network.answer(np, W, one, e, np.float64(0.1))
        there, other = network.answer(np, W, other, turn @ e, np.float64(0.1))
    np.testing.assert_allclose(here, there, rtol=1e-9)


def test_without_an_answer_it_is_the_invariant_filter(learned, tmp_path):
    network = learned.network
    rng = np.random.default_rng(4)
    weights = {name: rng.normal(size=shape) for name, shape in network.SHAPES.items()}
    np.savez(tmp_path / "told.npz", **{**weights, "answer": 0.0 * weights["answer"]})
    told = play("sway-jump-v0", learned.LearnedNoise(weights=str(tmp_path / "told.npz")))
    assert (told == play("sway-jump-v0", solvers.make("inekf"))).all()


def test_it_finds_that_the_told_noise_of_the_fixes_is_wrong(learned):
    """The true variance is a hundredth of the told one there, and the told one here; and a row has the bits of its run alone."""
    wrong, right = learned.LearnedNoise(), learned.LearnedNoise()
    play("sway-told-wrong-v0", wrong, 200)
    together = play("sway-white-v0", right, 200)
    factors = [solver.diagnostics()["R_factor"] for solver in (wrong, right)]
    assert (factors[0] < 0.05).all(), factors
    assert ((factors[1] > 0.3) & (factors[1] < 3.0)).all(), factors
    assert (play("sway-white-v0", right, 200, row=2) == together[:, 2]).all()


def test_what_it_refuses(learned, tmp_path):
    task = get_task("inmotion-car-v0").make(1).unwrapped.task
    with pytest.raises(ValueError, match="navigates"):
        learned.LearnedNoise().reset(task, np.random.default_rng(0))
    aided = get_task("sway-white-v0").make(1, aids={"heading": {}}).unwrapped.task
    with pytest.raises(ValueError, match="with the aids heading; allowed"):
        learned.LearnedNoise().reset(aided, np.random.default_rng(0))
    np.savez(tmp_path / "other.npz", gates=np.zeros((2, 2)))
    with pytest.raises(ValueError, match=r"other.npz holds \{'gates': \(2, 2\)\}; allowed: \{'gates': \(48, 30\)"):
        learned.LearnedNoise(weights=str(tmp_path / "other.npz"))


def test_its_factors_scale_the_told_noises(learned, tmp_path):
    """Constant answers, R twice as large and Q thrice and five times: as if the invariant filter were told these noises."""
    network, rng = learned.network, np.random.default_rng(5)
    weights = {name: np.zeros(shape) for name, shape in network.SHAPES.items()}
    weights["answer"][:, -1] = np.arctanh(np.log([2.0, 3.0, 5.0]) / network.LIMITS)
    np.savez(tmp_path / "constant.npz", **weights)
    one = learned.LearnedNoise(weights=str(tmp_path / "constant.npz")).filter
    f, h = Linear(rng.normal(size=(12, 12))), Linear(rng.normal(size=(3, 12)))
    Q, R, z = np.eye(12), np.diag([1.0, 2.0, 3.0]), rng.normal(size=3)
    told, scaled = Transition(f, Q), Transition(f, np.diag(np.repeat([3.0, 5.0, 1.0, 1.0], 3)))
    prior = Gaussian(np.zeros(12), np.eye(12))
    b, _ = one.step(one.init(prior, None), told, Measurement(z, h, R))
    b, _ = one.step(b, told, Measurement(z, h, R))
    other = InEKF()
    c, _ = other.step(other.init(prior), told, Measurement(z, h, 2.0 * R))
    c, _ = other.step(c, scaled, Measurement(z, h, 2.0 * R))
    np.testing.assert_allclose(b.mean, c.mean, rtol=1e-9)
    np.testing.assert_allclose(b.cov, c.cov, rtol=1e-9)
