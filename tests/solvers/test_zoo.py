"""What every registered filter must do: be the Kalman filter on linear problems, and survive a lost run."""

import functools
import json
import math
import pickle
import threading
import time
from dataclasses import FrozenInstanceError, fields
from pathlib import Path

import numpy as np
import pytest
from oracles.dense_kalman import kalman
from oracles.problems import linear, look, run_of, spd, swing, swing_jacobian
from oracles.zoo import (
    draws,
    exact,
    first_fix_together,
    generators,
    is_batched,
    label,
    repairs_a_singular_prior,
    settings_of,
    zoo,
)
from threadpoolctl import threadpool_limits

from solvers.filters import FILTERS, make_filter, names
from solvers.types import Gaussian, Linear, Measurement, Transition

EXACT = [pytest.param(name, s, id=label(name, s)) for name, s in exact()]
EXACT_BATCHED = [p for p in EXACT if is_batched(p.values[0])]
ZOO = [pytest.param(name, s, id=label(name, s)) for name, s in zoo()]
BATCHED = [p for p in ZOO if is_batched(p.values[0])]
BATCHES = [(), (7,), (2, 3)]


def opaque(M, offset, batch):
    """x -> M x + offset, (*batch, n) or (*batch, points, n), as a function that no filter can look into."""

    def g(x):
        if x.ndim == len(batch) + 1:
            return (M @ x[..., None])[..., 0] + offset
        return x @ np.swapaxes(M, -1, -2) + offset[..., None, :]

    return g


def affine(M, offset, batch):
    return Linear(M, offset)


def play(flt, p, as_function=affine, z=None):
    """Beliefs and innovations of ``flt`` on the linear problem ``p``."""
    f, h = as_function(p.F, p.c, p.batch), as_function(p.H, p.d, p.batch)
    b = flt.init(Gaussian(p.x, p.P), generators(p.batch))
    history = []
    for z_k in p.z if z is None else z:
        b, innovation = flt.step(b, Transition(f, p.Q), None if z_k is None else Measurement(z_k, h, p.R))
        history.append((b, innovation))
    return history


@functools.cache
def problem(seed, n, m, batch=()):
    """A linear problem, which nobody may change, and what the dense Kalman filter makes of each run."""
    p = linear(seed, n, m, batch)
    return p, functools.cache(lambda i: kalman(*run_of(p, i)))


def assert_equal_at_each_step(found, expected, scale, tolerance):
    """Arrays (steps, ...), to a tolerance relative to the largest number of ``scale`` at the step."""
    apart = np.abs(np.array(found) - np.array(expected)).reshape(len(expected), -1).max(axis=-1)
    largest = np.abs(np.array(scale)).reshape(len(scale), -1).max(axis=-1)
    np.testing.assert_allclose(apart / largest, 0.0, atol=tolerance)


def assert_is_kalman(flt, p, oracle, as_function, tolerance=1e-10):
    history = play(flt, p, as_function)
    estimates = [flt.estimate(b) for b, _ in history]
    assert {(mean.shape, cov.shape) for mean, cov in estimates} == {(p.x.shape, p.P.shape)}
    fixes = [k for k, z in enumerate(p.z) if z is not None]
    assert [k for k, (_, innovation) in enumerate(history) if innovation is not None] == fixes
    for i in np.ndindex(p.batch):
        beliefs, innovations = oracle(i)
        x, P = zip(*beliefs, strict=True)
        residual, S = zip(*(innovations[k] for k in fixes), strict=True)
        assert_equal_at_each_step([mean[i] for mean, _ in estimates], x, x, tolerance)
        assert_equal_at_each_step([cov[i] for _, cov in estimates], P, P, tolerance)
        assert_equal_at_each_step(
            [history[k][1].residual[i] for k in fixes], residual, [x[k] for k in fixes], tolerance
        )
        assert_equal_at_each_step([history[k][1].cov[i] for k in fixes], S, S, tolerance)
    health = history[-1][0].health
    assert health.epoch == len(p.z)
    assert health.failed_at.shape == health.repairs.shape == p.batch
    assert (health.failed_at == -1).all()
    assert (health.repairs == 0).all()
    assert not health.frozen


