"""Navigation tasks through the evaluation: scores against closed forms and SciPy, then a short flight from play to report."""

import csv
import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest
from scipy import stats
from scipy.spatial.transform import Rotation

from sins_env import attitude
from sins_env.evaluation import compare, evaluate
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.play import errors
from sins_env.evaluation.play.criteria import COMPONENTS, WORST, Criteria
from sins_env.evaluation.play.one_run import run_episode
from sins_env.evaluation.play.records import Records, Scorer, score
from sins_env.evaluation.score import navigation, quantities, ranking
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show import plain_tables, terminal_tables
from sins_env.evaluation.speed.cost import Cost
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks import catalogue
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.units import DEG

EPOCH, K, FROM = 0.1, 1000, 200
t = (1 + np.arange(K)) * EPOCH
LIMIT = np.array([0.5, 0.5, 1.5, 1.0, 1.0, 1.0, 100.0, 100.0, 100.0])
CRITERIA = Criteria(
    EPOCH, K, 0, np.array([1e-3, 1e-3, 1e-2]), LIMIT, 30.0, navigates=True, span_from=FROM + 1, final_limit=5 * DEG
)
PLUGIN = "evaluation.plugins:FollowsFixes"
FLIGHT = EvaluationTask(
    "short-flight-v0", "short flight", "here", "SINS/NavFlight-v0", 5.0, 20_000.0,
    {"profile": "sun2012", "duration": 20.0}, hold_s=5.0, score_from_s=5.0, rank_by="position",
)  # fmt: skip


@pytest.fixture
def flight(monkeypatch):
    monkeypatch.setitem(catalogue.TASKS, FLIGHT.name, FLIGHT)
    return FLIGHT


def errors_of(sizes, course=1.0):
    """(R, K, 12): of each run its sizes (R, 12) times a course over time (K,)."""
    return np.asarray(sizes)[:, None, :] * np.broadcast_to(course, K)[:, None]


# ---- single runs ----


def test_errors_of_euler_angles_against_scipy():
    rng = np.random.default_rng(0)
    truth, wrong = (rng.uniform([-180, -85, -180], [180, 85, 180], (200, 3)) for _ in range(2))  # heading, pitch, roll
    q, hat = (np.roll(Rotation.from_euler("ZXY", a * [-1, 1, 1], degrees=True).as_quat(), 1, axis=1)
              for a in (truth, wrong))  # fmt: skip
    phi = attitude.misalignment(hat, q)
    expected = (np.radians(wrong - truth) + np.pi) % (2 * np.pi) - np.pi
    np.testing.assert_allclose(errors.euler_errors(hat, phi), expected, atol=1e-9)


def test_means_over_time_begin_where_the_span_begins():
    """A component that is c before the span and d in it: RMS d, whatever c is; its other scores know both."""
    sizes = np.arange(1.0, 13.0) * [[1e-4], [2e-4]]
    found = score(errors_of(sizes, np.where(np.arange(K) < FROM, 50.0, 1.0)), None, CRITERIA)
    np.testing.assert_allclose(found.span_rms, sizes, rtol=1e-12)
    np.testing.assert_allclose(found.span_final, sizes, rtol=1e-12)
    np.testing.assert_allclose(found.final, sizes[:, :3], rtol=1e-12)
    assert found.history.shape == (2, 100, 12)
    in_blocks = Scorer(CRITERIA, 2)
    whole = errors_of(sizes, np.sin(t))
    for first in range(0, K, 70):
        part = whole[:, first : first + 70]
        in_blocks.add(part, np.zeros(part.shape[:2], dtype=bool))
    one, other = in_blocks.records(range(2)), score(whole, None, CRITERIA)
    for field in dataclasses.fields(Records):
        if field.name != "criteria":
            np.testing.assert_array_equal(np.shape(getattr(one, field.name)), np.shape(getattr(other, field.name)))
    np.testing.assert_allclose(one.span_rms, other.span_rms, rtol=1e-12)


