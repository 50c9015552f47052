"""Robust filters: what they gain and cost on contaminated tracking (docs/mathematics/filters.md#robust-updates), and
that they do not lock out the truth."""

import json

import numpy as np
import pytest
from scipy.stats import norm

from solvers.filters import make_filter
from solvers.types import Gaussian, Linear, Measurement, NoiseLaw, Transition

F, Q = np.kron([[1.0, 1.0], [0.0, 1.0]], np.eye(2)), 0.01 * np.kron([[1 / 3, 1 / 2], [1 / 2, 1.0]], np.eye(2))
H, R = np.eye(2, 4), np.eye(2)
RUNS, EPOCHS = 60, 120


def world(seed, share=0.0, factor=10.0, Q=Q, start=0.0, epochs=EPOCHS, runs=RUNS):
    """Truth (epochs, runs, 4) and fixes (epochs, runs, 2) of points at constant velocity; whole fixes are contaminated."""
    rng = np.random.default_rng(seed)
    x, L = rng.standard_normal((runs, 4)) + start, np.linalg.cholesky(Q)
    truth, fixes = [], []
    for _ in range(epochs):
        x = x @ F.T + rng.standard_normal((runs, 4)) @ L.T
        scale = np.where(rng.random((runs, 1)) < share, np.sqrt(factor), 1.0)
        truth.append(x)
        fixes.append(x[:, :2] + scale * rng.standard_normal((runs, 2)))
    return np.array(truth), np.array(fixes), Q


def track(name, world, law=None, **settings):
    """Errors (epochs, runs, 4) and the last belief."""
    truth, fixes, Q = world
    flt = make_filter(name, **settings)
    b = flt.init(Gaussian(np.zeros(truth.shape[1:]), np.eye(4)))
    errors = []
    for x, z in zip(truth, fixes, strict=True):
        b, _ = flt.step(b, Transition(Linear(F), Q), Measurement(z, Linear(H), R, law))
        errors.append(flt.estimate(b).mean - x)
    return np.array(errors), b


def squares(name, *args, **settings):
    """Mean square position error of each run."""
    return np.square(track(name, *args, **settings)[0][20:, :, :2]).sum(-1).mean(0)


def ratio(a, b):
    """RMS of a over that of b in the same runs, and how many paired standard errors a's is smaller."""
    apart = b - a
    return np.sqrt(a.mean() / b.mean()), apart.mean() / (apart.std(ddof=1) / np.sqrt(len(a)))


ROBUST = [
    ("huber_ckf", {}, 0.85),
    ("mcc_ckf", {}, 0.87),
    ("mcc_ckf", {"sigma": 2.0}, 0.86),
    ("mcc_ckf", {"robust": "meas"}, 0.86),
    ("student_t_ckf", {}, 0.81),
    ("gm_ekf", {}, 0.77),
    ("gm_ekf", {"contamination": "learn"}, 0.78),
]


@pytest.fixture(scope="module")
def contaminated():
    w = world(1, share=0.2)
    return w, squares("ckf", w)


@pytest.mark.parametrize(("name", "settings", "expected"), ROBUST)
def test_robust_filters_win_on_contaminated_fixes(contaminated, name, settings, expected):
    w, plain = contaminated
    found, sigmas = ratio(squares(name, w, NoiseLaw(0.2, 10.0), **settings), plain)
    assert sigmas > 4.0
    assert found == pytest.approx(expected, abs=0.04)


def test_who_knows_the_mixture_is_best(contaminated):
    w, plain = contaminated
    best = squares("gm_ekf", w, NoiseLaw(0.2, 10.0))
    for name, settings, _ in ROBUST[:5]:
        assert ratio(best, squares(name, w, **settings))[1] > 3.0
    matched = squares("gm_ekf", w, NoiseLaw(1.0, 2.8))  # R of the same total variance: consistent, not efficient
    assert ratio(matched, plain)[0] == pytest.approx(1.0, abs=0.06)


def test_kernel_widths_rank_as_in_e19(contaminated):
    """CKF .922; sigma 1: 1.013, 2: .777, 3: .807, 4: .850, 6: .893."""
    w, plain = contaminated
    ratios = [ratio(squares("mcc_ckf", w, sigma=s), plain)[0] for s in (1.0, 2.0, 3.0, 4.0, 6.0)]
    np.testing.assert_allclose(ratios, np.array([1.013, 0.777, 0.807, 0.850, 0.893]) / 0.922, atol=0.08)
    assert ratios[0] > 1.0 > ratios[4] > ratios[3] > ratios[2]  # too narrow harms, wide does little


def test_gross_errors_are_kept_out():
    w = world(2, share=0.2, factor=100.0)
    plain = squares("ckf", w)
    for name in ("huber_ckf", "mcc_ckf", "student_t_ckf", "gm_ekf"):
        found, sigmas = ratio(squares(name, w, NoiseLaw(0.2, 100.0)), plain)
        assert found < 0.55
        assert sigmas > 4.0


