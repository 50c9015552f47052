"""The table ranks by azimuth RMS with ties, and says the same in every form."""

import csv
import dataclasses
import io
import json
import math

import numpy as np
import pytest
from evaluation.score import test_navigation
from rich.console import Console

import sins_env
from sins_env.cli.output import save_figure
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.play.records import score
from sins_env.evaluation.score import ranking
from sins_env.evaluation.score.consistency import Nees, nees_band
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show import cells, error_figure, numbers, plain_tables, terminal_tables
from sins_env.evaluation.speed.cost import Cost
from sins_env.evaluation.store.results_file import Board
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.units import ARCSEC

TASK = get_task("sway-white-v0")
CRITERIA = Criteria(0.1, 1000, 0, TASK.delta, np.ones(3), 60.0)
KEYS = [
    "task", "solver", "settings", "failed", "failed_ci", "aligned", "aligned_ci", "score", "score_ci", "median", "median_ci",
    "time_s", "time_s_ci", "x_bound", "x_bound_ci", "ratio", "ratio_ci", "common", "p", "p_adjusted", "verdict", "fragile",
    "preliminary", "rank", "beaten_by", "below_bound", "rms_raw", "scoring", "runs",
    "success", "t_conv_median_s", "rms", "rms_ci", "bound_ratio", "failures", "cost_ratio",
]  # fmt: skip


def results(name, azimuth, runs=50, seed=0, task=TASK, **settings):
    """A solver whose runs have constant errors, normal with the given azimuth sigma in arcsec."""
    rng = np.random.default_rng(seed)
    phi = rng.normal(0, 1, (runs, 1, 3)) * np.array([20.0, 20.0, azimuth]) * ARCSEC * np.ones((1, 1000, 1))
    return Results(task, name, settings, "suite", score(phi, None, CRITERIA), Cost(200.0, 300.0, 1.25))


def text_of(renderable, width=100):
    console = Console(width=width, file=io.StringIO())
    console.print(renderable)
    return console.file.getvalue()


def test_ranks_tie_where_nobody_is_beaten():
    given = [("c", 3000, 0), ("a", 800, 0), ("b", 850, 1), ("d", 9000, 0)]
    lines = ranking.ranked([results(name, size, runs=200, seed=seed) for name, size, seed in given])
    assert [(rank, one.solver) for rank, one in lines] == [(1, "a"), (1, "b"), (3, "c"), (4, "d")]
    few = ranking.ranked([results("b", 9000, runs=199), results("a", 800, runs=199)])
    assert [(rank, one.solver) for rank, one in few] == [(None, "a"), (None, "b")]


def board():
    """Solvers of every kind: one that wins, the yardstick, one that fails, and two with too few runs."""
    sizes = {"imm_ekf": (700, 200), "ckf": (800, 200), "student_t_ckf": (2800, 200), "gpf": (600, 40), "mine": (801, 8)}
    return [results(name, size, runs=runs) for name, (size, runs) in sizes.items()]


def test_who_wins_against_whom_and_how_sure():
    text = text_of(terminal_tables.table(board(), 80), 80)
    rows = {
        name: next(line for line in text.splitlines() if name in line).split() for name in ("imm_ekf", "gpf", "mine")
    }
    assert rows["imm_ekf"][:6] == ["1", "imm_ekf", "0", "of", "200", '683"']
    assert [row[0] for row in rows.values()] == ["1", "-", "-"]
    for part in ("against", "wins", "loses", "p 0.0002", "preliminary", "few runs", "0–1.8 %", "2 of 200"):
        assert part in text, part
    told = " ".join(text.split())
    assert "adjusted (Holm) for 2 comparisons" in told
    assert "makes 2 claims of a win or a loss; one table in twenty may hold a false one" in told
    assert "beat it, one-sided at 5 % / 2" in told
    assert 'azimuth error beyond 2.10 deg, level beyond 210"' in told
    console = Console(width=100, file=io.StringIO(), force_terminal=True, color_system="standard")
    console.print(terminal_tables.table(board(), 100))
    assert "\x1b[2mgpf" in console.file.getvalue()  # too few runs are dim
    assert "\x1b[1mimm_ekf" in console.file.getvalue()
    first, *_, last = json.loads(plain_tables.as_json(board()))
    assert (first["verdict"], first["fragile"], first["rank"], first["scoring"]) == ("wins", False, 1, 2)
    assert (last["verdict"], last["p"], last["rank"], last["preliminary"]) == (None, None, None, True)
    assert '| 1 | imm_ekf | 0 of 200 [0–1.8 %] | 683" [' in plain_tables.as_markdown(board())


