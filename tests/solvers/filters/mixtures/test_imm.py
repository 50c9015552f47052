"""The interacting multiple models against a textbook IMM of dense loops."""

import numpy as np
import pytest
from oracles.problems import linear, run_of
from scipy.stats import multivariate_normal

from solvers.filters import make_filter
from solvers.types import Gaussian, Linear, Measurement, Transition

CHAIN = [[0.9, 0.1, 0.0, 0.0], [0.2, 0.5, 0.2, 0.1], [0.05, 0.05, 0.8, 0.1], [0.0, 0.0, 0.3, 0.7]]


def textbook(x, P, F, c, Q, H, d, R, measurements, models, chain):
    """One run of Bar-Shalom, Li & Kirubarajan (2001), section 11.6.6; ``models``: (factor of Q, factor of R)."""
    M = len(models)
    xs, Ps, mu = [x.copy() for _ in range(M)], [P.copy() for _ in range(M)], np.full(M, 1.0 / M)
    out = []
    for z in measurements:
        predicted = np.array([sum(chain[j][i] * mu[j] for j in range(M)) for i in range(M)])
        new_x, new_P, likelihood = [], [], np.ones(M)
        for i, (q, r) in enumerate(models):
            mix = [chain[j][i] * mu[j] / predicted[i] for j in range(M)]
            x0 = sum(mix[j] * xs[j] for j in range(M))
            P0 = sum(mix[j] * (Ps[j] + np.outer(xs[j] - x0, xs[j] - x0)) for j in range(M))
            x1, P1 = F @ x0 + c, F @ P0 @ F.T + q * Q
            if z is not None:
                S = H @ P1 @ H.T + r * R
                K = P1 @ H.T @ np.linalg.inv(S)
                likelihood[i] = multivariate_normal.pdf(z, H @ x1 + d, S)
                x1, P1 = x1 + K @ (z - H @ x1 - d), (np.eye(len(x)) - K @ H) @ P1
            new_x.append(x1)
            new_P.append(P1)
        xs, Ps = new_x, new_P
        mu = likelihood * predicted
        mu = mu / mu.sum()
        mean = sum(mu[i] * xs[i] for i in range(M))
        cov = sum(mu[i] * (Ps[i] + np.outer(xs[i] - mean, xs[i] - mean)) for i in range(M))
        out.append((mean, cov, mu))
    return out


def play(flt, p):
    b = flt.init(Gaussian(p.x, p.P), None)
    history = []
    for z in p.z:
        me = None if z is None else Measurement(z, Linear(p.H, p.d), p.R)
        b, _ = flt.step(b, Transition(Linear(p.F, p.c), p.Q), me)
        history.append(b)
    return history


@pytest.mark.parametrize("name", ["imm_ekf", "imm_ukf"])
@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
@pytest.mark.parametrize(
    "settings",
    [
        {"q_factors": [1.0, 10.0], "r_factors": [1.0, 10.0], "stay": 0.9},
        {"q_factors": [0.1, 5.0], "r_factors": [1.0, 30.0], "transition": CHAIN},
        {"q_factors": [1.0], "r_factors": [0.5, 3.0, 50.0]},
    ],
)
def test_it_is_the_textbook_imm(name, batch, settings):
    """With fixes missing, noise that fits no model, and a chain with zeros that is not symmetric."""
    p = linear(5, 4, 2, batch, steps=30)
    flt = make_filter(name, **settings)
    chain = settings.get("transition")
    if chain is None:
        M = len(flt.models)
        stay = settings.get("stay", flt.stay)
        chain = [[stay if i == j else (1.0 - stay) / (M - 1) for i in range(M)] for j in range(M)]
    history = play(flt, p)
    moved = False
    for i in np.ndindex(batch):
        for b, (mean, cov, mu) in zip(history, textbook(*run_of(p, i), flt.models, chain), strict=True):
            got = flt.estimate(b)
            np.testing.assert_allclose(got.mean[i], mean, atol=1e-10)
            np.testing.assert_allclose(got.cov[i], cov, atol=1e-10)
            np.testing.assert_allclose(flt.diagnostics(b)["mode_probabilities"][i], mu, atol=1e-10)
            moved |= mu.max() > 0.8
    assert moved


