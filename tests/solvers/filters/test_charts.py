"""Filters on manifolds: each of the zoo on a circle, and rotations against an unscented filter written with scipy's."""

import math
import re

import numpy as np
import pytest
from oracles.zoo import generators, is_batched, zoo
from places import ROOT
from scipy.spatial.transform import Rotation

from solvers.filters import make_filter
from solvers.filters.charts import OnManifold
from solvers.smoothing import smooth
from solvers.types import Chart, Gaussian, Linear, Measurement, Transition

EXAMPLES = re.findall(r"```python\n(.*?)```", (ROOT / "docs/mathematics/filters.md").read_text(), re.DOTALL)
TURN = 2.0 * math.pi
F, Q, H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.diag([0.01, 0.002]), np.eye(1, 2)


def wrap(x):
    """The first state within half a turn."""
    return np.concatenate([x[..., :1] - TURN * np.round(x[..., :1] / TURN), x[..., 1:]], axis=-1)


CIRCLE = Chart(lambda x, d: wrap(x + d), lambda y, x: wrap(y - x))  # an angle and its rate


def onward(x):
    return x @ F.T


def wrapped_onward(x):
    return wrap(x @ F.T)


def bearing(x):
    return x[..., :1]


@pytest.mark.parametrize(("name", "settings"), list(zoo()))
def test_an_angle_on_its_circle_is_one_on_the_line(name, settings):
    """The angle turns several times; on the circle no number leaves (-pi, pi]. A run whose fix is infinite freezes alone."""
    batch = (3,) if is_batched(name) else ()
    rng = np.random.default_rng(5)
    prior = Gaussian(np.array([3.0, 0.6]) + 0.2 * rng.standard_normal((*batch, 2)), np.diag([0.04, 0.01]))
    line, circle = make_filter(name, **settings), OnManifold(make_filter(name, **settings), CIRCLE)
    a, b = line.init(prior, generators(batch)), circle.init(prior._replace(mean=wrap(prior.mean)), generators(batch))
    for k in range(9):
        z = 3.0 + 0.6 * (k + 1) + 0.2 * rng.standard_normal((*batch, 1))
        z = z if k % 4 != 2 else np.full_like(z, np.nan)
        fixes = [z, wrap(z)]
        for fix in fixes[: 2 * (k == 5) * len(batch)]:
            fix[1] = np.inf
        me = Measurement(fixes[0], bearing, np.array([[0.04]]), turns=[True])
        a, seen_a = line.step(a, Transition(onward, Q), me)
        b, seen_b = circle.step(b, Transition(wrapped_onward, Q), me._replace(z=fixes[1]))
        np.testing.assert_allclose(seen_b.residual, seen_a.residual, atol=1e-6)
    x, y = line.estimate(a), circle.estimate(b)
    assert (np.abs(y.mean[..., 0]) <= math.pi).all()
    np.testing.assert_allclose(wrap(y.mean - x.mean), 0.0, atol=1e-6)
    np.testing.assert_allclose(y.cov, x.cov, rtol=1e-5, atol=1e-9)
    np.testing.assert_array_equal(b.health.failed_at, a.health.failed_at)
    assert (a.health.failed_at >= 0).sum() == bool(batch)
    assert circle.diagnostics(b).keys() == line.diagnostics(a).keys()
    moved = circle.relocate(b, lambda v: wrap(v + np.array([1.0, 0.0])))
    np.testing.assert_allclose(wrap(circle.estimate(moved).mean - y.mean - np.array([1.0, 0.0])), 0.0, atol=1e-9)
    np.testing.assert_allclose(circle.estimate(moved).cov, y.cov, rtol=1e-5, atol=1e-9)


# --- rotations ------------------------------------------------------------------------------------------------------------


def plus(x, d):
    """A quaternion with the scalar last, and a bias; scipy takes one axis of rotations."""
    x, d = np.broadcast_arrays(x, np.concatenate([d, d[..., :1]], axis=-1))
    q = Rotation.from_quat(x[..., :4].reshape(-1, 4)) * Rotation.from_rotvec(d[..., :3].reshape(-1, 3))
    return np.concatenate([q.as_quat().reshape(*x.shape[:-1], 4), x[..., 4:] + d[..., 3:6]], axis=-1)


def minus(y, x):
    x, y = np.broadcast_arrays(x, y)
    q = Rotation.from_quat(x[..., :4].reshape(-1, 4)).inv() * Rotation.from_quat(y[..., :4].reshape(-1, 4))
    return np.concatenate([q.as_rotvec().reshape(*x.shape[:-1], 3), y[..., 4:] - x[..., 4:]], axis=-1)


ROTATIONS = Chart(plus, minus)
RATE, DT = np.array([0.3, -0.2, 0.5]), 0.7
UP, NORTH = np.array([0.0, 0.0, 1.0]), np.array([0.0, 1.0, 0.0])


