"""The adaptive filters against dense textbook code, and against noise that is known."""

import json

import numpy as np
import pytest
from oracles.problems import linear, look, spd, swing
from scipy import stats

import solvers
from sins_env.evaluation.tasks.catalogue import get_task
from solvers.filters import make_filter
from solvers.filters.adaptive.aukf import LITERAL
from solvers.types import Gaussian, Linear, Measurement, Transition

NAMES = ("aukf", "aukf_fading", "aukf_window", "augmented_aukf")
PLAIN = {"guard": "none", "project": "none", "gate": 1.0}


def sage_husa(p, adapt, k0, d, G=None):
    """000 (3.4.45-48) in a dense Kalman filter, one run, one epoch per fix: the statistics from PF, PH and K."""
    n, m = len(p.x), len(p.H)
    inverse = np.eye(n) if G is None else np.linalg.pinv(G)
    G = np.eye(n) if G is None else G
    x, P = p.x.copy(), p.P.copy()
    q, Q, r, R = np.zeros(G.shape[1]), inverse @ p.Q @ inverse.T, np.zeros(m), p.R.copy()
    history = []
    for k, z in enumerate(p.z, start=1):
        f, PF = p.F @ x + p.c, p.F @ P @ p.F.T
        x_prior, P_prior = f + G @ q, PF + G @ Q @ G.T
        h, PH = p.H @ x_prior + p.d, p.H @ P_prior @ p.H.T
        S = PH + R
        K = P_prior @ p.H.T @ np.linalg.inv(S)
        e = z - h - r
        x, P = x_prior + K @ e, P_prior - K @ S @ K.T
        weight = d(k + k0)
        new = {
            "q": inverse @ (x - f),
            "Q": inverse @ (np.outer(K @ e, K @ e) + P - PF) @ inverse.T,
            "r": z - h,
            "R": np.outer(e, e) - PH,
        }
        now = {"q": q, "Q": Q, "r": r, "R": R}
        for part in adapt:
            now[part] = (1 - weight) * now[part] + weight * new[part]
        q, Q, r, R = now.values()
        history.append((x, P, q, Q, r, R))
    return history


def variances(cov):
    return np.diagonal(cov, axis1=-2, axis2=-1)


def opaque(M, offset):
    return lambda x: x @ M.T + offset


def follow(flt, p, G=None):
    b = flt.init(Gaussian(p.x, p.P), np.random.default_rng(0))
    out = []
    for z in p.z:
        b, _ = flt.step(b, Transition(opaque(p.F, p.c), p.Q, G), Measurement(z, opaque(p.H, p.d), p.R))
        out.append(b)
    return out


@pytest.mark.parametrize("adapt", ["Q", "R", "qQ", "rR", "qQrR"])
@pytest.mark.parametrize(
    ("name", "settings", "d"),
    [
        ("aukf", {}, lambda k: 1 / k),
        ("aukf_fading", {"b": 0.997}, lambda k: 0.003 / (1 - 0.997**k)),
        ("aukf_window", {"b": 0.997, "m": 700}, lambda k: 0.003 / (1 - 0.997**k)),
        ("augmented_aukf", {"M": 700}, lambda k: 1 / k),
    ],
)
def test_statistics_are_those_of_the_papers(name, settings, d, adapt):
    p = linear(3, 4, 2, missing=0.0, steps=40)
    p.F, p.R = 0.8 * p.F, 3.0 * p.R
    k0 = 600  # long enough that nothing turns indefinite
    beliefs = follow(make_filter(name, adapt=adapt, k0=k0, **PLAIN, **settings), p)
    for b, (x, P, q, Q, r, R) in zip(beliefs, sage_husa(p, adapt, k0, d), strict=True):
        for got, expected in zip((b.mean, b.cov, *b.noise.w, *b.noise.v), (x, P, q, Q, r, R), strict=True):
            np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9 * max(1.0, np.abs(expected).max()))
    assert beliefs[-1].health.repairs == 0