#: The sizes of state and fix add no branch to functions that no filter can look into, nor the shape of the batch.
@pytest.mark.parametrize(("n", "m", "as_function"), [(4, 1, affine), (7, 2, affine), (10, 3, affine), (7, 2, opaque)])
@pytest.mark.parametrize(("name", "settings"), EXACT)
def test_one_run_is_the_kalman_filter(name, settings, as_function, n, m):
    assert_is_kalman(make_filter(name, **settings), *problem(11 * n + m, n, m), as_function)


@pytest.mark.parametrize(("batch", "as_function"), [((7,), affine), ((2, 3), affine), ((2, 3), opaque)])
@pytest.mark.parametrize(("name", "settings"), EXACT_BATCHED)
def test_every_run_of_a_batch_is_the_kalman_filter(name, settings, as_function, batch):
    assert_is_kalman(make_filter(name, **settings), *problem(7, 5, 2, batch), as_function)


@pytest.mark.parametrize("batch", [(), (4,)])
@pytest.mark.parametrize(("name", "settings"), BATCHED)
def test_noise_shared_by_all_runs(name, settings, batch):
    """Q and R as (n, n) and (m, m) are the same as given for every run."""
    rng = np.random.default_rng(2)
    flt = make_filter(name, **settings)
    x = Gaussian(rng.standard_normal((*batch, 4)), spd(rng, *batch, 4))
    Q, R, z = spd(rng, 4), spd(rng, 2), rng.standard_normal((*batch, 2))
    one, _ = flt.step(flt.init(x, generators(batch)), Transition(swing, Q), Measurement(z, look, R))
    Q, R = np.broadcast_to(Q, (*batch, 4, 4)), np.broadcast_to(R, (*batch, 2, 2))
    each, _ = flt.step(flt.init(x, generators(batch)), Transition(swing, Q), Measurement(z, look, R))
    np.testing.assert_array_equal(flt.estimate(one).mean, flt.estimate(each).mean)
    np.testing.assert_array_equal(flt.estimate(one).cov, flt.estimate(each).cov)


@pytest.mark.parametrize(("name", "settings"), BATCHED)
def test_a_lost_run_freezes_alone(name, settings):
    p = linear(3, 4, 2, batch=(5,), steps=25, missing=0.0)
    flt = make_filter(name, **settings)
    z = [z.copy() for z in p.z]
    z[9][3] = np.inf
    z[20][1, 0] = np.inf
    clean, hit = play(flt, p, opaque), play(flt, p, opaque, z)
    others = [0, 2, 4]
    for (a, inn_a), (b, inn_b) in zip(clean, hit, strict=True):
        np.testing.assert_array_equal(flt.estimate(a).mean[others], flt.estimate(b).mean[others])
        np.testing.assert_array_equal(flt.estimate(a).cov[others], flt.estimate(b).cov[others])
        np.testing.assert_array_equal(inn_a.residual[others], inn_b.residual[others])
    np.testing.assert_array_equal(hit[-1][0].health.failed_at, [-1, 21, -1, 10, -1])
    assert hit[-1][0].health.epoch == len(z)
    assert hit[-1][0].health.frozen
    last_good = flt.estimate(clean[8][0])
    for b, innovation in hit[9:]:
        np.testing.assert_array_equal(flt.estimate(b).mean[3], last_good.mean[3])
        np.testing.assert_array_equal(flt.estimate(b).cov[3], last_good.cov[3])
        assert np.isnan(innovation.residual[3]).all()
        assert np.isnan(innovation.cov[3]).all()
    assert not hit[8][0].health.frozen


