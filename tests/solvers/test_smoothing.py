"""The smoother against the posterior of the whole trajectory, a textbook RTS, and the two-pass scheme of 000."""

import itertools

import numpy as np
import pytest
from oracles.problems import linear, look, run_of, spd, swing

from solvers.filters import FILTERS, make_filter
from solvers.filters.gaussian import GaussianFilter
from solvers.smoothing import Recorder, fixed_lag, smooth
from solvers.types import Gaussian, Linear, Measurement, Transition

PLAIN = [("kf", {}), ("ekf", {}), ("ukf", {}), ("ckf", {}), ("ckf5", {}), ("hinf_ukf", {"gamma2": np.inf})]


def steps_of(p):
    f, h = Linear(p.F, p.c), Linear(p.H, p.d)
    return [(Transition(f, p.Q), None if z is None else Measurement(z, h, p.R)) for z in p.z]


def whole_posterior(x, P, F, c, Q, H, d, R, measurements, until=None):
    """Mean and covariance of x_0 ... x_T, stacked, given the fixes up to ``until``: dense, in one go."""
    n, T = len(x), len(measurements)
    mean, cov = [x], np.zeros(((T + 1) * n, (T + 1) * n))
    cov[:n, :n] = P
    for j in range(T):
        a, b = slice(j * n, (j + 1) * n), slice((j + 1) * n, (j + 2) * n)
        mean.append(F @ mean[-1] + c)
        cov[b, : (j + 1) * n] = F @ cov[a, : (j + 1) * n]
        cov[: (j + 1) * n, b] = cov[b, : (j + 1) * n].T
        cov[b, b] = F @ cov[a, a] @ F.T + Q
    mean = np.concatenate(mean)
    seen = [j + 1 for j, z in enumerate(measurements[:until]) if z is not None]
    if not seen:
        return mean, cov
    M = np.zeros((len(seen) * len(R), len(mean)))
    for i, j in enumerate(seen):
        M[i * len(R) : (i + 1) * len(R), j * n : (j + 1) * n] = H
    S = M @ cov @ M.T + np.kron(np.eye(len(seen)), R)
    residual = np.concatenate([measurements[j - 1] - d for j in seen]) - M @ mean
    K = np.linalg.solve(S, M @ cov).T
    return mean + K @ residual, cov - K @ M @ cov


def textbook_rts(beliefs, predictions, F):
    """Dense RTS of one run, from (x, P) at 0..T and (x-, P-) at 1..T."""
    xs, Ps = [beliefs[-1][0]], [beliefs[-1][1]]
    for (x, P), (xp, Pp) in zip(beliefs[-2::-1], predictions[::-1], strict=True):
        G = P @ F.T @ np.linalg.inv(Pp)
        xs.append(x + G @ (xs[-1] - xp))
        Ps.append(P + G @ (Ps[-1] - Pp) @ G.T)
    return np.array(xs[::-1]), np.array(Ps[::-1])


@pytest.mark.parametrize(("name", "settings"), PLAIN)
def test_interval_smoothing_is_the_posterior_of_the_whole_trajectory(name, settings):
    p = linear(3, 4, 2, batch=(2,), steps=25)
    got = smooth(make_filter(name, **settings), Gaussian(p.x, p.P), steps_of(p))
    assert got.mean.shape == (26, 2, 4)
    assert got.cov.shape == (26, 2, 4, 4)
    assert got.gain.shape == got.noise.cov.shape == (25, 2, 4, 4)
    for i in range(2):
        mean, cov = whole_posterior(*run_of(p, i))
        F, c = p.F[i], p.c[i]
        for j in range(26):
            a = slice(4 * j, 4 * j + 4)
            np.testing.assert_allclose(got.mean[j, i], mean[a], atol=1e-9)
            np.testing.assert_allclose(got.cov[j, i], cov[a, a], atol=1e-9)
        for j in range(25):  # w_j = x_{j+1} - F x_j - c
            A = np.hstack([np.zeros((4, 4 * j)), -F, np.eye(4), np.zeros((4, 4 * (24 - j)))])
            np.testing.assert_allclose(got.noise.mean[j, i], A @ mean - c, atol=1e-9)
            np.testing.assert_allclose(got.noise.cov[j, i], A @ cov @ A.T, atol=1e-9)
    np.testing.assert_array_equal(got.health.failed_at, -1)
    np.testing.assert_array_equal(got.health.repairs, 0)