def test_limits_of_velocity_and_position_hold_in_the_steady_state():
    """The start moves them for as long as the attitude is wrong; the attitude has no such excuse."""
    early, late = (t < 30).astype(float), (t > 70).astype(float)
    runs = np.zeros((5, K, 12))
    runs[0, :, 3], runs[1, :, 8], runs[2, :, 4], runs[3, :, 2] = 2 * early, 150 * late, 2 * late, 6 * DEG
    found = score(runs, None, CRITERIA)
    assert found.status.tolist() == ["ok", "diverged", "diverged", "diverged", "ok"]
    assert found.reason[1] == "vertical position error beyond 100 m at 70.1 s"
    assert found.reason[2] == "north velocity error beyond 1 m/s at 70.1 s"
    assert found.reason[3] == "azimuth error beyond 5 deg at the end"


def test_nees_of_mixed_units_against_a_dense_inverse():
    rng = np.random.default_rng(1)
    scale = np.array([1e-6] * 3 + [1e-2] * 3 + [1e3] * 3)
    A = rng.normal(size=(100, 9, 9))
    shape = A @ np.swapaxes(A, -1, -2) + np.eye(9)
    e = rng.normal(size=(100, 9))
    expected = np.einsum("ri,rij,rj->r", e, np.linalg.inv(shape), e)
    found = errors.nees(e * scale, shape * scale[:, None] * scale)
    np.testing.assert_allclose(found, expected, rtol=1e-9)


# ---- over runs ----


def test_armse_is_the_mean_over_time_of_the_rms_over_runs():
    rng = np.random.default_rng(2)
    sizes, course = rng.normal(size=(40, 12)) * 1e-3, 1 + np.exp(-t / 30)
    s = navigation.navigation_scores(score(errors_of(sizes, course), None, CRITERIA))
    at = course[9::10][t[9::10] > FROM * EPOCH].mean()  # of the history, at 1 Hz
    across = np.sqrt(np.square(sizes).mean(axis=0))
    euler = {"azimuth": across[9] * at, "pitch": across[10] * at, "roll": across[11] * at}
    expected = {**euler, "position_v": across[8] * at, "velocity_h": np.hypot(*across[3:5]) * at}
    for name, value in expected.items():
        assert s.armse[name][0] == pytest.approx(value, rel=1e-6), name
        assert s.armse[name][1][0] < value < s.armse[name][1][1]
    assert s.rms["position"][0] == pytest.approx(
        math.sqrt(np.square(across[6:9]).sum() * np.square(course[FROM:]).mean())
    )
    assert s.median_azimuth[0] == pytest.approx(np.median(np.abs(sizes[:, 9])) * course[-1])
    assert s.from_s == 20.0


def test_the_interval_of_a_time_mean_against_scipy():
    """BCa of scipy.stats for the same statistic; the ends agree to their Monte Carlo error."""
    rng = np.random.default_rng(3)
    errors = np.abs(rng.normal(size=(50, 1)) * (1 + 0.3 * rng.normal(size=(50, 60))))

    def statistic(i, axis):
        return np.sqrt(np.square(errors[i.astype(int)]).mean(axis=-2)).mean(axis=-1)

    value, ends = navigation.time_mean(errors)
    assert value == pytest.approx(float(statistic(np.arange(50.0), -1)))
    found = stats.bootstrap((np.arange(50.0),), statistic, method="BCa", n_resamples=9999, batch=500, rng=rng)
    np.testing.assert_allclose(ends, found.confidence_interval, atol=0.15 * found.standard_error)


def test_a_run_that_raised_counts_with_the_worst_errors():
    scorer = Scorer(CRITERIA, 1)
    scorer.add(np.zeros((1, 600, 12)), np.zeros((1, 600), dtype=bool))
    scorer.fill()
    found = navigation.navigation_scores(scorer.records([0]))
    part = 400 / (K - FROM)
    assert found.rms["position_v"][0] == pytest.approx(WORST[8] * math.sqrt(part))
    assert found.armse["position_v"][0] == pytest.approx(WORST[8] * part, rel=0.02)


