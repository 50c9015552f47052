"""The benchmark of 002: what the printed system does, and what the literal filter does to it.
docs/mathematics/filters.md#benchmark-of-002"""

import numpy as np
import pytest

from solvers.filters import make_filter
from solvers.filters.adaptive.aukf import LITERAL
from solvers.toy_models import OVERFLOW, START, Benchmark002, changing_R

RUNS = 200


def share(p, runs=RUNS):
    """Three standard errors of a share ``p`` of ``runs``, added to those of the 40 runs that
    docs/mathematics/filters.md#benchmark-of-002 counted."""
    return 3 * np.sqrt(p * (1 - p) / runs + p * (1 - p) / 40)


@pytest.mark.parametrize(("Q", "exploded"), [(0.4, 0.97), (0.2, 0.67), (0.1, 0.05), (0.04, 0.0)])
def test_the_printed_system_explodes(Q, exploded):
    truth = Benchmark002("literal", Q=Q).simulate(np.random.default_rng(1), RUNS)
    over = truth.ended > 0
    assert abs(over.mean() - exploded) <= share(exploded) + 0.01
    for i in range(RUNS):
        end = truth.ended[i] - 1 if over[i] else 300
        assert (np.abs(truth.x[:end, i]) <= OVERFLOW).all()
        assert (np.abs(truth.z[:end, i]) <= OVERFLOW).all()
        assert np.isnan(truth.x[end:, i]).all()
        assert np.isnan(truth.z[end:, i]).all()
    if Q == 0.4:
        assert 40 < np.median(truth.ended[over]) < 72  # docs/mathematics/filters.md#benchmark-of-002: 56


@pytest.mark.parametrize("variant", ["small_q", "abs"])
def test_the_other_variants_stay_bounded(variant):
    truth = Benchmark002(variant).simulate(np.random.default_rng(2), RUNS)
    assert (truth.ended == 0).all()
    assert np.abs(truth.x).max() < 1e3


def test_the_maps_are_those_of_the_paper():
    x = np.array([[0.3, -0.7, 0.4], [0.5, 1.0, 1.0]])
    for variant, sign in (("literal", 1.0), ("abs", -1.0)):
        model = Benchmark002(variant)
        for row, f, h in zip(x, model.f(x), model.h(x), strict=True):
            p = row[1] * row[2] if sign > 0 else abs(row[1] * row[2])
            np.testing.assert_allclose(f, [np.cos(50 / (1 + p)), 2 * row[0] ** 2 * np.exp(-p), np.sin(row[2])])
            np.testing.assert_allclose(h, [row[0] + np.exp(-3 * p)])
        np.testing.assert_allclose(model.f(x[None]), model.f(x)[None])


def test_the_noise_is_as_stated():
    """One step from the start, 20,000 runs: x - f(x0) is w in all states, z - h(x) is v; 4 standard errors."""
    model, runs = Benchmark002("abs"), 20_000
    truth = model.simulate(np.random.default_rng(3), runs, steps=1)
    w = truth.x[0] - model.f(START)
    np.testing.assert_allclose(w, w[:, :1] * np.ones(3), atol=1e-12)
    for sample, mean, var in ((w[:, 0], 0.2, 0.4), ((truth.z[0] - model.h(truth.x[0]))[:, 0], 0.3, 0.5)):
        assert abs(sample.mean() - mean) < 4 * np.sqrt(var / runs)
        assert abs(sample.var() / var - 1) < 4 * np.sqrt(2 / runs)


