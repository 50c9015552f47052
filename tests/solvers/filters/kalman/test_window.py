"""The sliding window, alone and of the iterated filter: Kalman filter and smoother if all is linear, else dense Gauss-Newton."""

import numpy as np
import pytest
from oracles.dense_kalman import kalman
from oracles.problems import linear, look, run_of, spd, swing
from scipy.optimize import least_squares

from solvers import smoothing
from solvers.filters import make_filter
from solvers.filters.kalman.window import WindowFilter, substitute
from solvers.types import MISSING, Gaussian, Linear, Measurement, Transition

EXACT = {"relinearise_s": 0.0, "tolerance": 0.0}


def play(f, prior, steps):
    b = f.init(prior, None)
    out = []
    for tr, me in steps:
        b, _ = f.step(b, tr, me)
        out.append(b)
    return out


@pytest.mark.parametrize("window", [7.0, 1e9])
def test_on_a_linear_problem_it_is_the_kalman_filter_and_smoother(window):
    batch = (3,)
    p = linear(3, 4, 2, batch, steps=25)
    F, H = Linear(p.F, p.c), Linear(p.H, p.d)
    steps = [(Transition(F, p.Q), None if z is None else Measurement(z, H, p.R)) for z in p.z]
    beliefs = play(WindowFilter(window, relinearise_s=6.0, iterations=2, tolerance=0.0), Gaussian(p.x, p.P), steps)
    for i in range(3):
        expected, _ = kalman(*run_of(p, (i,)))
        for b, (x, P) in zip(beliefs, expected, strict=True):
            np.testing.assert_allclose(b.now.mean[i], x, atol=1e-9)
            np.testing.assert_allclose(b.now.cov[i], P, atol=1e-9)
    assert beliefs[-1].health.epoch == 25
    smoothed = smoothing.smooth(make_filter("kf"), Gaussian(p.x, p.P), steps)
    last = beliefs[-1]
    path = substitute(last.past, last.inner)
    for mine, rts in zip(path[::-1], smoothed.mean[::-1], strict=False):
        np.testing.assert_allclose(mine, rts, atol=1e-9)
    assert len(path) == min(window, 25) + 1


def pendulum(seed, batch=(), steps=12, missing=0.3):
    rng = np.random.default_rng(seed)
    x, P, Q, R = rng.standard_normal((*batch, 4)), spd(rng, 4), 0.02 * spd(rng, 4), 0.05 * spd(rng, 2)
    z = 0.5 * rng.standard_normal((steps, *batch, 2))
    has = rng.random(steps) > missing
    has[-1] = True
    fixes = [Measurement(row, look, R) if one else None for row, one in zip(z, has, strict=True)]
    return Gaussian(x, np.broadcast_to(P, (*batch, 4, 4))), [(Transition(swing, Q), me) for me in fixes]


@pytest.mark.parametrize("window", [5.0, 1e9])
def test_a_window_is_dense_gauss_newton(window):
    """Least squares of scipy over all states of the window at once: the path, and the covariance of the last one."""
    prior, steps = pendulum(4)
    f = make_filter("iekf", window_s=window, relinearise_s=12.0, iterations=61, tolerance=0.0)
    last = play(f, prior, steps)[-1]
    b = last.window
    before, steps = b.past[0].before, steps[-len(b.past) :]
    whiten = [np.linalg.inv(np.linalg.cholesky(M)) for M in (before.cov, steps[0][0].Q)]

    def residuals(flat):
        path = flat.reshape(-1, 4)
        out = [whiten[0] @ (path[0] - before.mean)]
        for (_, me), one, two in zip(steps, path[:-1], path[1:], strict=True):
            out.append(whiten[1] @ (two - swing(one)))
            if me is not None:
                out.append(np.linalg.solve(np.linalg.cholesky(me.R), me.z - look(two)))
        return np.concatenate(out)

    path = np.array(substitute(b.past, b.inner))
    assert len(path) == min(window, 12) + 1
    best = least_squares(residuals, path.reshape(-1) + 1e-3, xtol=1e-14, ftol=1e-14, gtol=1e-12)
    np.testing.assert_allclose(path, best.x.reshape(-1, 4), atol=2e-6)
    np.testing.assert_array_equal(f.estimate(last).mean, path[-1])
    np.testing.assert_allclose(
        f.estimate(last).cov, np.linalg.inv(best.jac.T @ best.jac)[-4:, -4:], rtol=1e-4, atol=1e-7
    )
    filtered = play(WindowFilter(window, iterations=0), prior, pendulum(4)[1])[-1]
    assert np.abs(path[0] - substitute(filtered.past, filtered.inner)[0]).max() > 1e-3  # tangents matter