@pytest.mark.parametrize("which", ["Q", "R"])
def test_it_notices_a_jump_of_the_noise_and_that_it_ends(which):
    """A noise that is 30 times as large for a while: its model becomes the likely one, and the estimate gains by it."""
    rng = np.random.default_rng(0)
    runs, F, H, Q, R = 60, np.array([[1.0, 0.1], [0.0, 0.9]]), np.eye(2), 0.1 * np.eye(2), 0.5 * np.eye(2)
    factors = {"Q": {"q_factors": [1.0, 30.0], "r_factors": [1.0]}, "R": {"q_factors": [1.0], "r_factors": [1.0, 30.0]}}
    flt, kf = make_filter("imm_ukf", **factors[which], stay=0.95), make_filter("kf")
    prior = Gaussian(np.zeros((runs, 2)), np.broadcast_to(np.eye(2), (runs, 2, 2)))
    b, k = flt.init(prior), kf.init(prior)
    x = rng.standard_normal((runs, 2))
    likely, mine, its = [], [], []
    for t in range(150):
        factor = 30.0 if 50 <= t < 100 else 1.0
        q, r = (factor, 1.0) if which == "Q" else (1.0, factor)
        x = x @ F.T + np.sqrt(q * 0.1) * rng.standard_normal((runs, 2))
        z = x + np.sqrt(r * 0.5) * rng.standard_normal((runs, 2))
        tr, me = Transition(Linear(F), Q), Measurement(z, Linear(H), R)
        (b, _), (k, _) = flt.step(b, tr, me), kf.step(k, tr, me)
        likely.append(flt.diagnostics(b)["mode_probabilities"][:, 1].mean())
        mine.append(np.square(flt.estimate(b).mean - x).mean())
        its.append(np.square(k.mean - x).mean())
    assert max(likely[20:50]) < 0.25
    assert min(likely[60:100]) > 0.75
    assert max(likely[115:]) < 0.25
    assert np.mean(mine[50:100]) < 0.85 * np.mean(its[50:100])
    assert np.mean(mine[20:50]) < 1.1 * np.mean(its[20:50])
    name, factor = ("q_factor", "r_factor") if which == "Q" else ("r_factor", "q_factor")
    shown = flt.diagnostics(b)
    np.testing.assert_allclose(shown[name], 1.0 + 29.0 * b.weights[:, 1])
    np.testing.assert_allclose(shown[factor], 1.0)


def test_a_missing_fix_leaves_the_chains_prediction():
    flt = make_filter("imm_ekf", q_factors=[1.0, 4.0], r_factors=[1.0], transition=[[0.9, 0.1], [0.4, 0.6]])
    b = flt.init(Gaussian(np.zeros(2), np.eye(2)))
    for mu in ([0.65, 0.35], [0.725, 0.275]):
        b, innovation = flt.step(b, Transition(Linear(np.eye(2)), np.eye(2)), None)
        assert innovation is None
        np.testing.assert_allclose(flt.diagnostics(b)["mode_probabilities"], mu)


def test_a_model_that_cannot_be_reached_stays_out():
    """An absorbing chain leaves the second model without probability; nothing divides by it."""
    flt = make_filter("imm_ekf", q_factors=[1.0, 4.0], r_factors=[1.0], transition=[[1.0, 0.0], [1.0, 0.0]])
    p = linear(6, 4, 2, (3,), missing=0.0)
    b, kf = play(flt, p)[-1], make_filter("kf")
    np.testing.assert_array_equal(flt.diagnostics(b)["mode_probabilities"], [[1.0, 0.0]] * 3)
    np.testing.assert_allclose(flt.estimate(b).mean, play(kf, p)[-1].mean, atol=1e-12)
    assert np.isfinite(b.mean).all()


def test_a_fix_that_no_model_expects_is_no_underflow():
    flt = make_filter("imm_ekf")
    b = flt.init(Gaussian(np.zeros(2), 1e-4 * np.eye(2)))
    tr = Transition(Linear(np.eye(2)), 1e-6 * np.eye(2))
    b, _ = flt.step(b, tr, Measurement(np.full(2, 100.0), Linear(np.eye(2)), 1e-4 * np.eye(2)))
    assert b.health.failed_at == -1
    assert flt.diagnostics(b)["mode_probabilities"].sum() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"q_factors": []}, r"q_factors = \[\]; allowed: finite numbers > 0, at least one"),
        ({"r_factors": [1.0, 0.0]}, r"r_factors = \[1.0, 0.0\]; allowed"),
        ({"q_factors": 3.0}, "q_factors = 3.0; allowed: finite numbers > 0"),
        ({"stay": 1.5}, "stay = 1.5; allowed: a number > 0 and <= 1"),
        ({"transition": [[1.0]]}, "allowed: None, or 4 rows of 4 probabilities that sum to one"),
        ({"transition": [[0.5] * 4] * 4}, "allowed: None, or 4 rows of 4"),
    ],
)
def test_settings_are_checked(settings, message):
    with pytest.raises(ValueError, match=message):
        make_filter("imm_ukf", **{"q_factors": [1.0, 2.0], "r_factors": [1.0, 2.0], **settings})