@pytest.mark.parametrize("name", NAMES)
def test_noise_in_driven_directions(name):
    """q_w = G+ q, Q_w = G+ Q G+', and the filter uses G Q_w G'. # 002 example 1"""
    p = linear(5, 4, 2, missing=0.0, steps=30)
    p.F *= 0.8
    G = np.array([[1.0, 0.0], [1.0, 1.0], [1.0, -1.0], [0.0, 2.0]])
    p.Q = G @ np.diag([0.5, 0.2]) @ G.T
    memory = {"aukf_fading": {"b": 1.0}, "aukf_window": {"b": 1.0, "m": 99}, "augmented_aukf": {"M": 99}}.get(name, {})
    beliefs = follow(make_filter(name, adapt="qQ", k0=50, **PLAIN, **memory), p, G)
    for b, (x, P, q, Q, _, _) in zip(beliefs, sage_husa(p, "qQ", 50, lambda k: 1 / k, G), strict=True):
        for got, expected in zip((b.mean, b.cov, *b.noise.w), (x, P, q, Q), strict=True):
            np.testing.assert_allclose(got, expected, rtol=0, atol=1e-9)
    assert beliefs[0].noise.w.cov.shape == (2, 2)


def tracker(runs, steps, seed, q=0.02, r=0.5):
    """Position and velocity with position fixes: F, H, and z (steps, runs, 1) of noise q on the velocity, r."""
    rng = np.random.default_rng(seed)
    F, H = np.array([[1.0, 1.0], [0.0, 1.0]]), np.array([[1.0, 0.0]])
    x, z = np.zeros((runs, 2)), np.empty((steps, runs, 1))
    for k in range(steps):
        x = x @ F.T
        x[:, 1] += np.sqrt(q) * rng.standard_normal(runs)
        z[k] = x @ H.T + np.sqrt(r) * rng.standard_normal((runs, 1))
    return F, H, z


def learn(flt, told_q, told_r, runs=100, steps=1500, every=1, **truth):
    """Beliefs after each tenth step of ``flt`` on the tracker, told the variances; several: that many times the runs."""
    F, H, z = tracker(runs, steps, 7, **truth)
    told_q, told_r = (np.broadcast_to(told, np.broadcast(told_q, told_r).shape) for told in (told_q, told_r))
    z = np.tile(z, (1, told_q.size, 1))
    Q = np.repeat(told_q.reshape(-1), runs)[:, None, None] * np.diag([0.0, 1.0])
    R = np.repeat(told_r.reshape(-1), runs)[:, None, None] * np.eye(1)
    b = flt.init(Gaussian(np.zeros((len(Q), 2)), np.eye(2)), None)
    out = []
    for k, z_k in enumerate(z):
        me = Measurement(z_k, Linear(H), R) if k % every == every - 1 else None
        b, _ = flt.step(b, Transition(Linear(F), Q), me)
        if k % 10 == 9:
            out.append(b)
    return out


#: Filters, and how wrong the told Q is: 20 times, but 3 where all fixes count alike, which forgets very slowly.
MEMORIES = [("aukf", 3.0), ("aukf_fading", 20.0), ("aukf_window", 20.0), ("augmented_aukf", 20.0)]


@pytest.mark.parametrize(("name", "wrong"), MEMORIES)
def test_a_wrong_Q_is_found_and_a_right_one_kept(name, wrong):
    """Told too little, too much, or the truth: medians over 100 runs each."""
    beliefs = learn(make_filter(name), 0.02 * np.array([1 / wrong, wrong, 1.0]), 0.5)
    little, much, right = np.split(beliefs[-1].noise.w.cov[:, 1, 1] / 0.02, 3)
    for found in (little, much):
        assert abs(np.log(np.median(found))) < (0.35 if name != "aukf" else 0.6 * np.log(3.0))
        assert np.median(np.abs(np.log(found))) < 0.6 * np.log(wrong)
    assert 0.7 < np.median(right) < 1.3
    for b in beliefs:
        assert (np.linalg.eigvalsh(b.cov)[:, 0] > 0).all()
        assert (b.noise.w.cov[:, 1, 1] > 0).all()
        np.testing.assert_array_equal(b.noise.w.cov[:, 0, 0], 0.0)  # told to be zero
        np.testing.assert_array_equal(b.noise.w.cov[:, 0, 1], 0.0)
    assert (beliefs[-1].health.failed_at == -1).all()
    assert (beliefs[-1].health.repairs == 0).all()


@pytest.mark.parametrize("name", [name for name, _ in MEMORIES])
def test_a_wrong_R_is_found(name):
    """Told a twentieth of it or 20 times as much."""
    beliefs = learn(make_filter(name, adapt="R"), 0.02, 0.5 * np.array([1 / 20, 20.0]))
    little, much = np.split(beliefs[-1].noise.v.cov[:, 0, 0] / 0.5, 2)
    assert 0.8 < np.median(little) < 1.25
    assert 0.8 < np.median(much) < (1.7 if name == "aukf" else 1.25)
    for b in beliefs:
        assert (np.linalg.eigvalsh(b.cov)[:, 0] > 0).all()
        assert (b.noise.v.cov > 0).all()
    assert (beliefs[-1].health.failed_at == -1).all()