@pytest.mark.parametrize("window", [0.0, 0.3, 1.0])
def test_up_to_one_epoch_it_is_the_iterated_filter_to_the_bit(window):
    prior, steps = pendulum(9, (3,))
    mine, plain = (play(make_filter("iekf", **s), prior, steps) for s in ({"window_s": window}, {}))
    for one, two in zip(mine, plain, strict=True):
        np.testing.assert_array_equal(one.mean, two.mean)
        np.testing.assert_array_equal(one.cov, two.cov)
    longer = play(make_filter("iekf", window_s=1.5), prior, steps)
    assert np.abs(longer[-1].mean - plain[-1].mean).max() > 1e-6
    with pytest.raises(ValueError, match="cannot be smoothed"):
        smoothing.smooth(make_filter("iekf", window_s=1.5), prior, steps)


def turning(x):
    """An angle that stays, and what is read of it: the sine of its triple well, and its cosine badly."""
    y = x.copy()
    y[..., 1], y[..., 2] = np.sin(3.0 * x[..., 0]), np.cos(x[..., 0])
    return y


def test_other_starts_find_the_higher_maximum():
    """Of the six angles that the sine allows: steps from the prior end in the nearest one, those from slices do not."""
    angles, R = np.array([3.0, 0.1]), np.diag([1e-4, 0.1])
    prior = Gaussian(np.zeros((2, 3)), np.diag([2.5, 1e-4, 1e-4]))
    z = np.stack([np.sin(3.0 * angles), np.cos(angles)], axis=-1)
    steps = [(Transition(turning, 1e-8 * np.eye(3)), Measurement(z, Linear(np.eye(3)[1:]), R))] * 4
    alone, many = (
        play(WindowFilter(9.0, relinearise_s=4.0, iterations=8, spacing_deg=s), prior, steps)[-1].now.mean[:, 0]
        for s in (360.0, 30.0)
    )
    np.testing.assert_allclose(many, angles, atol=0.05)
    assert abs(alone[0] - 3.0) > 0.5
    np.testing.assert_array_equal(alone[1], many[1])


def test_what_leaves_the_window_is_the_schur_complement():
    """The Gaussian before the window: what is left of the dense information matrix without the states that have gone."""
    prior, steps = pendulum(5, steps=6, missing=0.0)
    b = play(WindowFilter(2.0, iterations=2, **EXACT), prior, steps)[-1]
    whole = play(WindowFilter(1e9, iterations=0), prior, steps[:1])[-1].past[0]
    one = whole._replace(first=prior.mean)  # the first epoch, with the tangents that it had when it left
    F, Q, (_, me) = one.f.matrix, steps[0][0].Q, steps[0]
    x = one.last
    H = np.stack([(look(x + d) - look(x - d)) / 2e-6 for d in 1e-6 * np.eye(4)], axis=-1)
    Y, W = np.linalg.inv(Q), np.linalg.inv(prior.cov)
    A = np.block([[W + F.T @ Y @ F, -F.T @ Y], [-Y @ F, Y + H.T @ np.linalg.inv(me.R) @ H]])
    schur = A[4:, 4:] - A[4:, :4] @ np.linalg.solve(A[:4, :4], A[:4, 4:])
    first = play(WindowFilter(1.0, iterations=0), prior, steps[:2])[-1]
    np.testing.assert_allclose(first.past[0].before.cov, np.linalg.inv(schur), rtol=1e-6)
    assert len(b.past) == 2