def test_a_board_without_a_cap_says_so():
    """A navigation without a bound: its position has no cap."""
    one = test_navigation.solver("one", {"pos_e": np.full(30, 3.0)})
    (entry,) = json.loads(plain_tables.as_json([one]))
    assert (entry["scoring"], entry["rank"], entry["score"], entry["score_ci"]) == (1, None, 3.0, [None, None])
    assert "(scoring 1)" in plain_tables.as_markdown([one])


def test_json_has_exactly_the_keys():
    entries = json.loads(plain_tables.as_json([results("ckf", 800, gain=2), results("bad", 4e5, runs=1)]))
    for entry in entries:
        assert list(entry) == KEYS
        assert list(entry["rms"]) == list(entry["rms_ci"]) == ["E", "N", "U"]
    good, bad = entries
    assert good["settings"] == {"gain": 2}
    assert good["rms_ci"]["U"][0] < good["rms"]["U"] < good["rms_ci"]["U"][1]
    assert good["bound_ratio"] is good["x_bound"] is good["p"] is None
    assert good["score_ci"][0] < good["score"] < good["score_ci"][1]
    assert good["failed_ci"] == pytest.approx([0.0, 0.0711], abs=1e-4)
    assert good["scoring"] == 2
    assert (good["failures"], good["cost_ratio"]) == (0, 1.25)
    assert bad["t_conv_median_s"] is None
    assert bad["rms_ci"]["U"] == [None, None]


def test_every_form_says_the_same():
    one = results("ckf", 800)
    s = one.summary
    (row,) = csv.DictReader(io.StringIO(plain_tables.as_csv([one])))
    assert float(row["rms_u_arcsec"]) == s.rms["U"]
    assert float(row["success"]) == s.success
    assert float(row["cost_ratio"]) == 1.25
    assert row["nees_over_3"] == ""
    told = one.verdict
    for text in (plain_tables.as_markdown([one]), text_of(terminal_tables.table([one], 130), 130)):
        assert f'{told.score / ARCSEC:.0f}"' in text
        assert f"{told.score_ci[0] / ARCSEC:.0f}–{told.score_ci[1] / ARCSEC:.0f}" in text
        assert f"{100 * s.success:.0f} %" in text
        assert "within 0.7 deg and level within 70" in text


def test_failures_and_nees_are_shown():
    one = results("ckf", 800, runs=4)
    status = np.array(["ok", "raised", "diverged", "diverged"])
    records = dataclasses.replace(one.records, status=status, repairs=np.array([3, 0, 1, 0]))
    records = dataclasses.replace(records, nees=np.full((4, 4), 30.0))
    one = dataclasses.replace(one, records=records)
    assert cells.failure_text(one.summary) == "2 diverged, 1 raised, 2 repaired"
    assert one.summary.failures == 4
    text = text_of(terminal_tables.table([one]))
    for part in ("2 diverged", "1 raised", "2 repaired", "10.0", "worst error"):
        assert part in text
    assert "Fallbacks" not in text
    helped = dataclasses.replace(one, records=dataclasses.replace(records, fallbacks=np.array([0, 0, 3, 4])))
    assert helped.summary.failures == 4
    assert "replaced the solver's own rule: ckf 1.75." in text_of(terminal_tables.table([helped]))
    (line,) = csv.DictReader(plain_tables.as_csv([helped]).splitlines())
    assert float(line["fallbacks"]) == 1.75
    assert "10.0 (outside)" in plain_tables.as_markdown([one])
    assert "NEES" not in text_of(terminal_tables.table([results("ckf", 800)]))