@pytest.mark.parametrize("name", [name for name, _ in MEMORIES])
def test_a_right_Q_stays_right_where_fixes_are_few(name):
    """One fix in five epochs."""
    beliefs = learn(make_filter(name), 0.02, 0.5, every=5)
    found = beliefs[-1].noise.w.cov[:, 1, 1] / 0.02
    assert 0.7 < np.median(found) < 1.3


def test_undamped_it_takes_the_errors_of_the_start_for_noise():
    """A tiny Q, told right, under a large P0: damped it stays, plain it hits the cap (the reason for the guard)."""
    settings = {"cap": 1e4, "floor": 1e-4}
    told, plain = (
        learn(make_filter("aukf_fading", guard=g, **settings), 1e-7, 0.5, q=1e-7, steps=300) for g in ("damp", "none")
    )
    worst = [max(np.median(b.noise.w.cov[:, 1, 1] / 1e-7) for b in beliefs) for beliefs in (told, plain)]
    assert worst[0] < 2.0
    assert worst[1] > 50.0


@pytest.mark.parametrize("guard", ["damp", "positive", "none"])
@pytest.mark.parametrize("project", ["diagonal", "full"])
@pytest.mark.parametrize("name", NAMES)
def test_any_guard_keeps_the_noise_within_its_bounds(name, project, guard):
    p = linear(6, 4, 2, batch=(5,), missing=0.2)
    p.Q[:] = np.diag([0.4, 0.2, 0.1, 0.0])
    flt = make_filter(name, adapt="qQrR", guard=guard, project=project, floor=0.7, cap=1.4, k0=1)
    b = flt.init(Gaussian(p.x, p.P), None)
    R0 = np.diagonal(p.R, axis1=-2, axis2=-1)
    hit = np.zeros(2, dtype=bool)
    for z in p.z:
        me = None if z is None else Measurement(z, Linear(p.H, p.d), p.R)
        b, _ = flt.step(b, Transition(Linear(p.F, p.c), p.Q), me)
        Q, R = (np.diagonal(c, axis1=-2, axis2=-1) for c in (b.noise.w.cov, b.noise.v.cov))
        told = np.array([0.4, 0.2, 0.1, 0.0])
        ratio = np.divide(Q, told, out=np.ones(Q.shape), where=told > 0)
        assert ratio.min() > 0.7 - 1e-9
        assert ratio.max() < 1.4 + 1e-9
        assert (Q[:, 3] == 0).all()
        assert (b.noise.w.mean[:, 3] == 0).all()
        if R.shape == R0.shape:  # from the first fix on
            assert (R / R0).min() > 0.7 - 1e-9 or project == "full"
            assert (R / R0).max() < 1.4 + 1e-9 or project == "full"
            assert (np.linalg.eigvalsh(b.noise.v.cov) > 0).all()
        assert (np.linalg.eigvalsh(b.noise.w.cov) >= -1e-15).all()
        if project == "full":
            ratio = np.linalg.eigvalsh(b.noise.w.cov[:, :3, :3] / np.sqrt(np.outer(told[:3], told[:3])))
        hit |= [np.isclose(ratio, 0.7).any(), np.isclose(ratio, 1.4).any()]
    assert hit.all()
    assert (b.health.failed_at == -1).all()


@pytest.mark.parametrize("name", NAMES)
def test_the_gate_bounds_what_one_outlier_teaches(name):
    """The state is corrected as by the Kalman filter; the noise hears an innovation on the edge of the gate."""
    p = linear(8, 4, 2, batch=(3,), missing=0.0)
    p.z[0][1] = 1e4
    gated, free = (make_filter(name, gate=g, cap=1e12, guard="none") for g in (0.999, 1.0))
    tr, me = Transition(Linear(p.F, p.c), p.Q), Measurement(p.z[0], Linear(p.H, p.d), p.R)
    a, innovation = gated.step(gated.init(Gaussian(p.x, p.P), None), tr, me)
    c, _ = free.step(free.init(Gaussian(p.x, p.P), None), tr, me)
    size = [e @ np.linalg.solve(S, e) for e, S in zip(*innovation, strict=True)]
    limit = stats.chi2.ppf(0.999, 2)
    assert size[1] > 1e4 > limit
    np.testing.assert_array_equal(a.mean, c.mean)
    ratio = [np.trace(b.noise.w.cov[1]) for b in (a, c)]
    assert ratio[1] > 100 * ratio[0]
    assert a.gated[1] == 1
    np.testing.assert_array_equal(a.gated, a.health.fallbacks)
    np.testing.assert_array_equal(gated.diagnostics(a)["gated"], a.gated)
    assert (c.gated == 0).all()