def test_example_1_as_printed_and_safeguarded():
    model = Benchmark002("abs")
    truth = model.simulate(np.random.default_rng(4), RUNS)
    told = {"Q": 0.2, "R": 0.5, "r": 0.3}
    literal = model.track(make_filter("aukf", adapt="qQ", **LITERAL), truth.z, **told)
    negative = (literal.noise["Q"] < 0).any(axis=0).ravel()
    assert abs(negative.mean() - 7 / 40) < share(7 / 40)
    ended = literal.health.failed_at >= 0
    assert ((literal.health.repairs > 0) | ended)[negative].all()
    guarded = model.track(make_filter("aukf", adapt="qQ"), truth.z, **told)
    assert (guarded.noise["Q"] > 0).all()
    assert (guarded.health.repairs == 0).all()
    assert not guarded.health.frozen
    q, Q = guarded.noise["q"][-1].ravel(), guarded.noise["Q"][-1].ravel()
    assert abs(q.mean() - 0.12) < 3 * 0.04 / np.sqrt(
        40
    )  # docs/mathematics/filters.md#benchmark-of-002, 40 runs: .12 +- .04, .29
    assert 0.25 < Q.mean() < 0.33
    right = model.track(make_filter("ukf"), truth.z, q=0.2, Q=0.4, R=0.5, r=0.3)
    wrong = model.track(make_filter("ukf"), truth.z, **told)
    rms = [np.sqrt(np.mean((t.mean - truth.x)[..., 2] ** 2)) for t in (right, guarded, wrong)]
    assert rms[0] < rms[1] < rms[2]  # x3: .835, .841, .972 there


def test_example_2_as_printed_and_safeguarded():
    assert [changing_R(k) for k in (1, 59, 60, 119, 120, 189, 190, 249, 250, 300)] == [
        0.5, 0.5, 0.9, 0.9, 0.3, 0.3, 0.7, 0.7, 0.5, 0.5]  # fmt: skip
    model = Benchmark002("abs")
    truth = model.simulate(np.random.default_rng(5), RUNS, R=changing_R)
    told = {"q": 0.2, "Q": 0.4, "r": 0.3, "R": 1.0}
    literal = model.track(make_filter("aukf_fading", adapt="R", b=0.95, **LITERAL), truth.z, **told)
    negative = (literal.noise["R"] < 0).any(axis=0).ravel()
    assert abs(negative.mean() - 20 / 40) < share(20 / 40)
    assert (literal.health.failed_at >= 0).any()
    assert np.isfinite(literal.mean).all()  # frozen, not lost
    guarded = model.track(make_filter("aukf_fading", adapt="R", b=0.95), truth.z, **told)
    assert (guarded.noise["R"] > 0).all()
    assert (guarded.health.repairs == 0).all()
    ends = np.median(guarded.noise["R"], axis=1).ravel()[[58, 118, 188, 248, 298]]
    assert (np.diff(ends) * [1, -1, 1, -1] > 0).all()  # follows every change
    np.testing.assert_allclose(ends, [0.76, 1.20, 0.58, 0.90, 0.79], atol=0.15)


def test_an_exploding_run_freezes_its_filter_and_no_other():
    model = Benchmark002("literal", Q=0.2)
    truth = model.simulate(np.random.default_rng(6), 20)
    over = truth.ended > 0
    assert 0 < over.sum() < 20
    z = np.where(np.isnan(truth.z), np.inf, truth.z)  # an overflow; NaN would be a fix that is missing
    track = model.track(make_filter("aukf"), z, Q=0.2, R=0.5)
    failed = track.health.failed_at
    assert (failed[over] >= 1).all()
    assert (failed[over] <= truth.ended[over]).all()


def test_one_run_without_a_batch():
    model = Benchmark002("abs")
    z = model.simulate(np.random.default_rng(7), 1, steps=20).z
    whole = model.track(make_filter("aukf"), z, Q=0.2, R=0.5)
    one = model.track(make_filter("aukf"), z[:, 0], Q=0.2, R=0.5)
    np.testing.assert_allclose(whole.mean[:, 0], one.mean, atol=1e-12)


def test_an_unknown_variant_is_refused():
    with pytest.raises(ValueError, match="unknown variant 'bas'; did you mean 'abs'"):
        Benchmark002("bas")