def test_table_fits_in_100_columns_with_long_names():
    found = [
        results("package.module.with.a.long.path:AnEstimatorWithALongName", 3e5, horizon=1000.0),
        results("b", 8e4),
    ]
    text = text_of(terminal_tables.table(found))
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 100
    assert "…" not in text


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (12.345, "12.3"), (853.1, "853"), (0.01234, "0.0123"), (1234.5, "1,234"),
     (math.inf, "never"), (math.nan, "-"), (99.96, "100.0"), (-32_215_238.0, "-3.22e+07")],
)  # fmt: skip
def test_number(value, text):
    assert numbers.number_text(value) == text


def test_angle_and_seconds():
    assert numbers.angle_text(7200.0) == "7,200"
    assert numbers.angle_text(68400.0) == "19.0°"
    assert numbers.angle_interval_text((6374.0, 23184.0), 10800.0) == "1.77°–6.44°"  # the unit is that of the value
    assert numbers.angle_interval_text((6374.0, 10800.0), 9000.0) == "6374–10800"
    assert [numbers.seconds_text(value) for value in (0.1, 9.94, 10.0)] == ["0.1", "9.9", "10"]
    assert numbers.seconds_text(125.36) == "125"
    assert numbers.seconds_interval_text((100.0, math.inf)) == "> 100"
    assert numbers.seconds_interval_text((math.inf, math.inf)) == ""


def test_figures(tmp_path):
    found = [results("a", 800), results("b", 900, runs=1), results("c", 5e4, task=get_task("rlg-car-v0"))]
    save_figure(error_figure.error_figure(found), tmp_path / "e.png")
    assert (tmp_path / "e.png").stat().st_size > 20_000
    figure = error_figure.error_figure(found)
    assert len(figure.subfigs) == 2
    labels = [text.get_text() for text in figure.subfigs[0].legends[0].get_texts()]
    assert sorted(labels[:2]) == ["a", "b"]
    assert labels[2].startswith("threshold")


def test_results_and_boards_draw_themselves(tmp_path):
    made = results("ckf", 8000)
    one = sins_env.Results(**{field.name: getattr(made, field.name) for field in dataclasses.fields(made)})
    for drawn in (one, Board([one])):
        assert "runs, shaded: 95 % intervals" in drawn.plot(tmp_path / "a.svg").subfigs[0].get_suptitle()
        assert (tmp_path / "a.svg").read_text().startswith("<?xml")


def test_nees_bands_of_the_footer_are_those_of_the_lines():
    def with_nees(one, known):
        nees = np.where(np.arange(len(one.records))[:, None] < known, 3.0, np.nan) * np.ones(4)
        return dataclasses.replace(one, records=dataclasses.replace(one.records, nees=nees))

    none, few, many = results("a", 700, runs=9), results("b", 800, runs=12), results("c", 900)
    text = text_of(terminal_tables.table([none, with_nees(few, 10), with_nees(many, 50)], 200), 200)
    low, high = nees_band(10)
    assert f"95 % band {low / 3:.2f}–{high / 3:.2f} for 10 runs, " in text
    low, high = nees_band(50)
    last = f"{low / 3:.2f}–{high / 3:.2f} for 50 runs; -: the solver states no covariance.\n"
    assert last in " ".join(text.split(" ")).replace(" \n", "\n")


def test_spread_says_of_how_many_runs():
    one = results("a", 800, runs=7, task=get_task("rlg-car-v0"))
    heading = np.radians(np.arange(7.0))
    whole = dataclasses.replace(one, records=dataclasses.replace(one.records, heading=heading))
    status = np.array(["ok"] * 5 + ["raised", "lost"])
    part = dataclasses.replace(one, records=dataclasses.replace(whole.records, status=status))
    assert whole.summary.spread_runs == 7
    assert part.summary.spread_runs == 5  # whatever heading the record of a failed run may hold
    assert part.summary.spread_deg == pytest.approx(math.sqrt(2.5))
    assert "of 5" in text_of(terminal_tables.table([part], 120), 120)
    assert "of 5" in plain_tables.as_markdown([part])
    assert "of 7\n" not in plain_tables.as_markdown([whole])
    (row,) = csv.DictReader(io.StringIO(plain_tables.as_csv([part])))
    assert row["spread_runs"] == "5"


def test_nees_inside():
    assert Nees(1.0, 3.0, (2.0, 4.0), 9).inside
    assert not Nees(1.0, 4.1, (2.0, 4.0), 9).inside