@pytest.mark.parametrize("name", NAMES)
def test_a_run_without_a_fix_learns_nothing(name):
    """Rows of a batch that have no fix carry an enormous R; the others learn as if alone."""
    p = linear(9, 4, 2, batch=(2,), missing=0.0, steps=30)
    flt = make_filter(name, adapt="QR")
    both = flt.init(Gaussian(p.x, p.P), None)
    alone = flt.init(Gaussian(p.x[0], p.P[0]), None)
    for k, z in enumerate(p.z):
        gap = k < 3 or 10 <= k < 20
        R = p.R + np.array([0.0, 1e20 if gap else 0.0])[:, None, None] * np.eye(2)
        before = both
        tr = Transition(Linear(p.F, p.c), p.Q)
        both, _ = flt.step(both, tr, Measurement(np.where(np.arange(2)[:, None] * gap, 0.0, z), Linear(p.H, p.d), R))
        one = Measurement(z[0], Linear(p.H[0], p.d[0]), p.R[0])
        alone, _ = flt.step(alone, Transition(Linear(p.F[0], p.c[0]), p.Q[0]), one)
        if gap and k > 3:
            for a, c in zip((*both.noise.w, *both.noise.v), (*before.noise.w, *before.noise.v), strict=True):
                np.testing.assert_array_equal(a[1], c[1])
            assert both.idle[1] == k - 9
        if gap:
            np.testing.assert_allclose(both.mean[1], flt.predict(before, tr).mean[1], atol=1e-12)
    np.testing.assert_array_equal(both.idle, 0)
    np.testing.assert_array_equal(both.fixes, [50, 37])
    np.testing.assert_allclose(both.noise.w.cov[0], alone.noise.w.cov, rtol=1e-12)
    np.testing.assert_allclose(both.noise.v.cov[0], alone.noise.v.cov, rtol=1e-12)
    assert (variances(both.noise.v.cov[1]) < 20 * variances(p.R[1])).all()  # and not at the cap


@pytest.mark.parametrize("batch", [(), (2,)])
def test_no_run_has_a_fix(batch):
    p = linear(16, 4, 2, batch, missing=0.0, steps=2)
    flt = make_filter("aukf_window", adapt="QR")
    b = flt.init(Gaussian(p.x, p.P), None)
    for R in (1e20 * np.eye(2), p.R):
        b, _ = flt.step(b, Transition(Linear(p.F, p.c), p.Q), Measurement(p.z[0], Linear(p.H, p.d), R))
    np.testing.assert_array_equal(b.fixes, 21)
    assert (variances(b.noise.v.cov) < 100 * variances(p.R)).all()


def augmented_ukf(x, P, Q, R, f, h, z, alpha, beta, kappa, driven):
    """One step of 000 (3.5.1-14) as printed, with the weights right: all points of [x; w; v], none redrawn."""
    n, m, L = len(x), len(R), len(x) + len(driven) + len(R)
    lam = alpha**2 * (L + kappa) - L
    cov = np.zeros((L, L))
    cov[:n, :n], cov[n : L - m, n : L - m], cov[L - m :, L - m :] = P, Q[np.ix_(driven, driven)], R
    root = np.sqrt(L + lam) * np.linalg.cholesky(cov)
    mean = np.concatenate([x, np.zeros(L - n)])
    chi = np.vstack([mean, mean + root.T, mean - root.T])
    wm = np.full(2 * L + 1, 0.5 / (L + lam))
    wm[0] = lam / (L + lam)
    wc = wm.copy()
    wc[0] += 1 - alpha**2 + beta
    images = np.array([f(c[:n]) for c in chi])
    images[:, driven] += chi[:, n : L - m]
    y = np.array([h(i) for i in images]) + chi[:, L - m :]
    x_prior, y_hat = wm @ images, wm @ y
    dx, dy = images - x_prior, y - y_hat
    P_prior, S, cross = dx.T @ (wc[:, None] * dx), dy.T @ (wc[:, None] * dy), dx.T @ (wc[:, None] * dy)
    K = cross @ np.linalg.inv(S)
    return x_prior + K @ (z - y_hat), P_prior - K @ S @ K.T, z - y_hat, S