@pytest.mark.parametrize(("name", "settings"), BATCHED)
def test_a_run_without_a_fix_goes_on_as_if_alone(name, settings):
    """Where other runs of the batch have a fix, its R is enormous; whatever the filter knows, it learns nothing."""
    flt, batch = make_filter(name, **settings), (3,)
    rng = np.random.default_rng(3)
    x, P, z = rng.standard_normal((3, 4)), spd(rng, 3, 4), 0.5 * rng.standard_normal((20, 3, 2))
    has = rng.random((20, 3)) < 0.6
    has[:, 0], has[:3, 1], has[:2, 2] = True, False, [False, True]
    if first_fix_together(name):
        has[0] = True
    tr, R = Transition(swing, 0.05 * np.eye(4)), 0.5 * np.eye(2)
    b = flt.init(Gaussian(x, P), generators(batch))
    each = [flt.init(Gaussian(x[i], P[i]), own) for i, own in enumerate(generators(batch))]
    for z_k, has_k in zip(z, has, strict=True):
        wide = R + np.where(has_k, 0.0, 1e20)[:, None, None] * np.eye(2)
        b, _ = flt.step(b, tr, Measurement(np.where(has_k[:, None], z_k, 0.0), look, wide))
        for i in range(3):
            each[i], _ = flt.step(each[i], tr, Measurement(z_k[i], look, R) if has_k[i] else None)
    for i, one in enumerate(each):
        for whole, alone in zip(flt.estimate(b), flt.estimate(one), strict=True):
            np.testing.assert_allclose(whole[i], alone, rtol=1e-12, atol=1e-13)
        for key, alone in flt.diagnostics(one).items():
            np.testing.assert_allclose(flt.diagnostics(b)[key][i], alone, rtol=1e-11, atol=1e-13, err_msg=key)
        assert (b.health.repairs[i], b.health.fallbacks[i]) == (one.health.repairs, one.health.fallbacks)


@pytest.mark.parametrize(("name", "settings"), BATCHED)
def test_a_run_without_a_prior_fails_at_once(name, settings):
    p = linear(4, 4, 2, batch=(3,), steps=10, missing=0.0)
    flt = make_filter(name, **settings)
    clean = play(flt, p)
    p.x[1, 2] = np.nan
    hit = play(flt, p)
    np.testing.assert_array_equal(hit[-1][0].health.failed_at, [-1, 0, -1])
    for i in (0, 2):
        np.testing.assert_array_equal(flt.estimate(clean[-1][0]).mean[i], flt.estimate(hit[-1][0]).mean[i])


@pytest.mark.parametrize(("name", "settings"), ZOO)
def test_one_run_that_is_lost_says_so(name, settings):
    p = linear(5, 4, 2, steps=10, missing=0.0)
    flt = make_filter(name, **settings)
    clean = play(flt, p)
    p.z[6][:] = np.inf
    hit = play(flt, p)
    health = hit[-1][0].health
    assert (health.failed_at, health.epoch, health.frozen) == (7, 10, True)
    np.testing.assert_array_equal(flt.estimate(hit[-1][0]).mean, flt.estimate(clean[5][0]).mean)
    assert np.isnan(hit[-1][1].residual).all()


@pytest.mark.parametrize(("name", "settings"), ZOO)
def test_a_function_that_overflows_is_a_lost_run_too(name, settings):
    flt = make_filter(name, **settings)
    b = flt.init(Gaussian(np.full(3, 1.0), np.eye(3)), np.random.default_rng(0))
    tr = Transition(lambda x: np.exp(1e3 * (x + 1.0)), np.eye(3))
    after, _ = flt.step(b, tr, None)
    assert after.health.failed_at == 1
    np.testing.assert_array_equal(flt.estimate(after).mean, flt.estimate(b).mean)


@pytest.mark.parametrize("batch", BATCHES)
@pytest.mark.parametrize(("name", "settings"), ZOO)
def test_relocation_on_a_linear_map_is_exact(name, settings, batch):
    flt = make_filter(name, **settings)
    if batch and not flt.batched:
        pytest.skip("takes one run")
    p = linear(8, 4, 2, batch)
    b = flt.init(Gaussian(p.x, p.P), generators(batch))
    before = flt.estimate(b)
    moved = flt.relocate(b, Linear(p.F, p.c), lambda x: p.F)
    got = flt.estimate(moved)
    np.testing.assert_allclose(got.mean, (p.F @ before.mean[..., None])[..., 0] + p.c, atol=1e-13)
    np.testing.assert_allclose(got.cov, p.F @ before.cov @ p.F.mT, atol=1e-13)
    np.testing.assert_array_equal(got.cov, got.cov.mT)
    assert moved.health == b.health