@pytest.mark.parametrize("lag", [0, 1, 4, 40])
@pytest.mark.parametrize("name", ["kf", "ukf"])
def test_fixed_lag_is_the_posterior_given_the_fixes_so_far(name, lag):
    p = linear(5, 3, 2, batch=(2,), steps=15)
    late = list(fixed_lag(make_filter(name), Gaussian(p.x, p.P), steps_of(p), lag))
    assert len(late) == 15
    for k, x in enumerate(late, start=1):
        a = slice(3 * max(k - lag, 0), 3 * max(k - lag, 0) + 3)
        for i in range(2):
            mean, cov = whole_posterior(*run_of(p, i), until=k)
            np.testing.assert_allclose(x.mean[i], mean[a], atol=1e-9)
            np.testing.assert_allclose(x.cov[i], cov[a, a], atol=1e-9)


def test_fixed_lag_takes_steps_as_they_come():
    """An endless stream: only as many steps are asked for as results."""
    p = linear(6, 3, 2, steps=1, missing=0.0)
    asked = itertools.count()
    stream = ((next(asked), steps_of(p)[0])[1] for _ in itertools.repeat(0))
    list(itertools.islice(fixed_lag(make_filter("ckf"), Gaussian(p.x, p.P), stream, 3), 7))
    assert next(asked) == 7


@pytest.mark.parametrize(
    ("name", "settings"), [("ckf", {}), ("hinf_kf", {}), ("hinf_ukf", {"gamma2": 40.0}), ("hinf_uif", {})]
)
def test_the_recursion_is_the_textbook_one_inflated_covariances_included(name, settings):
    p = linear(8, 4, 2, steps=40)
    flt = make_filter(name, **settings)
    got = smooth(flt, Gaussian(p.x, p.P), steps_of(p))
    b = flt.init(Gaussian(p.x, p.P))
    beliefs, predictions = [(b.mean, b.cov)], []
    for tr, me in steps_of(p):
        predictions.append((p.F @ b.mean + p.c, p.F @ b.cov @ p.F.T + p.Q))
        b, _ = flt.step(b, tr, me)
        beliefs.append((b.mean, b.cov))
    x, P = textbook_rts(beliefs, predictions, p.F)
    np.testing.assert_allclose(got.mean, x, atol=1e-10)
    np.testing.assert_allclose(got.cov, P, atol=1e-10)
    for mean, cov, (x, P) in zip(*got.filtered, beliefs, strict=True):
        np.testing.assert_array_equal(mean, x)
        np.testing.assert_array_equal(cov, P)