@pytest.mark.parametrize(("alpha", "beta", "kappa"), [(1.0, 0.0, 0.0), (0.7, 2.0, 1.0)])
def test_augmented_points_go_from_f_to_h(alpha, beta, kappa):
    rng = np.random.default_rng(11)
    x, P, R, z = rng.standard_normal(4), 0.3 * spd(rng, 4), spd(rng, 2), rng.standard_normal(2)
    Q, driven = np.diag([0.2, 0.1, 0.0, 0.05]), [0, 1, 3]
    flt = make_filter("augmented_aukf", adapt="none", alpha=alpha, beta=beta, kappa=kappa)
    b, innovation = flt.step(flt.init(Gaussian(x, P), None), Transition(swing, Q), Measurement(z, look, R))
    expected = augmented_ukf(x, P, Q, R, swing, look, z, alpha, beta, kappa, driven)
    for got, e in zip((b.mean, b.cov, *innovation), expected, strict=True):
        np.testing.assert_allclose(got, e, rtol=0, atol=1e-11)
    redrawn, _ = (ukf := make_filter("ukf", alpha=alpha, beta=beta, kappa=kappa)).step(
        ukf.init(Gaussian(x, P), None), Transition(swing, Q), Measurement(z, look, R)
    )
    assert np.abs(redrawn.mean - b.mean).max() > 1e-4  # else this test would prove little


def test_the_thesis_takes_the_mean_square_of_the_corrections():
    """# 000 (3.5.15), divided by M: the last M, once so many are seen."""
    p = linear(12, 3, 2, missing=0.0, steps=30)
    flt = make_filter("augmented_aukf", unbiased=False, M=8, k0=0, **PLAIN)
    b = flt.init(Gaussian(p.x, p.P), None)
    steps = []
    for z in p.z:
        Q = p.Q if not steps else b.noise.w.cov
        x_prior, P_prior = p.F @ b.mean + p.c, p.F @ b.cov @ p.F.T + Q
        K = P_prior @ p.H.T @ np.linalg.inv(p.H @ P_prior @ p.H.T + p.R)
        steps.append(K @ (z - p.H @ x_prior - p.d))
        b, _ = flt.step(b, Transition(opaque(p.F, p.c), p.Q), Measurement(z, opaque(p.H, p.d), p.R))
        last = np.array(steps[-8:])
        np.testing.assert_allclose(b.noise.w.cov, last.T @ last / len(last), atol=1e-10)


@pytest.mark.parametrize("name", NAMES)
def test_literal_estimates_that_turn_indefinite_are_counted_and_never_raise(name):
    p = linear(13, 4, 2, batch=(40,), missing=0.0, steps=60)
    flt = make_filter(name, adapt="QR", **LITERAL)
    b = flt.init(Gaussian(p.x, p.P), None)
    uses = np.zeros(40, dtype=int)  # of an indefinite Q or R
    for k, z in enumerate(p.z):
        if k > 0:
            spectra = [np.linalg.eigvalsh(one.cov) for one in b.noise]
            uses += sum(s[:, 0] < -1e-9 * np.abs(s[:, -1]) for s in spectra)  # beyond rounding
        b, _ = flt.step(b, Transition(Linear(p.F, p.c), p.Q), Measurement(z, Linear(p.H, p.d), p.R))
    negative, well = uses > 0, b.health.failed_at < 0
    assert negative.sum() > 20
    assert well.sum() > 10
    assert (b.health.repairs >= uses)[well].all()
    assert (b.health.repairs > 0)[negative & well].all()
    assert np.isfinite(b.mean).all()


@pytest.mark.parametrize("name", NAMES)
def test_fixes_may_come_before_an_epoch_and_two_at_a_time(name):
    """A fix at the start teaches nothing of w, there being none in it; nothing divides by no epochs."""
    p = linear(15, 4, 2, batch=(3,), missing=0.0, steps=3)
    flt = make_filter(name)
    b = flt.init(Gaussian(p.x, p.P), None)
    me = Measurement(p.z[0], Linear(p.H, p.d), p.R)
    b, _ = flt.correct(b, me)
    b = flt.predict(b, Transition(Linear(p.F, p.c), p.Q))
    np.testing.assert_array_equal(b.noise.w.cov, p.Q)
    for _ in range(2):
        b, _ = flt.correct(b, me)
    assert np.isfinite(b.noise.w.cov).all()
    assert np.isfinite(b.mean).all()