@pytest.mark.parametrize(("name", "settings"), BATCHED)
def test_relocation_moves_frozen_runs_and_freezes_those_it_loses(name, settings):
    p = linear(9, 4, 2, batch=(3,))
    flt = make_filter(name, **settings)
    p.z[0] = np.where(np.arange(3)[:, None] == 0, np.inf, 1.0) * np.ones(2)
    b = play(flt, p, z=p.z[:1])[0][0]
    bad = np.array([1.0, 1.0, np.nan])
    moved = flt.relocate(b, lambda x: (x + 1.0) * bad.reshape(3, *[1] * (x.ndim - 1)), lambda x: np.eye(4))
    before, after = flt.estimate(b).mean, flt.estimate(moved).mean
    np.testing.assert_allclose(after, before + np.array([[1.0], [1.0], [0.0]]), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(moved.health.failed_at, [1, -1, 1])


@pytest.mark.parametrize(("name", "settings"), EXACT_BATCHED)
def test_a_singular_prior_works_and_repairs_are_counted(name, settings):
    p = linear(10, 5, 2, batch=(3,), missing=0.0)
    p.P[1, 2:] = p.P[1, :, 2:] = 0.0  # biases known exactly at the start
    flt = make_filter(name, **settings)
    history = play(flt, p, opaque)
    np.testing.assert_array_equal(history[-1][0].health.repairs, [0, int(repairs_a_singular_prior(name, settings)), 0])
    for i in range(3):
        x, P = kalman(*run_of(p, i))[0][-1]
        got = flt.estimate(history[-1][0])
        np.testing.assert_allclose(got.mean[i], x, atol=1e-9)
        np.testing.assert_allclose(got.cov[i], P, atol=1e-9)


@pytest.mark.parametrize(("name", "settings"), ZOO)
def test_beliefs_flow_and_nothing_hides_in_the_filter(name, settings):
    """Two interleaved beliefs give what each gives alone, and a step leaves its belief as it was."""
    flt = make_filter(name, **settings)
    p, q = linear(20, 4, 2, steps=5), linear(21, 4, 2, steps=5)
    alone = play(flt, p), play(flt, q)
    start = [flt.init(Gaussian(a.x, a.P), np.random.default_rng(0)) for a in (p, q)]
    kept = [flt.estimate(b).mean.copy() for b in start]
    beliefs = list(start)
    for k in range(5):
        for j, a in enumerate((p, q)):
            me = None if a.z[k] is None else Measurement(a.z[k], Linear(a.H, a.d), a.R)
            beliefs[j], _ = flt.step(beliefs[j], Transition(Linear(a.F, a.c), a.Q), me)
            np.testing.assert_array_equal(flt.estimate(beliefs[j]).cov, flt.estimate(alone[j][k][0]).cov)
    for b, mean in zip(start, kept, strict=True):
        np.testing.assert_array_equal(flt.estimate(b).mean, mean)


@pytest.mark.parametrize(("name", "settings"), ZOO)
def test_filters_are_frozen_and_travel(name, settings):
    flt = make_filter(name, **settings)
    p = linear(30, 4, 2, steps=10)
    b = play(flt, p)[-1][0]
    again, b_again = pickle.loads(pickle.dumps((flt, b)))
    assert again == flt
    np.testing.assert_array_equal(again.estimate(b_again).cov, flt.estimate(b).cov)
    np.testing.assert_array_equal(flt.estimate(play(again, p)[-1][0]).mean, flt.estimate(b).mean)
    with pytest.raises(FrozenInstanceError):
        flt.alpha = 2.0


@pytest.mark.parametrize("name", names())
def test_errors_name_what_is_allowed(name):
    with pytest.raises(ValueError, match=f"unknown filter '{name}x'; did you mean"):
        make_filter(name + "x")
    with pytest.raises(ValueError, match=f"unknown setting of {name} 'alhpa'") as e:
        make_filter(name, alhpa=1.0)
    assert all(field.name in str(e.value) for field in fields(FILTERS[name]))


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("ukf", {"alpha": -1.0}, "alpha = -1.0; allowed: a finite number > 0"),
        ("ukf", {"root": "qr"}, "unknown root 'qr'"),
        ("ckf", {"root": "svdd"}, "unknown root 'svdd'; did you mean 'svd'"),
        ("ckf", {"form": "qr"}, "unknown form 'qr'"),
        (
            "ckf",
            {"form": "square-root", "root": "svd"},
            "root = 'svd'; allowed: 'cholesky', for form = 'square-root' carries the triangular one",
        ),
        ("ckf5", {"root": "qr"}, "unknown root 'qr'"),
        ("ddf1", {"interval": 0.0}, "interval = 0.0; allowed: a finite number > 0"),
        ("ddf2", {"interval": 0.9}, "interval = 0.9; allowed: a finite number >= 1"),
        ("filterpy_ukf", {"beta": np.nan}, "beta = nan"),
    ],
)
def test_values_are_checked(name, settings, message):
    with pytest.raises(ValueError, match=message):
        make_filter(name, **settings)