@pytest.mark.parametrize(("name", "most"), [("mcc_ckf", 1.01), ("huber_ckf", 1.04), ("student_t_ckf", 1.08)])
def test_what_robustness_costs_on_gaussian_fixes(name, most):
    w = world(3)
    found, sigmas = ratio(squares(name, w), squares("ckf", w))
    assert found < most
    assert sigmas < -1.0  # it does cost


SLOW = 1e-6 * Q / 0.01  #: process noise so small that a covariance does not grow back by itself


@pytest.mark.parametrize(
    ("name", "settings"),
    [
        ("mcc_ckf", {"robust": "meas"}),
        ("mcc_ckf", {"robust": "meas", "sigma": 1.0}),
        ("huber_ckf", {"robust": "meas"}),
        ("student_t_ckf", {}),
    ],
)
def test_the_guard_brings_back_a_filter_that_locks_out_the_truth(name, settings):
    """A start 30 sigma off: every fix looks bad. Without patience the filter goes its own way; with it, it recovers."""
    w = world(4, Q=SLOW, start=np.array([30.0, 0.0, 3.0, 0.0]), epochs=300, runs=20)
    for patience, limit in ((20, 1.0), (100, 1.5)):
        errors, b = track(name, w, patience=patience, **settings)
        assert b.health.fallbacks.any()
        if settings.get("sigma") != 1.0:
            assert np.sqrt(np.square(errors[-50:, :, :2]).sum(-1).mean(0)).max() < limit
    errors, b = track(name, w, patience=10**6, **settings)
    assert np.abs(errors[80:100, :, :2]).max() > 10.0


def test_a_kernel_that_is_too_narrow_does_not_diverge_in_silence():
    w = world(5, Q=SLOW, start=np.array([30.0, 0.0, 3.0, 0.0]), epochs=300, runs=20)
    for settings in ({"sigma": 0.5}, {"sigma": 0.5, "robust": "meas"}, {"sigma": 1.0, "robust": "meas"}):
        errors, b = track("mcc_ckf", w, patience=20, **settings)
        off = np.sqrt(np.square(errors[-50:, :, :2]).sum(-1).mean(0)) > 3.0
        assert (b.health.fallbacks[off] > 0).all()
        assert np.abs(errors[-1, :, :2]).max() < 100.0


def one_fix(flt, b, z, R=R):
    return flt.step(b, Transition(Linear(np.eye(4)), 1e-6 * np.eye(4)), Measurement(z, Linear(H), R))


def test_the_guard_waits_opens_and_closes():
    """Bad fixes are ignored up to the patience, then believed until one is within the gate; the counts say so."""
    flt = make_filter("mcc_ckf", robust="meas", patience=3)
    b = flt.init(Gaussian(np.zeros((2, 4)), 0.01 * np.eye(4)))
    z = np.array([[50.0, 0.0], [0.0, 0.0]])
    for k in range(1, 4):
        b, _ = one_fix(flt, b, z)
        assert abs(b.mean[0, 0]) < 1e-3
        np.testing.assert_array_equal(flt.diagnostics(b)["outside"], [k, 0])
        np.testing.assert_array_equal(b.health.fallbacks, 0)
    b, _ = one_fix(flt, b, z)
    assert b.mean[0, 0] == pytest.approx(50.0, abs=0.1)  # the covariance is widened to what the fix asks for
    assert b.cov[0, 0, 0] > 0.5
    np.testing.assert_array_equal(b.health.fallbacks, [1, 0])
    b, _ = one_fix(flt, b, z)
    np.testing.assert_array_equal(b.outside, 0)
    np.testing.assert_array_equal(b.health.fallbacks, [1, 0])


def test_a_fix_without_weight_is_skipped_and_counted():
    flt = make_filter("mcc_ckf", robust="meas")
    b = flt.init(Gaussian(np.ones((3, 4)), np.eye(4)))
    prior = flt.predict(b, Transition(Linear(F), Q))
    after, _ = flt.correct(prior, Measurement(np.array([[1e4, -1e4], [1e4, 2.0], [2.0, 2.0]]), Linear(H), R))
    np.testing.assert_array_equal(after.health.fallbacks, [1, 0, 0])
    np.testing.assert_array_equal(after.mean[0], prior.mean[0])
    np.testing.assert_array_equal(after.cov[0], prior.cov[0])
    assert after.cov[1, 1, 1] < 0.8 * prior.cov[1, 1, 1]  # its other component is used
    assert after.weight[0] < 1e-7 < 0.4 < after.weight[1] < 0.6 < after.weight[2]


def test_the_fifth_degree_pair_has_the_settings_of_the_third():
    for name, field, value in (("mcc_ckf5", "sigma", 2.0), ("huber_ckf5", "alpha", 2.0)):
        flt = make_filter(name, **{field: value, "robust": "meas", "patience": 7, "rounds": 5})
        assert flt.third == make_filter(name[:-1], **{field: value, "robust": "meas", "patience": 7, "rounds": 5})