def test_a_narrow_terminal_gets_no_broken_intervals():
    found = [results(name, 8000, runs=100) for name in ("filterpy_ukf", "ckf")]
    text = text_of(terminal_tables.table(found, 80), 80)
    assert max(len(line.rstrip()) for line in text.splitlines()) <= 80
    ends = [end / ARCSEC for end in found[0].verdict.score_ci]
    low, high = numbers.angle_interval_text(ends, found[0].verdict.score / ARCSEC).split("–")
    assert f"{low}–{high}" in text
    assert f"{found[0].summary.rms_ci['E'][0]:.1f}–" not in text
    assert f"{found[0].summary.rms_ci['E'][0]:.1f}–" in text_of(terminal_tables.table(found, 130), 130)


RLG = get_task("rlg-car-v0")


def diverged(one, count):
    status = np.array(["diverged"] * count + ["ok"] * (len(one.records) - count))
    return dataclasses.replace(one, records=dataclasses.replace(one.records, status=status))


def with_headings(one):
    heading = np.radians(np.linspace(10, 10.123, len(one.records)))
    return dataclasses.replace(one, records=dataclasses.replace(one.records, heading=heading))


WORDS = {  # what must be found whole, in boards of every width
    "rlg": [
        *(with_headings(results(name, 12345, runs=7, task=RLG, seed=i)) for i, name in enumerate(("ckf", "ukf"))),
        with_headings(results("filterpy_ukf", 25.6, runs=7, task=RLG, model="thesis")),
        diverged(with_headings(results("coarse_inertial", 6e5, runs=7, task=RLG)), 7),
        with_headings(results("some.package.of.mine:CleverAligner", 300, runs=7, task=RLG)),
    ],
    "sway": [
        results("filterpy_ukf", 829, runs=100),
        diverged(results("coarse_inertial", 648000, runs=100), 100),
        results("ekf", 25.6, runs=100, model="thesis", weights=[0.123456789, 0.23456789]),
    ],
}


@pytest.mark.parametrize("kind", WORDS)
@pytest.mark.parametrize("width", [66, 72, 80, 100, 120, 150])
def test_no_number_and_no_word_is_broken(kind, width):
    found = WORDS[kind]
    text = text_of(terminal_tables.table(found, width), width)
    lines = text.splitlines()
    assert max(len(line) for line in lines) <= width
    tokens = set(text.split())
    for one in found:
        s = one.summary
        expected = {*cells.score(one)[:1], *cells.score(one).below.split(), "model=thesis"}
        expected |= {numbers.number_text(s.spread_deg)} if kind == "rlg" else {"NEES"} & tokens
        assert expected <= tokens, (expected - tokens, text)
        assert one.solver.rpartition(":")[2] in tokens
    assert f"{7 if kind == 'rlg' else 100} diverged" in text
    table_lines = lines[: next(i for i, line in enumerate(lines) if line.startswith("aligned:"))]
    assert not any("…" in line for line in table_lines if "weights" not in line)
    head, said = text.partition("─")[0], " ".join(text.partition("Left out in")[2].split())
    gone = said.partition(": ")[2].partition(";")[0].split(", ")
    for part, heading in (("cost", "cost"), ("east and north", "east"), ("median", "median"), ("time", "time")):
        assert (heading not in head) == (part in gone), said
    assert said or width > 80
    assert not said or width < 150


def test_names_fold_at_dots_and_colons_only():
    one = results("package.module.with.a.long.path:AnEstimatorWithALongName", 3e5)
    text = terminal_tables.label(one, 1, 24).plain.splitlines()
    assert text == ["AnEstimatorWithALongName", "package.module.with.a.", "long.path"]
    assert terminal_tables.longest_piece(one) == 24


def test_a_name_is_folded_where_it_does_not_fit():
    """Between its parts; one that fills the line is not."""
    for length, longest in (
        (terminal_tables.MOST_NAME, terminal_tables.MOST_NAME),
        (terminal_tables.MOST_NAME + 1, 51),
    ):
        one = results(f"{'a' * 50}.{'b' * (length - 51)}", 800)
        assert terminal_tables.longest_piece(one, fold=False) == longest
