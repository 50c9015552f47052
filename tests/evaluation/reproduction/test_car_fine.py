"""Fine alignment on the car: what is read off the runs, printed figures, and what a disturbance does."""

import dataclasses

import gymnasium
import numpy as np
import pytest
from oracles import recorded

from sins_env import attitude
from sins_env.evaluation import evaluate
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.play.records import score
from sins_env.evaluation.reproduction import get_table, running
from sins_env.evaluation.reproduction.documents import car_courses, car_fine, car_interference
from sins_env.evaluation.reproduction.readings import car as readings
from sins_env.evaluation.reproduction.tables import Group, Line, Source, Table
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.task import EvaluationTask, run_seed


@pytest.mark.parametrize(("number", "columns"), list(zip(("6.6", "6.7", "6.8"), car_courses.HEADINGS, strict=True)))
def test_printed_figures_are_those_of_the_printed_headings(number, columns):
    lines = get_table(number).groups[0].lines
    for line, (_, solver, _), headings in zip(lines, car_fine.FILTERS, np.array(columns), strict=False):
        assert (line.solver, line.printed.records, line.printed.about_mean) == (solver, 10, True)
        assert line.printed.value == pytest.approx(headings.std(ddof=1), rel=2e-6)


def test_the_printed_level_figures_are_of_the_car_not_of_the_filters():
    for figures in (*car_fine.PITCH, *car_fine.ROLL):
        assert max(figures) - min(figures) < 0.0005


def test_the_table_of_the_zoo_names_solvers_that_exist():
    table = (*car_fine.ZOO, *car_fine.PARTICLES)
    assert len(set(table)) == len(table)
    assert all(map(finding.is_own, table))


def short(task, **kwargs):
    return dataclasses.replace(task, kwargs={**task.kwargs, "coarse": 20.0, "duration": 120.0, **kwargs}, hold_s=5.0)


def twin(name, events):
    return short(dataclasses.replace(car_interference.UNDISTURBED, name=name), events=events)


QUIET = twin("quiet-twin", [])
EARLY_S, LATE_S = 45.0, 100.0


def kf(task, runs=8):
    return evaluate(task, "kf", runs, settings=car_fine.AS_THESIS, workers=1, cost=False)


@pytest.fixture(scope="module")
def quiet():
    return kf(QUIET)


def test_angles_at_the_end_are_those_of_the_car_and_of_the_answer():
    """Beside the truth that the environment reveals, counted from that at switch-on, and the heading that is on record."""
    task = short(car_fine.CAR, event_rate_per_min=20.0, duration=30.0)
    results = kf(task, 24)
    env = gymnasium.make_vec(task.env_id, num_envs=24, **task.kwargs, reveal_truth=True)
    obs, info = task.reset(env, range(24))
    estimator = finding.make("kf", car_fine.AS_THESIS)
    estimator.reset(env.unwrapped.task, np.random.default_rng(0), 24)
    first = info["truth"]["q_nb"].copy()
    for _ in range(300):
        action = estimator.step(obs)
        obs, *_, info = env.step(action)
    place, true, found = (
        np.stack(attitude.to_euler(attitude.to_dcm(q)), -1) for q in (first, info["truth"]["q_nb"], action)
    )
    estimated, truth = readings.angles(results)
    np.testing.assert_allclose(truth, attitude.wrap(true - place), atol=1e-12)
    np.testing.assert_allclose(estimated, attitude.wrap(found - place), atol=1e-9)
    assert np.abs(truth[:, 2]).max() > 1e-3  # the car has tilted
    for what, expected in (("found", found - place), ("true", true - place), ("error", found - true)):
        read = readings.level("roll", what)(results).value
        assert read == pytest.approx(np.degrees(attitude.wrap(expected))[:, 2].std(ddof=1), rel=1e-6)
    ten = readings.of_records(slice(10, 20), readings.azimuth(cap_deg=180.0))(results)
    assert ten.runs == 10
    assert ten.value == pytest.approx(np.degrees(results.records.final[10:20, 2]).std(ddof=1))
    assert readings.of_records(slice(25, 30), readings.azimuth())(results).runs == 0