class TwoPass:
    """The pseudo-measurement smoother SPS, # 000 (4.3.38-56), misprints corrected, for one run of an unscented filter.

    Its points are those of (x, w) with c = n, which give f(x) + w the same moments as the 2n + 1 of x and Q apart.
    """

    def __init__(self, n):
        self.n = n
        self.w = np.full(4 * n + 1, 0.5 / n)
        self.w[0] = -1.0

    def points(self, x, P, Q):
        n = self.n
        root = np.zeros((2 * n, 2 * n))
        root[:n, :n], root[n:, n:] = np.linalg.cholesky(P), np.linalg.cholesky(Q)
        a = np.concatenate([x, np.zeros(n)])
        step = np.sqrt(n) * root.T
        chi = np.vstack([a, a + step, a - step])
        return chi[:, :n], chi[:, n:]

    def moments(self, y, x):
        mean = self.w @ y
        return mean, (y - mean).T @ (self.w[:, None] * (y - mean)), (x - self.w @ x).T @ (self.w[:, None] * (y - mean))

    def play(self, flt, x, P, f, h, Q, R, measurements):
        """x*, P*, w*, Q* of all steps. The filter's pass is ``flt``'s, its fixes are weighed here."""
        n = self.n
        b = flt.init(Gaussian(x, P))
        passed = [(b.mean, b.cov, np.zeros((0, n)), np.zeros(0))]
        for z in measurements:
            xp, Pp, _ = self.moments(*self.ahead(f, b.mean, b.cov, Q))
            b, _ = flt.step(b, Transition(f, Q), None if z is None else Measurement(z, h, R))
            K, v = np.zeros((n, 0)), np.zeros(0)
            if z is not None:
                chi, _ = self.points(xp, Pp, Q)
                y, Pyy, Pxy = self.moments(h(chi), chi)
                S = np.linalg.cholesky(Pyy + R).T  # P_yy = S'S
                K, v = Pxy @ np.linalg.inv(S), np.linalg.solve(S.T, z - y)  # square-root gain, (4.3.39) corrected
            passed.append((b.mean, b.cov, K.T, v))
        x_s, P_s, S, v = passed[-1]
        out = [(x_s, P_s)]
        noise = []
        for x, P, K_t, v_f in passed[-2::-1]:
            H = S @ np.linalg.inv(P_s)
            R_psi = np.eye(len(S)) + H @ S.T  # (4.3.41)
            chi, w = self.points(x, P, Q)
            psi_hat, Ppp, Pxp = self.moments((f(chi) + w) @ H.T, chi)
            Pwp = self.moments((f(chi) + w) @ H.T, w)[2]
            S_psi = np.linalg.cholesky(Ppp + R_psi).T  # (4.3.46) corrected
            psi = v + H @ x_s  # (4.3.48)
            v_psi = np.linalg.solve(S_psi.T, psi - psi_hat)
            K_x, K_w = Pxp @ np.linalg.inv(S_psi), Pwp @ np.linalg.inv(S_psi)
            x_s, P_s = x + K_x @ v_psi, P - K_x @ K_x.T  # (4.3.51-52)
            noise.append((K_w @ v_psi, Q - K_w @ K_w.T))
            out.append((x_s, P_s))
            rotation, S = np.linalg.qr(np.vstack([K_t, K_x.T]))  # (4.3.55)
            v = rotation.T @ np.concatenate([v_f, v_psi])  # (4.3.56)
        return *(np.array(a) for a in zip(*out[::-1], strict=True)), *(
            np.array(a) for a in zip(*noise[::-1], strict=True)
        )

    def ahead(self, f, x, P, Q):
        chi, w = self.points(x, P, Q)
        return f(chi) + w, chi


def two_smoothers(name, settings):
    rng = np.random.default_rng(4)
    n, T = 4, 30
    x, P, Q, R = rng.standard_normal(n), 0.3 * spd(rng, n), 0.02 * spd(rng, n), 0.2 * spd(rng, 2)
    z = [None if k in (4, 5, 11) else 0.5 * rng.standard_normal(2) for k in range(T)]
    flt = make_filter(name, **settings)
    steps = [(Transition(swing, Q), None if z_k is None else Measurement(z_k, look, R)) for z_k in z]
    return smooth(flt, Gaussian(x, P), steps), TwoPass(n).play(flt, x, P, swing, look, Q, R, z)


def test_the_two_pass_scheme_is_the_same_smoother():
    got, (x, P, w, Q) = two_smoothers("ukf", {})
    np.testing.assert_allclose(got.mean, x, atol=1e-9)
    np.testing.assert_allclose(got.cov, P, atol=1e-9)
    np.testing.assert_allclose(got.noise.mean, w, atol=1e-9)
    np.testing.assert_allclose(got.noise.cov, Q, atol=1e-9)
    assert np.abs(got.mean - got.filtered.mean).max() > 0.1  # or the test says nothing


def test_the_two_pass_scheme_is_another_one_for_an_h_infinity_filter():
    """000 section 4.3.3 takes the same form for both; its identities need P = P- - S'S. docs/mathematics/filters.md#smoothing"""
    got, (x, *_) = two_smoothers("hinf_ukf", {"gamma2": 10.0})
    assert np.abs(got.mean - x).max() > 1e-2
    same, (y, *_) = two_smoothers("hinf_ukf", {"gamma2": np.inf})
    np.testing.assert_allclose(same.mean, y, atol=1e-9)