def spun(x):
    return np.concatenate([plus(x, np.concatenate([(RATE - x[..., 4:]) * DT, 0.0 * x[..., 4:]], axis=-1))], axis=-1)


def seen(x):
    back = Rotation.from_quat(x[..., :4].reshape(-1, 4)).inv()
    body = np.concatenate([back.apply(UP), back.apply(NORTH)], axis=-1)
    return body.reshape(*x.shape[:-1], 6)


def right_jacobian(d):
    """Of SO(3), with the identity for the bias."""
    a = np.linalg.norm(d[:3])
    V = np.array([[0.0, -d[2], d[1]], [d[2], 0.0, -d[0]], [-d[1], d[0], 0.0]])
    J = np.eye(6)
    J[:3, :3] += -(1.0 - math.cos(a)) / a**2 * V + (a - math.sin(a)) / a**3 * V @ V
    return J


def cubature_step(x, P, Q, z, R):
    """One step of the cubature filter on rotations, point by point, with scipy alone."""

    def points(P):
        S = math.sqrt(6.0) * np.linalg.cholesky(P)
        return np.concatenate([S.T, -S.T])

    y = spun(x)
    images = np.array([minus(spun(plus(x, d)), y) for d in points(P)])
    m = images.mean(axis=0)
    P = np.cov(images.T, bias=True) + Q
    chi = m + points(P)
    zs = np.array([seen(plus(y, d)) for d in chi])
    S = np.cov(zs.T, bias=True) + R
    K = (chi - m).T @ (zs - zs.mean(axis=0)) / 12.0 @ np.linalg.inv(S)
    d = m + K @ (z - zs.mean(axis=0))
    J = right_jacobian(d)
    return plus(y, d), J @ (P - K @ S @ K.T) @ J.T


def attitude_problem(seed=1):
    rng = np.random.default_rng(seed)
    P = np.diag([0.5, 0.4, 0.6, 0.01, 0.02, 0.01]) ** 1
    guess = np.concatenate([Rotation.random(random_state=seed).as_quat(), np.zeros(3)])
    truth, zs = plus(guess, np.linalg.cholesky(P) @ rng.standard_normal(6)), []
    for _ in range(8):
        truth = spun(truth)
        zs.append(seen(truth) + 0.1 * rng.standard_normal(6))
    return guess, P, zs


QA, RA = np.diag([1e-3] * 3 + [1e-6] * 3), 0.01 * np.eye(6)


def test_rotations_are_filtered_as_by_hand():
    guess, P, zs = attitude_problem()
    flt = OnManifold(make_filter("ckf"), ROTATIONS)
    b, x = flt.init(Gaussian(guess, P)), guess
    for z in zs:
        x, P = cubature_step(x, P, QA, z, RA)
        b, _ = flt.step(b, Transition(spun, QA), Measurement(z, seen, RA))
        got = flt.estimate(b)
        np.testing.assert_allclose(minus(got.mean, x), 0.0, atol=1e-6)
        np.testing.assert_allclose(got.cov, P, rtol=1e-5, atol=1e-8)
        assert np.linalg.norm(got.mean[:4]) == pytest.approx(1.0, abs=1e-12)


def test_square_roots_and_batches_are_the_same_on_a_chart():
    guess, P, zs = attitude_problem(2)
    others = [("ckf", {"form": "square-root"}), ("ukf", {}), ("asmugsf", {"components": 1, "adapt": False})]
    found = []
    for name, settings in [("ckf", {}), *others]:
        flt, runs = OnManifold(make_filter(name, **settings), ROTATIONS), 6  # as many as the filter has states
        b = flt.init(Gaussian(np.tile(guess, (runs, 1)), P))
        for z in zs:
            b, _ = flt.step(b, Transition(spun, QA), Measurement(z, seen, RA))
        found.append(flt.estimate(b))
        np.testing.assert_allclose(found[-1].mean[0], found[-1].mean[5])
    for other in found[1:]:
        np.testing.assert_allclose(other.mean, found[0].mean, atol=1e-9)
        np.testing.assert_allclose(other.cov, found[0].cov, rtol=1e-7, atol=1e-11)