def test_diagnostics_tell_the_noise_in_use():
    p = linear(14, 4, 2, batch=(3,), missing=0.0, steps=5)
    for project, shape in (("diagonal", ()), ("full", (4,))):
        flt = make_filter("aukf", project=project, adapt="QR")
        b = flt.init(Gaussian(p.x, p.P), None)
        for z in p.z:
            b, _ = flt.step(b, Transition(Linear(p.F, p.c), p.Q), Measurement(z, Linear(p.H, p.d), p.R))
        told = flt.diagnostics(b)
        assert set(told) == {"q", "Q", "r", "R", "gated"}
        assert told["Q"].shape == (3, 4, *shape)
        assert told["R"].shape == (3, 2, *(2,) * len(shape))
        np.testing.assert_array_equal(told["q"], 0.0)


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("aukf", {"adapt": "QX"}, "unknown adapt 'X'"),
        ("aukf", {"project": "diag"}, "unknown project 'diag'; did you mean 'diagonal'"),
        ("aukf", {"guard": "damped"}, "unknown guard 'damped'; did you mean 'damp'"),
        ("aukf", {"k0": -1}, "k0 = -1; allowed: a whole number >= 0"),
        ("aukf", {"k0": 0.5}, "k0 = 0.5; allowed: a whole number >= 0"),
        ("aukf", {"adapt": 5}, "unknown adapt 5"),
        ("aukf", {"floor": 2.0}, "floor = 2.0; allowed: a number >= 0 and <= 1"),
        ("aukf", {"cap": 0.5}, "cap = 0.5; allowed: a finite number >= 1"),
        ("aukf", {"gate": 0.0}, "gate = 0.0; allowed: a number > 0 and <= 1"),
        ("aukf", {"alpha": -1.0}, "alpha = -1.0"),
        ("aukf_fading", {"b": 1.1}, "b = 1.1; allowed: a number > 0 and <= 1"),
        ("aukf_window", {"m": 1}, "m = 1; allowed: a whole number >= 2"),
        ("aukf_window", {"b": 0.0}, "b = 0.0; allowed: a number > 0 and <= 1"),
        ("augmented_aukf", {"M": 1.5}, "M = 1.5; allowed: a whole number >= 2"),
    ],
)
def test_settings_are_checked(name, settings, message):
    with pytest.raises(ValueError, match=message):
        make_filter(name, **settings)


def test_parts_may_be_given_as_a_string_or_one_by_one():
    assert make_filter("aukf", adapt=("Q", "R")).adapted == make_filter("aukf", adapt="QR").adapted == ("Q", "R")
    listed = make_filter("aukf", **json.loads('{"adapt": ["Q", "R"]}'))
    assert listed == make_filter("aukf", adapt=("Q", "R"))
    assert hash(listed) == hash(make_filter("aukf", adapt=("Q", "R")))
    assert make_filter("aukf", adapt="none").adapted == ()


def azimuth(solver):
    """RMS of the azimuth over 8 runs after 40 s of the task that tells a wrong noise."""
    task = get_task("sway-told-wrong-v0")
    env = task.make(8, duration=40.0)
    obs, _ = task.reset(env, range(8))
    solver.reset(env.unwrapped.task, [None] * 8, 8)
    done = False
    while not done:
        obs, _, _, truncated, info = env.step(solver.step(obs))
        done = truncated[0]
    return np.sqrt(np.mean(info["errors"]["phi"][:, 2] ** 2))


@pytest.fixture(scope="module")
def azimuth_of_ukf():
    return azimuth(solvers.make("ukf"))


@pytest.mark.parametrize("name", NAMES)
def test_alignment_told_the_wrong_noise(name, azimuth_of_ukf):
    """Nearer than the filter that believes what it is told, biases left alone."""
    solver = solvers.make(name)
    assert azimuth(solver) < 0.8 * azimuth_of_ukf
    told = solver.diagnostics()
    np.testing.assert_array_equal(told["Q"][:, 5:], 0.0)
    assert (told["Q"][:, :5] > 0).all()
    assert (solver.health().failed_at == -1).all()
    assert (solver.health().repairs == 0).all()