def test_bounds_of_means_over_time():
    s = np.ones((100, 9)) * np.arange(1.0, 10.0)
    s[: FROM // 10] = 1e3
    bound = Bound(CRITERIA.history_t, s, s[-1], s[-1], np.array([CRITERIA.steady_from, K]), np.array(True))
    records = score(errors_of(2 * np.ones((3, 12))), None, CRITERIA)
    found = navigation.bound_means(records, bound)
    assert found["azimuth"] == pytest.approx(3.0)  # the heading is held against the azimuth's
    assert found["position_h"] == pytest.approx(math.hypot(7, 8))
    assert math.isnan(found["roll"])
    assert math.isnan(navigation.bound_means(records, dataclasses.replace(bound, sigma=s[:, :3]))["velocity_v"])


def solver(name, sizes, **task):
    """Runs with these constant errors of one component each: {component: (R,)}."""
    runs = len(next(iter(sizes.values())))
    values = np.zeros((runs, 12))
    for component, size in sizes.items():
        values[:, COMPONENTS.index(component)] = size
    return Results(
        dataclasses.replace(FLIGHT, **task), name, {}, "s", score(errors_of(values), None, CRITERIA), stored_bound=None
    )


def test_the_task_says_what_ranks():
    rng = np.random.default_rng(4)
    common = rng.normal(size=200)
    good = {"pos_n": 1.0 * common, "heading": 0.02 * common, "phi_u": 0.02 * common}
    bad = {"pos_n": 3.0 * common, "heading": 0.01 * common, "phi_u": 0.01 * common}
    for rank_by, first in (("position", "good"), ("azimuth", "bad")):
        lines = ranking.ranked(
            [bounded(solver(name, sizes, rank_by=rank_by)) for name, sizes in (("bad", bad), ("good", good))]
        )
        assert [rank for rank, _ in lines] == [1, 2]
        assert lines[0][1].measure.cap == pytest.approx(3.0 * {"position": math.sqrt(3.0), "azimuth": 1.0}[rank_by])
        assert lines[0][1].solver == first


def bounded(one):
    """With a bound of 1 rad, m/s and m, so that there is a cap."""
    c = one.records.criteria
    sigma = np.ones((len(c.history_t), 9))
    bound = Bound(c.history_t, sigma, sigma[0], sigma[0], np.array([c.steady_from, c.num_epochs]), np.array(True))
    return dataclasses.replace(one, stored_bound=bound)


def test_hot_starts_are_scored_at_the_end_and_capped_where_they_fail():
    """Two of two hundred runs more fail: not told apart; twenty more: told apart."""
    lines = []
    for name, failed, size in (("many", 22, 1e-3), ("few", 2, 1e-3), ("none-worse", 0, 2e-3), ("none", 0, 1e-3)):
        angle = np.full(200, size)
        angle[:failed] = 10 * DEG
        lines.append(solver(name, {"phi_u": angle, "heading": angle}, rank_by="failures", fail_azimuth_deg=5.0))
    found = ranking.ranked(lines)
    assert [one.solver for _, one in found] == ["none", "few", "none-worse", "many"]
    assert [rank for rank, _ in found] == [1, 1, 2, 4]
    many = found[3][1].verdict
    assert many.failures == 22
    assert many.score == pytest.approx(math.sqrt((22 * (5 * DEG) ** 2 + 178e-6) / 200))
    text = plain_tables.as_markdown(lines)
    assert "heading error beyond 5.00 deg at the end" in text
    assert "| 22 of 200 [" in text
    assert "many 22 diverged" in text


def test_compare_in_any_quantity():
    rng = np.random.default_rng(5)
    common = rng.normal(size=50)
    a, b = solver("a", {"pos_e": common, "vel_u": common}), solver("b", {"pos_e": 2 * common, "vel_u": 0.5 * common})
    assert compare(a, b).ratio[0] == pytest.approx(0.5)  # what ranks: position
    assert compare(a, b, "velocity_v").ratio[0] == pytest.approx(2.0)
    assert "velocity_v score, ratio" in str(compare(a, b, "velocity_v"))
    assert "no verdict (errors have no cap without a bound)" in str(compare(a, b))
    with pytest.raises(ValueError, match=r"score 'positon'.*position"):
        compare(a, b, "positon")
    with pytest.raises(ValueError, match=r"score 'position'.*azimuth"):
        quantities.quantity("position", navigates=False)


# ---- a short flight ----

RUNS = 40


@pytest.fixture(scope="module")
def found():
    return evaluate(FLIGHT, PLUGIN, RUNS, workers=1, cost=False)


def test_what_follows_the_fixes_has_their_noise(found):
    """Position and velocity errors are the GPS's (10 m and 0.1 m/s a component at 1 Hz), to four standard errors."""
    s, fixes = found.summary.navigation, RUNS * 15
    error = 4 / math.sqrt(2 * fixes)
    assert s.rms["position_v"][0] == pytest.approx(10.0, rel=error)
    assert s.rms["position_h"][0] == pytest.approx(10.0 * math.sqrt(2), rel=error)
    assert s.rms["velocity_h"][0] == pytest.approx(0.1 * math.sqrt(2), rel=error)
    assert s.armse["position_v"][0] <= s.rms["position_v"][0]
    assert s.nees[-1].inside
    assert abs(s.nees[-1].mean - 9) < 4 * math.sqrt(18 / RUNS)
    assert found.summary.counts["any"] == 0


def test_euler_errors_are_those_of_the_told_attitude(found):
    """It stays as told, so its heading, pitch and roll are off by how far the flight's have gone from it."""
    env = FLIGHT.make(2, reveal_truth=True)
    _, info = FLIGHT.reset(env, [0, 1])
    told = np.concatenate([info["start"][name] for name in ("q_nb", "vel", "pos")], axis=1)
    for _ in range(200):
        info = env.step(told)[4]
    away = [np.stack(attitude.to_euler(attitude.to_dcm(q)), axis=-1) for q in (told[:, :4], info["truth"]["q_nb"])]
    expected = (away[0] - away[1] + np.pi) % (2 * np.pi) - np.pi
    assert np.abs(expected).min() > 1e-4
    np.testing.assert_allclose(found.records.span_final[:2, 9:], expected, atol=1e-9)


def test_one_by_one_gives_the_same(found):
    alone = evaluate(FLIGHT, "evaluation.plugins:FollowsFixesAlone", 3, workers=1, cost=False).records
    for name in ("span_rms", "span_final", "nees_all", "history", "t_conv"):
        np.testing.assert_allclose(getattr(alone, name), getattr(found.records, name)[:3], rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("settings", [{"fail_at": 100}, {"nan_at": 100}, {"narrow_at": 100}])
def test_failing_runs(settings):
    records = evaluate(FLIGHT, PLUGIN, 2, workers=1, cost=False, settings=settings).records
    assert records.broken.all()
    expected = (
        {
            "fail_at": "step raised RuntimeError: no fix, at 10.0 s",
            "nan_at": "non-finite or zero action at 10.0 s",
            "narrow_at": "step returned shape (4,); allowed: (10,), at 10.0 s",
        }[next(iter(settings))]
        .replace("(4,)", "(1, 4)")
        .replace("(10,)", "(1, 10)")
    )
    assert records.reason == (expected, expected)
    assert (records.span_rms[:, 6:9] > 1e6).all()
    np.testing.assert_array_equal(records.span_final, np.broadcast_to(WORST, (2, 12)))


def test_one_run_at_full_rate():
    course = run_episode(FLIGHT, PLUGIN, 1)
    assert course.errors.shape == course.sigma.shape == (200, 9)
    np.testing.assert_allclose(course.errors[-1], course.records.span_final[0, :9])
    np.testing.assert_allclose(course.sigma[-1, 6:], 10.0)
    np.testing.assert_array_equal(course.phi, course.errors[:, :3])


def test_results_file_board_export_and_verify(flight, found, tmp_path, monkeypatch, cli):
    monkeypatch.chdir(tmp_path)
    assert cli("eval", "--task", flight.name, "--solver", PLUGIN, "--runs", RUNS, "--workers", 1)[0] == 0
    with Store("results.sqlite", read_only=True) as db:
        (key,) = db.keys()
        for whole in (True, False):
            stored = db.results(key, whole=whole)
            np.testing.assert_array_equal(stored.records.span_rms, found.records.span_rms)
            np.testing.assert_array_equal(stored.records.history, found.records.history)
            assert stored.summary.navigation == found.summary.navigation
    code, out, _ = cli("board", "--csv")
    (line,) = csv.DictReader(out.splitlines())
    assert float(line["armse_position_h_m"]) == found.summary.navigation.armse["position_h"][0]
    assert float(line["armse_azimuth_deg"]) == pytest.approx(found.summary.navigation.armse["azimuth"][0] / DEG)
    (entry,) = json.loads(cli("board", "--json")[1])
    assert entry["armse"]["velocity_v"] == found.summary.navigation.armse["velocity_v"][0]
    assert entry["armse"]["azimuth"] == pytest.approx(found.summary.navigation.armse["azimuth"][0] / DEG)
    assert entry["armse_ci"]["azimuth"][0] < entry["armse"]["azimuth"] < entry["armse_ci"]["azimuth"][1]
    assert cli("export", "--csv", "e.csv")[0] == cli("export", "--json", "e.json")[0] == 0
    with open("e.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["rms_pos_u_m"]) for row in rows] == found.records.span_rms[:, 8].tolist()
    final = [row["final_vel_e_mps"] for row in json.loads(Path("e.json").read_text())]
    assert final == found.records.span_final[:, 3].tolist()
    assert cli("verify", "--rows", 4, "--workers", 1, "--solver", PLUGIN)[0] == 0
    with Store("results.sqlite") as db:
        db.connection.execute("UPDATE spans SET rms_vel_e = rms_vel_e * 1.001")
    code, _, said = cli("verify", "--rows", 4, "--workers", 1, "--solver", PLUGIN)
    assert code == 1
    assert any("rms_vel_e_mps" in text for text in said)


def test_tables_figures_and_page(flight, found, tmp_path, monkeypatch, cli):
    monkeypatch.chdir(tmp_path)
    with Store("results.sqlite") as db:
        db.add_task(flight)
        for name, settings in ((PLUGIN, {}), (PLUGIN, {"velocity_mps": 0.2})):
            key = Key.of(flight.name, found.suite, name, settings, "1")
            db.add(key, found.records)
            db.add_cost(key, Cost(10.0, 12.0, 0.1))
    monkeypatch.setenv("COLUMNS", "156")
    code, out, _ = cli("board", "--plot", "board.png")
    assert code == 0
    for text in ("position", "hor., m", "vert., m/s", "NEES", "/ 9", "over time from 5 s on", "-  FollowsFixes"):
        assert text in out
    monkeypatch.setenv("COLUMNS", "80")
    narrow = cli("board")[1]
    assert "Left out in 80 columns" in narrow
    assert max(map(len, narrow.splitlines())) <= 80
    code, out, _ = cli("run", flight.name, PLUGIN, "--plot", "run.png")
    assert code == 0
    assert "position, horizontal" in out
    assert cli("report", "--html", "r.html")[0] == 0
    page = (tmp_path / "r.html").read_text()
    for text in ("Horizontal position error over time", "score of the position, m", "Failed runs", "NEES /\xa09"):
        assert text in page, text
    code, out, _ = cli("compare", flight.name, PLUGIN, PLUGIN, "--score", "velocity")
    assert "velocity score, ratio      1.000" in out
    for name in ("board.png", "run.png"):
        assert (tmp_path / name).stat().st_size > 10_000


def test_alignment_has_no_columns_of_navigation(short, tmp_path, monkeypatch, cli):
    monkeypatch.chdir(tmp_path)
    assert (
        cli("eval", "--task", "short-v0", "--solver", "evaluation.plugins:Noisy", "--runs", 2, "--workers", 1)[0] == 0
    )
    assert cli("export", "--csv", "e.csv")[0] == 0
    assert "vel" not in (tmp_path / "e.csv").read_text().splitlines()[0]
    assert "armse" not in cli("board", "--csv")[1]
    assert "armse" not in cli("board", "--json")[1]
    with Store("results.sqlite", read_only=True) as db:
        assert db.connection.execute("SELECT count(*) FROM spans").fetchone() == (0,)


def test_a_terminal_of_any_width(found):
    for width in (60, 100, 200):
        terminal_tables.table([found], width)