def test_a_fix_may_be_a_point():
    """An attitude that is measured, in the tangent at the fix; one that is missing leaves the prediction."""
    guess, P, _ = attitude_problem(3)
    attitude = Chart(
        lambda x, d: plus(np.pad(x, [(0, 0)] * (x.ndim - 1) + [(0, 3)]), np.pad(d, [(0, 0)] * (d.ndim - 1) + [(0, 3)]))[
            ..., :4
        ],
        lambda y, x: (
            (
                Rotation.from_quat(np.broadcast_to(x, y.shape).reshape(-1, 4)).inv()
                * Rotation.from_quat(y.reshape(-1, 4))
            )
            .as_rotvec()
            .reshape(*y.shape[:-1], 3)
        ),
    )
    z, R, tr = plus(guess, np.array([0.4, -0.3, 0.2, 0.0, 0.0, 0.0]))[:4], 0.05 * np.eye(3), Transition(spun, QA)
    fixes = [
        Measurement(z, lambda x: x[..., :4], R, chart=attitude),
        Measurement(np.zeros(3), lambda x: attitude.minus(x[..., :4], z), R),  # the same by hand
        Measurement(z, lambda x: x[..., :4], R, chart=attitude, present=[False, False, False]),
        None,
    ]
    flt = OnManifold(make_filter("ekf"), ROTATIONS)
    one, by_hand, missing, none = (flt.estimate(flt.step(flt.init(Gaussian(guess, P)), tr, me)[0]) for me in fixes)
    np.testing.assert_array_equal(one.mean, by_hand.mean)
    np.testing.assert_array_equal(one.cov, by_hand.cov)
    np.testing.assert_array_equal(missing.mean, none.mean)
    assert np.linalg.norm(attitude.minus(one.mean[:4], z)) < 0.3 * np.linalg.norm(attitude.minus(none.mean[:4], z))


def test_charts_that_are_none_are_refused():
    prior, flt = Gaussian(np.zeros((2, 2)), np.eye(2)), make_filter("ekf")
    for chart, message in (
        (Chart(lambda x, d: x + d, lambda y, x: x - y), r"minus\(plus\(x, d\), x\) differs from d by 0.002"),
        (
            Chart(lambda x, d: (x + d)[0], lambda y, x: y - x),
            r"plus of points .* has the shape \(2, 2\)",
        ),
        (
            Chart(lambda x, d: x + d, lambda y, x: (y - x).sum(axis=-1)),
            r"minus of points .* has the shape \(2, 2\): needed",
        ),
    ):
        with pytest.raises(ValueError, match=message):
            OnManifold(flt, chart).init(prior)
    with pytest.raises(ValueError, match=r"chart = .*: allowed: a solvers.types.Chart|chart"):
        OnManifold(flt, (lambda x, d: x + d, lambda y, x: y - x))
    circle = OnManifold(flt, CIRCLE)
    b = circle.init(prior)
    with pytest.raises(ValueError, match=r"f of x \(2, 2\) has the shape"):
        circle.step(b, Transition(lambda x: x[..., :1], Q), None)
    with pytest.raises(ValueError, match=r"Q of shape \(2,\): needed"):
        circle.step(b, Transition(onward, np.ones(2)), None)
    with pytest.raises(ValueError, match="OnManifold cannot be smoothed"):
        smooth(circle, prior, [(Transition(onward, Q), None)])
    lost = circle.init(Gaussian(np.array([[0.0, 0.0], [np.nan, 0.0]]), np.eye(2)))
    np.testing.assert_array_equal(lost.health.failed_at, [-1, 0])


def test_linear_functions_pass_to_points():
    """A matrix for each run, through which sigma points go in the chart."""
    rng = np.random.default_rng(3)
    M, c, x = rng.standard_normal((3, 2, 2)), rng.standard_normal((3, 2)), rng.standard_normal((3, 2))
    vectors = Chart(lambda x, d: x + d, lambda y, x: y - x)
    for name in ("ckf", "ekf", "imm_ekf"):
        found = []
        for flt in (make_filter(name), OnManifold(make_filter(name), vectors)):
            b = flt.init(Gaussian(x, np.eye(2)))
            for _ in range(3):
                b, _ = flt.step(b, Transition(Linear(M, c), Q), Measurement(np.ones(2), Linear(M), np.eye(2)))
            found.append(flt.estimate(b))
        np.testing.assert_allclose(found[1].mean, found[0].mean, rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(found[1].cov, found[0].cov, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("example", EXAMPLES)
def test_examples_of_the_page_on_filters(example):
    exec(example, {})


def test_a_run_that_a_move_loses_keeps_its_place():
    flt, tr = OnManifold(make_filter("ekf"), CIRCLE), Transition(wrapped_onward, Q)
    b, _ = flt.step(flt.init(Gaussian(np.array([[0.1, 0.2], [0.3, 0.4]]), np.eye(2))), tr, None)
    before, bad = flt.estimate(b), np.array([0.0, np.nan])
    moved = flt.relocate(b, lambda x: wrap(x + bad.reshape(2, *[1] * (x.ndim - 1)) + 1.0))
    np.testing.assert_array_equal(moved.health.failed_at, [-1, 1])
    np.testing.assert_allclose(flt.estimate(moved).mean, before.mean + np.array([[1.0], [0.0]]), atol=1e-12)
    np.testing.assert_array_equal(flt.estimate(moved).cov[1], before.cov[1])
    aside = b._replace(local=b.local._replace(mean=np.array([[0.2, 0.0], [0.0, 0.1]])))  # a mean beside its point
    np.testing.assert_allclose(flt.estimate(aside).mean, b.point + aside.local.mean, atol=1e-12)