@pytest.mark.parametrize("batch", [(), (5,)])
def test_a_window_of_one_epoch_is_the_iterated_filter(batch):
    prior, steps = pendulum(6, batch, missing=0.0)
    prior = prior._replace(cov=0.1 * prior.cov)  # small enough for all iterations to converge
    mine = play(WindowFilter(1.0, iterations=40, **EXACT), prior, steps)
    iekf = make_filter("iekf", iterations=41, tolerance=0.0)
    theirs = iekf.init(prior)
    for b, (tr, me) in zip(mine, steps, strict=True):
        theirs, _ = iekf.step(theirs, tr, me)
        np.testing.assert_allclose(b.now.mean, theirs.mean, atol=1e-6)
        np.testing.assert_allclose(b.now.cov, theirs.cov, atol=1e-6)


def test_runs_do_not_know_each_other():
    """Bit for bit, with a run that is lost and one whose fixes are missing now and then."""
    prior, steps = pendulum(7, (4,), steps=15, missing=0.0)
    has = np.random.default_rng(0).random(15) < 0.5
    steps[8][1].z[3] = np.inf
    steps[5][1].z[0, 1] = np.nan
    together = []
    for (tr, me), seen in zip(steps, has, strict=True):
        R = np.broadcast_to(me.R, (4, 2, 2)).copy()
        R[2] += 0.0 if seen else MISSING * np.eye(2)
        together.append((tr, me._replace(R=R)))
    f = WindowFilter(6.0, relinearise_s=2.0, iterations=3)
    b = play(f, prior, together)[-1]
    np.testing.assert_array_equal(b.health.failed_at, [-1, -1, -1, 9])
    for run in range(3):  # a component that is missing keeps no run from its iterations
        assert any(np.abs(node.first[run] - node.before.mean[run]).max() > 1e-6 for node in b.past)
    for i in range(3):
        own = [(tr, me._replace(z=me.z[[i]], R=me.R[[i]])) for tr, me in together]
        alone = play(f, Gaussian(prior.mean[[i]], prior.cov[[i]]), own)[-1]
        np.testing.assert_array_equal(b.now.mean[[i]], alone.now.mean)
        np.testing.assert_array_equal(b.now.cov[[i]], alone.now.cov)


def test_feedbacks_are_part_of_the_next_epoch():
    """Two moves of the origin and axes, undone by f, change nothing, whatever the window linearises again."""
    prior, steps = pendulum(8)
    shift, M = np.array([0.3, -0.2, 0.1, 0.5]), np.random.default_rng(1).standard_normal((4, 4))
    f = WindowFilter(5.0, relinearise_s=0.0, iterations=4)
    plain, moved = f.init(prior), f.init(prior)
    for k, (tr, me) in enumerate(steps):
        plain, _ = f.step(plain, tr, me)
        back = tr if k == 0 else tr._replace(f=lambda x: swing(0.5 * x @ np.linalg.inv(M).T + shift))
        moved, _ = f.step(moved, back, me)
        np.testing.assert_allclose(moved.now.mean, plain.now.mean, atol=1e-6)
        moved = f.relocate(moved, lambda x: 2 * (x - shift), lambda x: np.broadcast_to(2 * np.eye(4), (*x.shape, 4)))
        moved = f.relocate(moved, lambda x: x @ M.T, lambda x: np.broadcast_to(M, (*x.shape, 4)))
        np.testing.assert_allclose(f.estimate(moved).mean, 2 * M @ (plain.now.mean - shift), atol=1e-6)
        np.testing.assert_allclose(f.estimate(moved).cov, 4 * M @ plain.now.cov @ M.T, atol=1e-6)