def test_angles_of_a_recording_are_not_counted_from_a_place(tmp_path):
    path = recorded.counts(tmp_path / "small.npz")
    kwargs = {"recording": path, "window": [1.0, 3.0], "stride": 2.0, "coarse": 1.0}
    task = EvaluationTask("small-v0", "", "", "SINS/Replay-v0", 0.3, 90.0, kwargs, windows=4, hold_s=1.0)
    results = kf(task, 4)
    found, true = readings.angles(results)
    expected = np.stack(attitude.to_euler(recorded.attitudes(np.array([4.0, 6.0, 8.0, 10.0])).as_matrix()), axis=-1)
    np.testing.assert_allclose(true, expected, atol=1e-9)
    np.testing.assert_allclose(attitude.wrap(found[:, 0] - results.records.heading), 0.0, atol=1e-9)


def made(quiet, azimuth_deg, status=None):
    """Results with this azimuth error each second, (R, 20) deg."""
    criteria = Criteria(1.0, 20, 5, np.ones(3), np.ones(3), 5.0)
    phi = np.zeros((*azimuth_deg.shape, 3))
    phi[..., 2] = np.radians(azimuth_deg)
    records = score(phi, None, criteria)
    return dataclasses.replace(
        quiet, records=records if status is None else dataclasses.replace(records, status=np.array(status))
    )


def test_what_is_read_off_a_disturbance(quiet):
    """A difference of 2^(10 - t) deg and of three times that from 10 s on, on whatever the twin's error was."""
    t = np.arange(1.0, 21.0)
    base = np.random.default_rng(1).standard_normal((3, 20))
    effect = np.where(t > 10, 2.0 ** (10 - t), 0.0) * np.array([[1.0], [3.0], [100.0]])
    without = made(quiet, base)
    disturbed = made(quiet, base + effect, ["ok", "ok", "raised"])
    disturbed.records.history[2, 15:] = np.nan
    cap = readings.failed_deg(quiet)  # the second is beyond it, and the third is lost
    found = readings.excursion(10.0)(disturbed, without)
    assert found.value == pytest.approx(np.sqrt((0.25 + 2 * cap**2) / 3), rel=1e-5)
    assert (found.runs, found.lost) == (2, 1)
    left = np.sqrt((10 * 2.0**-20 + cap**2) / 3)
    assert readings.left(disturbed, without).value == pytest.approx(left, rel=1e-6)
    back = readings.recovery(10.0, 0.1)(disturbed, without)  # 2^-3 > 0.1 > 2^-4, 3 x 2^-4 > 0.1 > 3 x 2^-5
    assert (back.value, back.runs, back.lost) == (3.5, 2, 1)
    assert readings.recovery(10.0, 1e-9)(without, without).value == 0.0
    assert readings.azimuth(points=4)(without).value == pytest.approx(base[:, -4:].mean(axis=1).std(ddof=1), rel=1e-5)


def test_twins_differ_by_the_disturbance_alone(quiet):
    """To the last bit before it; and a person who comes in during convergence does more than one after it, or than a door."""
    early, late, door = (
        kf(twin(f"{kind}-{t}", [{"t": t, "kind": kind}]))
        for kind, t in (("in", EARLY_S), ("in", LATE_S), ("door", EARLY_S))
    )
    same = quiet.records.criteria.history_t <= EARLY_S
    np.testing.assert_array_equal(early.records.history[:, same], quiet.records.history[:, same])
    assert run_seed(QUIET, 3) == run_seed(early.task, 3) != run_seed(dataclasses.replace(QUIET, seeds_of=""), 3)
    one, after, slammed = (
        readings.excursion(t)(found, quiet) for found, t in ((early, EARLY_S), (late, LATE_S), (door, EARLY_S))
    )
    assert one.value > 2 * after.value > 0
    assert one.value > 2 * slammed.value > 0


def test_a_line_reads_two_tasks(tmp_path):
    """Both are run once and kept; the twin's runs are shared."""
    task = short(car_interference.task("door", "before"), events=[{"t": 22.0, "kind": "door"}], duration=25.0)
    twin = Source(short(QUIET, duration=25.0), "kf", car_fine.AS_THESIS)
    line = Line("door", task, "kf", readings.excursion(22.0), car_fine.AS_THESIS, None, twin)
    table = Table(
        "x", "", "", "", (Group("one", "deg", (line, dataclasses.replace(line, label="left", read=readings.left))),)
    )
    with Store(tmp_path / "runs.sqlite") as store:
        ((_, (outcome,), _),) = running.run_tables([table], store, 3, workers=1)
        ((_, (again,), _),) = running.run_tables([table], store, 3, workers=1)
        assert len(store.keys()) == 2
    assert outcome.ours == again.ours
    assert [one.runs for one in outcome.ours] == [3, 3]
    assert outcome.ours[0].value > 0
    assert outcome.verdicts == ("", "")