SMOOTHABLE = [name for name, cls in FILTERS.items() if issubclass(cls, GaussianFilter) and cls.predicts_by_rule]


@pytest.mark.parametrize("name", SMOOTHABLE)
def test_every_gaussian_filter_smooths(name):
    """Rows of a batch are the runs alone; at the end nothing is gained, before it something is."""
    rng = np.random.default_rng(9)
    x, P = rng.standard_normal((3, 4)), 0.3 * spd(rng, 3, 4)
    z = 0.3 * rng.standard_normal((20, 3, 2))
    flt, tr, R = make_filter(name), Transition(swing, 0.02 * np.eye(4)), 0.2 * np.eye(2)

    def steps(i):
        return [(tr, None if k % 6 == 5 else Measurement(z[k][i], look, R)) for k in range(20)]

    got = smooth(flt, Gaussian(x, P), steps(slice(None)))
    np.testing.assert_array_equal(got.health.failed_at, -1)
    np.testing.assert_array_equal(got.mean[-1], got.filtered.mean[-1])
    np.testing.assert_array_equal(got.cov[-1], got.filtered.cov[-1])
    np.testing.assert_array_equal(got.cov, got.cov.mT)
    assert (np.linalg.eigvalsh(got.cov) > 0.0).all()
    trace = np.trace(got.cov, axis1=-2, axis2=-1), np.trace(got.filtered.cov, axis1=-2, axis2=-1)
    assert trace[0][:-1].mean() < 0.9 * trace[1][:-1].mean()
    for i in range(3):
        alone = smooth(flt, Gaussian(x[i], P[i]), steps(i))
        np.testing.assert_allclose(got.mean[:, i], alone.mean, rtol=0, atol=1e-12)
        np.testing.assert_allclose(got.cov[:, i], alone.cov, rtol=0, atol=1e-12)


def test_a_frozen_run_is_smoothed_up_to_its_last_good_state():
    p = linear(12, 4, 2, batch=(3,), steps=20, missing=0.0)
    p.z[9] = p.z[9].copy()
    p.z[9][1] = np.inf
    steps = steps_of(p)
    flt = make_filter("ckf")
    got = smooth(flt, Gaussian(p.x, p.P), steps)
    np.testing.assert_array_equal(got.health.failed_at, [-1, 10, -1])
    for i in (0, 2):
        mean, _ = whole_posterior(*run_of(p, i))
        np.testing.assert_allclose(got.mean[:, i].ravel(), mean, atol=1e-9)
    short = linear(12, 4, 2, batch=(3,), steps=20, missing=0.0)
    mean, _ = whole_posterior(*run_of(short, 1)[:-1], [z[1] for z in short.z[:9]])
    np.testing.assert_allclose(got.mean[:10, 1].ravel(), mean, atol=1e-9)
    np.testing.assert_array_equal(got.mean[10:, 1], got.filtered.mean[10:, 1])
    np.testing.assert_array_equal(got.mean[10:, 1], np.broadcast_to(got.mean[9, 1], (11, 4)))
    np.testing.assert_array_equal(got.gain[9:, 1], 0.0)
    np.testing.assert_array_equal(got.noise.mean[9:, 1], 0.0)
    for part in (got.mean, got.cov, got.gain, *got.noise):
        assert np.isfinite(part).all()
    late = list(fixed_lag(flt, Gaussian(p.x, p.P), steps, 3))
    np.testing.assert_array_equal(late[-1].mean[1], got.mean[9, 1])
    np.testing.assert_allclose(late[10].mean[1], got.mean[8, 1], atol=1e-12)  # state 8, when 9 was the last good one
    np.testing.assert_allclose(late[-1].mean[0], smooth(flt, Gaussian(p.x, p.P), steps).mean[17, 0], atol=1e-12)


def test_a_run_without_a_prior_is_kept_as_it_is():
    p = linear(13, 3, 2, batch=(2,), steps=6)
    p.x[1, 0] = np.nan
    got = smooth(make_filter("ukf"), Gaussian(p.x, p.P), steps_of(p))
    np.testing.assert_array_equal(got.health.failed_at, [-1, 0])
    np.testing.assert_array_equal(got.mean[:, 1], np.broadcast_to(p.x[1], (7, 3)))
    np.testing.assert_allclose(got.mean[:, 0].ravel(), whole_posterior(*run_of(p, 0))[0], atol=1e-9)


