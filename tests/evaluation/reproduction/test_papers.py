"""The tables of 001, 002 and 003: printed quotients, what is read off the runs beside plain NumPy, figures, and a slice."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from sins_env.evaluation import evaluate
from sins_env.evaluation.reproduction import get_table
from sins_env.evaluation.reproduction.documents import lu, sun2012, zhao2010
from sins_env.evaluation.reproduction.pictures.navigation import Curve, Row, against_setting, rms_over_time
from sins_env.evaluation.reproduction.readings import common
from sins_env.evaluation.reproduction.tables import Line, Source
from sins_env.evaluation.reproduction.verdicts import NOT, OPEN, REPRODUCED, Said, median, ratio, verdicts
from sins_env.evaluation.score.losses import of_time_means, score
from sins_env.evaluation.score.navigation import time_mean
from sins_env.evaluation.tasks.task import EvaluationTask
from solvers import toy_examples
from solvers.toy_models import changing_R

RUNS = 12


def short(task: EvaluationTask) -> EvaluationTask:
    kwargs = {**task.kwargs, "duration": 20.0}
    return dataclasses.replace(task, name="short-flight-v0", kwargs=kwargs, hold_s=5.0, score_from_s=5.0)


@pytest.fixture(scope="module")
def flown():
    task = short(sun2012.DRAWN)
    return {
        label: evaluate(task, label, RUNS, settings=settings, workers=1, cost=False)
        for label, settings in {"ekf": {}, "ckf": {}, "ukf": {"kappa": 0.0}}.items()
    }


def test_printed_quotients_of_001():
    (quotients,) = [group for group in get_table("001").groups if group.title.startswith("quotients, as printed")]
    printed = {line.label: line.printed for line in quotients.lines}
    for name, value in (
        ("pitch", 0.973),
        ("roll", 0.961),
        ("heading", 0.971),
        ("position", 0.951),
        ("velocity", 0.919),
    ):
        assert printed[f"{name}, CKF / EKF"].value == pytest.approx(value, abs=5e-4)


def means(results, parts):
    """ARMSE in plain NumPy, after 5 s."""
    late = results.records.criteria.history_t > 5.0 + 1e-6
    errors = results.records.history[:, late][:, :, parts].astype(float)
    return np.sqrt((errors**2).sum(axis=-1).mean(axis=0)).mean()


def test_quotients_of_time_means(flown):
    ekf, ckf = flown["ekf"], flown["ckf"]
    for name, parts in (("position", [6, 7, 8]), ("velocity", [3, 4, 5])):
        found = common.ratio_of_armse(name)(ckf, ekf)
        assert found.value == pytest.approx(means(ckf, parts) / means(ekf, parts), rel=1e-9)
        assert common.armse(name)(ckf).value == pytest.approx(means(ckf, parts), rel=1e-9)
    same = common.ratio_of_armse("azimuth")(flown["ukf"], ckf)
    assert (same.value, same.runs) == (pytest.approx(1.0, abs=1e-6), RUNS)


def test_cost_in_a_batch_and_failures(flown):
    steps = [np.median(flown[label].records.step_s) for label in ("ckf", "ekf")]
    found = common.batch_cost_against(flown["ckf"], flown["ekf"])
    assert found == (steps[0] / steps[1],) * 3 + (RUNS, *found[4:])
    assert common.failed(flown["ekf"]).value == pytest.approx(100 * flown["ekf"].records.failed.mean())


def test_the_interval_of_a_quotient_is_that_of_resampled_runs():
    rng = np.random.default_rng(3)
    scale = np.exp(0.5 * rng.standard_normal((60, 1)))
    b = scale * np.abs(rng.standard_normal((60, 30)))
    a = 0.9 * b * np.exp(0.1 * rng.standard_normal((60, 1)))

    def quotient(i):
        return np.mean(np.sqrt(np.mean(a[i] ** 2, axis=0))) / np.mean(np.sqrt(np.mean(b[i] ** 2, axis=0)))

    losses_a, losses_b = (of_time_means(errors, 1e9) for errors in (a, b))
    value, low, high, *_ = ratio(losses_a, losses_b)
    assert value == pytest.approx(quotient(np.arange(60)))
    drawn = [quotient(rng.integers(60, size=60)) for _ in range(2000)]
    assert (low, high) == pytest.approx(tuple(np.percentile(drawn, [2.5, 97.5])), abs=0.01)
    wide, (wide_low, wide_high) = score(losses_a)
    assert wide == pytest.approx(time_mean(a)[0])
    assert (high - low) / value < 0.5 * (wide_high - wide_low) / wide  # paired


def test_shares_and_medians():
    flags = np.arange(40) < 3
    found = common.percentage(flags)
    expected = stats.binomtest(3, 40).proportion_ci(method="exact")
    assert found.value == 7.5
    assert (found.low, found.high) == pytest.approx((100 * expected.low, 100 * expected.high))
    assert common.percentage(flags & False).low == 0.0
    values = np.append(np.arange(1.0, 22.0), np.nan)
    middle = median(values)
    assert (middle.value, middle.runs, middle.lost) == (11.0, 21, 1)
    assert 5 < middle.low < 11 < middle.high < 17


def test_what_is_read_off_the_three_state_system(monkeypatch):
    monkeypatch.setattr(toy_examples, "STEPS", 60)
    example = toy_examples.example_1.__wrapped__(20)
    assert tuple(example.tracks) == toy_examples.FILTERS
    printed, wrong = (example.tracks[label] for label in ("as printed", "UKF told wrong"))
    rms = [np.sqrt(np.mean((track.mean - example.truth.x)[:, :, 2] ** 2)) for track in (printed, wrong)]
    assert zhao2010.quotient("as printed", "UKF told wrong", 3)(example).value == pytest.approx(rms[0] / rms[1])
    last = np.sqrt(np.mean((wrong.mean - example.truth.x)[-50:, :, 0] ** 2))
    assert zhao2010.remains("UKF told wrong", 1, 50)(example).value == pytest.approx(last)
    Q = printed.noise["Q"][..., 0, 0]
    assert zhao2010.negative("as printed", "Q")(example).value == 100 * np.mean((Q < 0).any(axis=0))
    assert zhao2010.estimate("as printed", "Q", 40)(example).value == np.median(Q[39])
    found = zhao2010.spread("as printed", "Q", 40)(example)
    assert found.value == pytest.approx(np.sqrt(np.mean((Q[39] - 0.4) ** 2)))
    assert (example.noise["q"] == 0.2).all()
    assert zhao2010.spoilt("UKF told wrong")(example).value == 0.0
    assert {step: changing_R(step) for step in zhao2010.ENDS} == zhao2010.ENDS


def test_the_bound_of_an_estimate_of_the_noise_is_that_of_one_that_sees_it():
    w = 0.2 + np.sqrt(0.4) * np.random.default_rng(1).standard_normal((4000, 40))
    spread = (
        np.sqrt(np.mean((w.mean(axis=1) - 0.2) ** 2)),
        np.sqrt(np.mean((np.mean((w - 0.2) ** 2, axis=1) - 0.4) ** 2)),
    )
    assert spread == pytest.approx((zhao2010.seen("q", 40), zhao2010.seen("Q", 40)), rel=0.05)


def test_figures_of_flights(flown):
    task = flown["ekf"].task
    rows = [Row("drawn", [Curve("EKF", Source(task, "ekf")), Curve("CKF", Source(task, "ckf"))])]
    picture = rms_over_time("x", "", rows, {"azimuth": (8.0, 7.8), "pitch": (2.3, 2.2)}, runs=3)
    assert [source.solver for source in picture.sources] == ["ekf", "ckf"]
    heading, pitch = picture.draw([flown["ekf"], flown["ckf"]]).axes
    labels = [line.get_label() for line in heading.lines]
    assert labels == ["EKF", "CKF", "EKF, printed average", "CKF, printed average", "Cramér-Rao bound"]
    errors = np.degrees(flown["ckf"].records.history[:, :, 9].astype(float))
    np.testing.assert_allclose(heading.lines[1].get_xydata()[:, 1], np.sqrt((errors**2).mean(axis=0)), rtol=1e-5)
    assert len(pitch.lines) == 4  # no bound

    sources = [Source(task, "mcc_ckf", {"sigma": sigma}) for sigma in (2.0, 3.0)]
    across = [Curve("UKF", Source(task, "ukf"))]
    sweep = against_setting("y", "", "sigma", "position", sources, across, "MCC-CKF")
    (axes,) = sweep.draw([flown["ekf"], flown["ckf"], flown["ukf"]]).axes
    drawn = axes.lines[0].get_xydata()
    np.testing.assert_allclose(drawn, [(2.0, means(flown["ekf"], [6, 7, 8])), (3.0, means(flown["ckf"], [6, 7, 8]))])


def test_every_width_of_003_is_held_against_the_best():
    table = get_table("003.sigma")
    lines = table.groups[0].lines
    assert [line.settings["sigma"] for line in lines] == [s for s in lu.SWEEP if s != lu.BEST]
    assert {line.against.settings["sigma"] for line in lines} == {lu.BEST}


def test_a_slice_of_002(cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(zhao2010, "RUNS", 30)
    code, out, _ = cli("reproduce", "002.2", "--runs", 30, "--out", "out", "--workers", 1)
    assert code == 0
    assert (tmp_path / "out" / "figures" / "002-example-2.svg").exists()
    text = (tmp_path / "out" / "REPRODUCTION.md").read_text()
    rows = {row.split("|")[1].strip(): row.split("|")[-2].strip() for row in text.splitlines() if row.startswith("| ")}
    assert rows["R negative, as printed"] == NOT
    assert rows["x2, safeguarded"] == NOT
    assert REPRODUCED in rows.values() or "not told apart" in rows.values()
    assert "002, example 2" in out


def test_costs_that_may_be_alike_are_not_told_apart():
    def measured(ratio):
        return SimpleNamespace(cost=SimpleNamespace(ratio=ratio))

    longer = Said("longer", low=1.0)
    found = [common.cost_against(measured(ratio), measured(2.0)) for ratio in (2.1, 2.8, 1.5)]
    assert [one.value for one in found] == [1.05, 1.4, 0.75]
    assert verdicts([longer] * 3, found) == [OPEN, REPRODUCED, NOT]


def test_a_line_gets_its_own_runs_first_and_then_those_it_is_held_against():
    other = Source(short(sun2012.DRAWN), "ekf")
    line = Line("ckf / ekf", short(sun2012.DRAWN), "ckf", common.ratio_of_armse("position"), against=other)
    assert [source.solver for source in line.sources] == ["ckf", "ekf"]
    assert [source.solver for source in dataclasses.replace(line, against=None).sources] == ["ckf"]


def test_errors_at_a_time_are_of_its_last_second_or_the_mean_of_so_many():
    """Errors that grow by one a second: at 100 s, and over the ten seconds 91 to 100."""
    t = np.arange(1.0, 121.0)
    records = SimpleNamespace(
        criteria=SimpleNamespace(history_t=t),
        history=np.tile(t[:, None], (2, 1, 3)),
        unfinished=np.array([False, True]),
    )
    for over_s, expected in ((0.0, 100.0), (10.0, 95.5), (1.0, 100.0)):
        found = common.errors_at(SimpleNamespace(records=records), 100.0, over_s)
        np.testing.assert_allclose(found[0], expected)
        assert np.isnan(found[1]).all()