#: values that are no setting of any kind, and one that only looks like a number
NO_SETTINGS = ["", "x", "2", {}, ["x"], [None], [[1]], b"x", math.nan, object()]


@pytest.mark.parametrize("name", names())
def test_a_value_of_another_kind_is_one_clear_error(name):
    for field in fields(FILTERS[name]):
        others = [None] if "None" not in field.type else []
        others += [True, False] if "bool" not in field.type else [0, 1]
        for value in [*NO_SETTINGS, *others]:
            if (field.name, value) == ("adapt", ""):
                continue  # the parts of an empty string: none
            with pytest.raises(ValueError, match=rf"^({field.name} = |{field.name}: |unknown {field.name} )"):
                make_filter(name, **{field.name: value})


@pytest.mark.parametrize("name", names())
def test_settings_survive_json(name):
    """A filter from JSON equals the one of Python values, and its hash too: lists become tuples."""
    flt = make_filter(name)
    given = {field.name: getattr(flt, field.name) for field in fields(flt)}
    again = make_filter(name, **json.loads(json.dumps(given)))
    assert again == flt
    assert hash(again) == hash(flt)


@pytest.mark.parametrize("name", [n for n in names() if not FILTERS[n].batched])
def test_filters_of_one_run_refuse_a_batch(name):
    with pytest.raises(ValueError, match=r"takes one run: prior mean of shape \(n,\), given \(2, 3\)"):
        make_filter(name).init(Gaussian(np.zeros((2, 3)), np.zeros((2, 3, 3))), None)


@pytest.mark.parametrize("name", names())
def test_a_wrong_shape_is_an_error_and_not_a_lost_run(name):
    flt = make_filter(name, **settings_of(name))
    with pytest.raises(ValueError, match=r"covariance must be \(3, 3\), given \(2, 2\)"):
        flt.init(Gaussian(np.zeros(3), np.eye(2)), generators(()))
    b = flt.init(Gaussian(np.zeros(3), np.eye(3)), generators(()))
    with pytest.raises(ValueError):  # noqa: PT011  NumPy's own message
        flt.step(b, Transition(swing, np.eye(2)), None)


@pytest.mark.parametrize(("name", "settings"), ZOO)
def test_diagnostics_are_arrays_per_run(name, settings):
    batch = (3,) if is_batched(name) else ()
    p = linear(12, 4, 2, batch, steps=21)
    flt = make_filter(name, **settings)
    for b, _ in play(flt, p)[::10]:
        for key, value in flt.diagnostics(b).items():
            assert isinstance(key, str)
            assert value.shape[: len(batch)] == batch, key
            assert np.isfinite(value).all(), key