def test_smoothing_halves_the_error_on_a_nonlinear_system_and_knows_its_own():
    """64 runs, 60 steps: the RMS falls, and the normalised error squared stays near one (biased a little by the rule)."""
    rng = np.random.default_rng(21)
    B, T, n = 64, 60, 4
    P, Q, R = 0.2 * np.eye(n), 0.01 * np.eye(n), 0.3 * np.eye(2)
    x = np.sqrt(0.2) * rng.standard_normal((B, n))
    truth, steps = [x], []
    for _ in range(T):
        x = swing(x) + 0.1 * rng.standard_normal((B, n))
        truth.append(x)
        z = look(x) + np.sqrt(0.3) * rng.standard_normal((B, 2))
        steps.append((Transition(swing, Q), Measurement(z, look, R)))
    got = smooth(make_filter("ukf"), Gaussian(np.zeros((B, n)), P), steps)
    e, e_filter = got.mean - np.array(truth), got.filtered.mean - np.array(truth)
    middle = slice(5, 50)
    ratio = (e[middle] ** 2).sum() / (e_filter[middle] ** 2).sum()
    trace = (
        np.trace(got.cov[middle], axis1=-2, axis2=-1).sum()
        / np.trace(got.filtered.cov[middle], axis1=-2, axis2=-1).sum()
    )
    assert ratio == pytest.approx(trace, rel=0.15)
    assert ratio < 0.75
    nees = (e * np.linalg.solve(got.cov, e[..., None])[..., 0]).sum(-1)[middle].mean() / n
    assert 0.85 < nees < 1.15


def test_known_states_smooth_too():
    """Zero prior variance and zero noise: the gain's inverse does without them."""
    p = linear(14, 4, 2, steps=12)
    p.P[3, :] = p.P[:, 3] = 0.0
    p.Q[3, :] = p.Q[:, 3] = 0.0
    p.F[3, :] = p.F[:, 3] = 0.0
    p.F[3, 3] = 1.0
    p.c[3] = 0.0
    got = smooth(make_filter("kf"), Gaussian(p.x, p.P), steps_of(p))
    mean, _ = whole_posterior(p.x, p.P, p.F, p.c, p.Q, p.H, p.d, p.R, p.z)
    np.testing.assert_allclose(got.mean.ravel(), mean, atol=1e-9)
    np.testing.assert_array_equal(got.mean[:, 3], p.x[3])


def test_errors():
    p = linear(1, 3, 2, steps=2)
    prior = Gaussian(p.x, p.P)
    assert {"filterpy_kf", "gsf_ekf", "augmented_aukf", "gpf"} < set(FILTERS) - set(SMOOTHABLE)
    for name in set(FILTERS) - set(SMOOTHABLE):
        with pytest.raises(ValueError, match="cannot be smoothed; allowed: filters with one Gaussian"):
            smooth(make_filter(name), prior, steps_of(p))
    with pytest.raises(ValueError, match="steps: none given"):
        smooth(make_filter("ckf"), prior, [])
    with pytest.raises(ValueError, match="lag = -1; allowed: a whole number >= 0"):
        fixed_lag(make_filter("ckf"), prior, steps_of(p), -1)


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("kf", {}),
        ("aukf", {"adapt": "qQ"}),
        ("aukf_window", {"m": 5}),
        ("asmugsf", {}),
        ("hinf_ukf", {"gamma2": np.inf}),
    ],
)
@pytest.mark.parametrize("driven", [False, True])
def test_the_smoothed_noise_is_what_moves_the_smoothed_state(name, settings, driven):
    """x_{j+1} = F x_j + c + w_j holds of the smoothed means, whatever noise the filter takes w to be."""
    p = linear(21, 4, 2, batch=(3,), missing=0.2)
    G = np.array([[1.0, 0.0], [0.3, 0.0], [0.0, 1.0], [0.0, 0.0]]) if driven else None
    Q = 0.3 * G @ G.T if driven else p.Q
    steps = [
        (Transition(Linear(p.F, p.c), Q, G), z if z is None else Measurement(z, Linear(p.H, p.d), p.R)) for z in p.z
    ]
    got = smooth(make_filter(name, **settings), Gaussian(p.x, p.P), steps)
    moved = (p.F @ got.mean[:-1, ..., None])[..., 0] + p.c
    np.testing.assert_allclose(got.mean[1:], moved + got.noise.mean, rtol=0, atol=1e-7 * np.abs(got.mean).max())