@pytest.mark.parametrize("z", [-4.0, 0.3, 2.0, 7.0])
@pytest.mark.parametrize(("share", "factor"), [(0.2, 10.0), (0.05, 100.0), (0.5, 3.0)])
def test_the_mixture_update_is_bayes(z, share, factor):
    """Mean and variance of the exact posterior in one dimension, by quadrature."""
    x = np.linspace(-30.0, 30.0, 60001)
    noise = (1 - share) * norm.pdf(z - x, scale=np.sqrt(0.5)) + share * norm.pdf(z - x, scale=np.sqrt(0.5 * factor))
    p = norm.pdf(x, 1.0, 1.5) * noise
    p /= p.sum()
    flt = make_filter("gm_ekf")
    b = flt.init(Gaussian(np.array([1.0]), np.array([[2.25]])))
    me = Measurement(np.array([z]), Linear(np.eye(1)), np.array([[0.5]]), NoiseLaw(share, factor))
    told, innovation = flt.correct(b, me)
    given, _ = make_filter("gm_ekf", contamination=[share, factor]).correct(b, me._replace(law=None))
    mean = p @ x
    np.testing.assert_allclose(told.mean, [mean], atol=1e-8)
    np.testing.assert_allclose(told.cov, [[p @ (x - mean) ** 2]], atol=1e-8)
    np.testing.assert_array_equal(told.mean, given.mean)
    assert 0.0 < told.suspicion < 1.0
    np.testing.assert_allclose(innovation.cov, [[2.25 + 0.5 * (1 + share * (factor - 1))]])


@pytest.mark.parametrize(("share", "bias"), [(0.0, 0.03), (0.2, 0.03), (0.5, 0.12)])
def test_the_share_is_learnt(share, bias):
    """From 0.1, slowly: the rule forgets its start like the fixes tell, not like their number."""
    w = world(6, share=share, epochs=600, runs=40)
    _, b = track("gm_ekf", w, contamination="learn")
    np.testing.assert_allclose(b.share.mean(), share, atol=bias)
    assert b.share.std() < 3 * np.sqrt(0.25 / 600)
    np.testing.assert_array_equal(b.fixes, 620.0)


def test_a_blind_fix_teaches_nothing():
    """The pipeline tells of a missing fix by a huge R where other runs have one."""
    flt = make_filter("gm_ekf", contamination="learn")
    b = flt.init(Gaussian(np.zeros((2, 4)), np.eye(4)))
    wide = np.stack([R, 1e20 * R])
    after, _ = one_fix(flt, b, np.zeros((2, 2)), wide)
    assert after.share[0] < b.share[0]
    assert after.share[1] == b.share[1]
    np.testing.assert_array_equal(after.fixes - b.fixes, [1.0, 0.0])


def test_a_student_t_that_is_told_is_no_mixture():
    w = world(7, epochs=20, runs=3)
    for law in (None, NoiseLaw(dof=3.0)):
        np.testing.assert_array_equal(track("gm_ekf", w, law)[0], track("ekf", w)[0])


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("mcc_ckf", {"sigma": 0.3}, "sigma = 0.3; allowed: a number >= 0.5, or inf"),
        ("huber_ckf", {"robust": "prior"}, "unknown robust 'prior'"),
        ("huber_ckf5", {"alpha": -1.0}, "alpha = -1.0"),
        ("student_t_ckf", {"dof": 0}, "dof = 0"),
        ("mcc_ckf", {"rounds": 0}, "rounds = 0; allowed: a whole number >= 1"),
        ("mcc_ckf", {"patience": 2.5}, "patience = 2.5; allowed: None, or a whole number >= 1"),
        ("mcc_ckf", {"gate": 1.1}, "gate = 1.1; allowed: a number >= 0.5 and <= 1"),
        ("mcc_ckf", {"root": "qr"}, "unknown root 'qr'"),
        ("gm_ekf", {"contamination": "tell"}, r"contamination = 'tell'; allowed: 'told', 'learn', or a pair"),
        ("gm_ekf", {"contamination": [1.5, 10.0]}, "contamination: share = 1.5; allowed: a number >= 0 and <= 1"),
        ("gm_ekf", {"contamination": [0.2, 0.5]}, "factor = 0.5"),
        ("gm_ekf", {"factor": 0.0}, "factor = 0.0"),
        ("gm_ekf", {"memory": 0}, "memory = 0"),
    ],
)
def test_settings_are_checked(name, settings, message):
    with pytest.raises(ValueError, match=message):
        make_filter(name, **settings)


def test_a_pair_from_json_is_as_good_as_a_tuple():
    pair = make_filter("gm_ekf", **json.loads('{"contamination": [0.2, 10]}'))
    assert pair == make_filter("gm_ekf", contamination=(0.2, 10))
    assert hash(pair) == hash(make_filter("gm_ekf", contamination=(0.2, 10)))