@pytest.mark.parametrize("batch", [(), (3,)])
@pytest.mark.parametrize("name", [n for n in names() if not draws(n) and is_batched(n)])
def test_a_state_and_a_fix_known_exactly_change_nothing(name, batch):
    """P, Q and R all zero."""
    flt, zero = make_filter(name), np.zeros((2, 2))
    b = flt.init(Gaussian(np.ones((*batch, 2)), zero), generators(batch))
    for _ in range(4):
        me = Measurement(np.ones((*batch, 1)), Linear(np.ones((1, 2))), zero[:1, :1])
        b, _ = flt.step(b, Transition(Linear(np.eye(2)), zero), me)
    np.testing.assert_array_equal(b.health.failed_at, -1)
    np.testing.assert_allclose(flt.estimate(b).mean, 1.0, rtol=1e-12)
    np.testing.assert_allclose(flt.estimate(b).cov, 0.0, atol=1e-12)


@pytest.mark.parametrize("m", [1, 2, 3])
@pytest.mark.parametrize("name", [n for n in names() if not draws(n) and is_batched(n)])
def test_a_run_far_beyond_all_numbers_does_not_end_the_others(name, m):
    """LAPACK raises on matrices that are not finite; nothing may get there."""
    flt = make_filter(name)
    x, z = np.ones((3, 3)), np.zeros((3, m))
    x[1], z[2] = 1e160, 1e300
    b = flt.init(Gaussian(x, np.eye(3)), generators((3,)))
    for _ in range(4):
        b, _ = flt.step(b, Transition(swing3, np.eye(3)), Measurement(z, Squares(m), np.eye(m)))
    assert b.health.failed_at[0] == -1
    one = flt.init(Gaussian(x[0], np.eye(3)), generators((3,))[0])
    for _ in range(4):
        one, _ = flt.step(one, Transition(swing3, np.eye(3)), Measurement(z[0], Squares(m), np.eye(m)))
    np.testing.assert_allclose(flt.estimate(b).mean[0], flt.estimate(one).mean, rtol=1e-9, atol=1e-12)


def swing3(x):
    return x + 0.05 * np.sin(x)


class Squares:
    """x -> x + x^2 / 10 of the first m states."""

    def __init__(self, m):
        self.m = m

    def __call__(self, x):
        return x[..., : self.m] + 0.1 * x[..., : self.m] ** 2


def spent():
    """CPU time of each thread of this process so far, ns, by its id."""
    return {task.name: int((task / "schedstat").read_text().split()[0]) for task in Path("/proc/self/task").iterdir()}


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="Linux tells the time of threads")
def test_no_filter_wakes_the_threads_of_blas():
    """BLAS divides what is large, such as all covariances of a batch. A step is over before its threads are awake."""
    runs, n, large = (128,), 10, np.ones(10**6)
    x, Q = Gaussian(np.zeros((*runs, n)), np.eye(n)), 0.1 * np.eye(n)
    with threadpool_limits(2, user_api="blas"):
        before = spent()
        np.vdot(large, large)
        time.sleep(0.02)
        after = spent()
        own = str(threading.get_native_id())
        workers = [thread for thread in after if thread != own and after[thread] - before.get(thread, 0) > 1e6]
        assert workers, "the vector above wakes them"
        while before != after:  # they wait for more work before they sleep
            time.sleep(0.02)
            before, after = after, {thread: spent()[thread] for thread in workers}
        for name in filter(is_batched, names()):
            flt = make_filter(name, **settings_of(name))
            b = flt.init(x, generators(runs))
            b, _ = flt.step(b, Transition(swing, Q), Measurement(np.zeros(2), look, np.eye(2)))
            flt.relocate(b, swing, swing_jacobian)
            now = spent()
            woken = any(now[thread] - after[thread] > 1e5 for thread in workers)  # ns; one that waits takes some us
            assert not woken, name
            after = {thread: now[thread] for thread in workers}