class InNewOrigins:
    """A linear problem whose state moves after each fix, x = M y + o, with fixes of which a part may be missing."""

    def __init__(self, p, z, R):
        self.p, self.z, self.R = p, z, R
        n = p.x.shape[-1]
        self.M, self.o = np.broadcast_to(np.eye(n), p.F.shape), np.zeros_like(p.x)
        self.B = 1.1 * np.linalg.qr(np.random.default_rng(2).standard_normal((n, n)))[0]
        self.origins = []

    def play(self, recorder):
        p = self.p
        b = recorder.init(Gaussian(p.x, p.P))
        for z, R in zip(self.z, self.R, strict=True):
            to = np.linalg.inv(self.M)
            f = Linear(to @ p.F @ self.M, (to @ (p.F @ self.o[..., None] + (p.c - self.o)[..., None]))[..., 0])
            h = Linear(p.H @ self.M, (p.H @ self.o[..., None])[..., 0] + p.d)
            b, _ = recorder.step(b, Transition(f, to @ p.Q @ to.mT), None if z is None else Measurement(z, h, R))
            if z is not None:
                b = self.reset(recorder, b)
            self.origins.append((self.M, self.o))
        return recorder.estimate(b)

    def reset(self, recorder, b):
        found, B = recorder.estimate(b).mean, self.B
        after = recorder.relocate(
            b, Linear(B, -(B @ found[..., None])[..., 0]), lambda x: np.broadcast_to(B, self.M.shape)
        )
        self.o = (self.M @ found[..., None])[..., 0] + self.o
        self.M = self.M @ np.linalg.inv(B)
        return after


def test_a_closed_loop_is_the_posterior_of_the_whole_trajectory():
    """Moves after every fix, epochs without a fix, and fixes of which the second component is missing."""
    p = linear(22, 4, 2, batch=(2,), steps=20)
    partly = [k % 3 == 1 for k in range(20)]
    R = [p.R * np.diag([1.0, 0.0]) + np.diag([0.0, 1e15]) if short else p.R for short in partly]
    moved, recorder = InNewOrigins(p, p.z, R), Recorder(make_filter("kf"))
    last = moved.play(recorder)
    got = [last, *(x for x, _ in recorder.backward(last))][-2::-1]  # of the states 1 to T
    for i in range(2):
        x, P, F, c, Q, H, d, _, z = run_of(p, i)
        A, b = np.zeros((84, 84)), np.zeros(84)  # information of x_0 ... x_20

        def add(where, J, r, S, A=A, b=b):
            W = np.linalg.inv(S)
            A[where, where] += J.T @ W @ J
            b[where] += J.T @ W @ r

        add(slice(0, 4), np.eye(4), x, P)
        for k in range(20):
            add(slice(4 * k, 4 * k + 8), np.hstack([-F, np.eye(4)]), c, Q)
            if z[k] is not None:
                seen = 1 if partly[k] else 2
                add(slice(4 * k + 4, 4 * k + 8), H[:seen], (z[k] - d)[:seen], p.R[i, :seen, :seen])
        cov = np.linalg.inv(A)
        mean = cov @ b
        for k, ((M, o), y) in enumerate(zip(moved.origins, got, strict=True), start=1):
            a = slice(4 * k, 4 * k + 4)
            np.testing.assert_allclose(M[i] @ y.mean[i] + o[i], mean[a], atol=1e-8)
            np.testing.assert_allclose(M[i] @ y.cov[i] @ M[i].T, cov[a, a], atol=1e-8)
