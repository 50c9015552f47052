"""The one list of score columns: every form shows each of them where it applies, and nowhere else."""

import csv
import dataclasses
import io
import json

import numpy as np
import pytest
from evaluation.score import test_navigation
from evaluation.show.test_board import TASK, results, text_of

from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.report import page, page_tables
from sins_env.evaluation.report.panel import Lineup
from sins_env.evaluation.score.resampling import median_interval
from sins_env.evaluation.show import columns, plain_tables, terminal_tables
from sins_env.evaluation.show.columns import MARKDOWN, PAGE, TERMINAL, Slot
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.catalogue import get_task

WIDE = 400


def with_records(one, **changed):
    return dataclasses.replace(one, records=dataclasses.replace(one.records, **changed))


def bounded(one):
    """With a NEES, and a bound of one in all its units."""
    c = one.records.criteria
    sigma = np.ones((len(c.history_t), c.components))
    bound = Bound(c.history_t, sigma, sigma[0], sigma[0], np.array([c.steady_from, c.num_epochs]), np.array(True))
    nees = np.full((len(one.records), 4), 3.0)
    return dataclasses.replace(with_records(one, nees=nees, nees_all=3 * nees), stored_bound=bound)


def navigating(**more):
    return test_navigation.solver("one", {"pos_e": np.full(10, 3.0), "heading": np.full(10, 0.1)}, **more)


def unscored():
    one = results("one", 800, runs=3, task=get_task("rlg-car-v0"))
    return with_records(one, criteria=dataclasses.replace(one.records.criteria, scored=False))


#: Solvers of one task each, and the titles that its widest table has right of the solver, told here once more.
FIRST, LAST = ["failed", "score"], ["east RMS", "north RMS"]
ALIGNS = ["median", "against ckf", "time", "cost / ckf", "aligned"]
ERRORS = [
    "heading", "level", "position, horizontal", "position, vertical", "velocity, horizontal", "velocity, vertical",
]  # fmt: skip
GROUPS = {
    "alignment": (lambda: [results("one", 800)], [*FIRST, *ALIGNS, *LAST]),
    "bounded": (
        lambda: [bounded(results("ckf", 800)), results("two", 900)],
        [*FIRST, "x bound", "median", "score / ckf", "against ckf", *ALIGNS[2:], "NEES / 3", *LAST],
    ),
    "windows": (
        lambda: [results("one", 800, runs=7, task=get_task("rlg-car-v0"))],
        [*FIRST, *ALIGNS, *LAST, "heading spread"],
    ),
    "no reference": (lambda: [unscored()], ["failed", "cost / ckf", "heading spread"]),
    "navigation": (lambda: [navigating()], [*FIRST, "median", "cost / ckf", "aligned", *ERRORS]),
    "bounded navigation": (
        lambda: [bounded(navigating())],
        [*FIRST, "x bound", "median", "against ckf", "cost / ckf", "aligned", "NEES / 9", *ERRORS],
    ),
    "by failures": (
        lambda: [navigating(rank_by="failures")],
        [*FIRST, "median", "against ckf", "cost / ckf", "aligned", *ERRORS],
    ),
}  # fmt: skip


@pytest.fixture(params=GROUPS)
def group(request):
    make, titles = GROUPS[request.param]
    return make(), titles


def markdown(group):
    head, _, *rows = [line for line in plain_tables.as_markdown(group).splitlines() if line.startswith("|")]
    split = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in (head, *rows)]
    return split[0], split[1:]


def test_every_table_has_the_titles_that_apply(group):
    lines, titles = group
    lines = [one for _, one in plain_tables.ranked(lines)]
    assert [column.title for column in columns.table_columns(lines, TERMINAL)] == titles
    names = [title for title, _ in page_tables.heads_of(lines)]
    assert sorted(names) == sorted(titles)
    plain = [column.title for column in columns.table_columns(lines, MARKDOWN)]
    assert plain == titles


def test_the_page_says_in_small_type_what_a_column_is_about(group):
    lines, _ = group
    about = "azimuth"
    if lines[0].records.criteria.navigates:
        about = "heading" if lines[0].task.rank_by == "failures" else "position"
    told = {"score": about, "failed": "", "heading": "deg", "cost / ckf": "", "time": "s", "heading spread": "°"}
    heads = dict(page_tables.heads_of(lines))
    assert {title: small for title, small in heads.items() if title in told} == {
        title: small for title, small in told.items() if title in heads
    }


def test_every_table_shows_what_its_columns_say(group):
    lines = [one for _, one in plain_tables.ranked(group[0])]
    text = text_of(terminal_tables.table(lines, WIDE), WIDE)
    head, rows = markdown(lines)
    for column in columns.table_columns(lines, MARKDOWN):
        name = column.markdown or column.title
        (at,) = [i for i, text in enumerate(head) if text.split(", ")[0] == name.split(", ")[0] and name in text]
        for row, (_, one) in zip(rows, plain_tables.ranked(lines), strict=True):
            cell = column.shown(one)
            assert row[at].startswith(cell.value), name
            assert all(part in row[at] for part in (cell.below, cell.note)), name
    for column in columns.table_columns(lines, TERMINAL):
        assert all(word in text for one in lines for word in column.shown(one).value.split(", ")), column.title
    ranked = plain_tables.ranked(lines)
    for row, (_, one) in zip(page_tables.rows_of(ranked, Lineup(lines, {}, "t")), ranked, strict=True):
        assert row.cells == [column.shown(one) for column in page_tables.page_columns(lines)]


def test_csv_and_json_have_every_figure_that_applies(group):
    lines, _ = group
    navigates = lines[0].records.criteria.navigates
    names = [name for column in columns.COLUMNS if navigates or not column.navigates for name in column.csv]
    rows = list(csv.DictReader(io.StringIO(plain_tables.as_csv(lines))))
    keys = {key for column in columns.COLUMNS if navigates or not column.navigates for key in column.json(lines[0])}
    for row, entry in zip(rows, json.loads(plain_tables.as_json(lines)), strict=True):
        assert list(row) == ["task", "suite", "rank", "solver", "settings", *names]
        assert set(entry) == {"task", "solver", "settings", *keys}


def test_figures_of_navigation_are_empty_for_alignment():
    rows = list(csv.DictReader(io.StringIO(plain_tables.as_csv([results("one", 800), navigating()]))))
    names = [name for column in columns.COLUMNS if column.navigates for name in column.csv]
    assert len(names) > 50
    assert {rows[0][name] for name in names} == {""}
    assert float(rows[1]["armse_position_m"]) == pytest.approx(3.0)


def test_no_two_figures_share_a_heading():
    names = [name for column in columns.COLUMNS for name in column.csv]
    assert len(names) == len(set(names))


@pytest.mark.parametrize("column", columns.COLUMNS, ids=lambda column: f"{column.key} {column.title}".strip())
def test_as_many_figures_as_headings(column):
    one = bounded(navigating() if column.navigates else results("one", 800))
    assert len(column.figures(one)) == len(column.csv)
    json.dumps(column.json(one), allow_nan=False)
    assert (column.cell is None) or column.shown(one).value
    assert column.drop == 0 or column.part


# ---- a narrow terminal ----


def narrowed(lines, width):
    """The table, its headings, and what the line below says was left out."""
    text = text_of(terminal_tables.table(lines, width), width)
    left_out = " ".join(text.split()).partition(f"Left out in {width} columns: ")[2].partition(";")[0]
    return text, text.partition("─")[0], left_out.split(", ")


def test_what_a_task_is_about_stays_with_its_interval():
    """Errors of one run are twice those of the others, so that there are intervals."""
    size = np.where(np.arange(30) == 0, 6.0, 3.0)
    lines = [test_navigation.solver("one", {"pos_e": size, "vel_e": 0.17 * size, "heading": 0.01 * size})]
    intervals = {}
    for name in ("score", "armse_position_h", "armse_velocity_h"):
        (column,) = [column for column in columns.table_columns(lines, TERMINAL) if column.key == name]
        intervals[name] = column.shown(lines[0]).below
    text, head, left_out = narrowed(lines, 70)
    assert "intervals of the other errors" in left_out
    assert (intervals["score"] in text, intervals["armse_velocity_h"] in text) == (True, False)
    text, head, left_out = narrowed(lines, 24)
    assert intervals["score"] in text
    assert "failed" in head
    assert not any(word in head for word in ("heading", "level", "m/s", "median"))
    assert {"heading", "position", "velocity", "median"} <= set(left_out)


def test_a_solver_below_the_bound_is_called_so():
    one = bounded(results("one", 800))
    vars(one)["below_bound"] = True
    text = text_of(terminal_tables.table([one], WIDE), WIDE)
    assert "below" in text.partition("aligned:")[0].split()
    vars(one)["below_bound"] = False
    assert "below" not in text_of(terminal_tables.table([one], WIDE), WIDE).partition("aligned:")[0].split()


# ---- a new column ----


def median_at_end(one):
    value, (low, high) = median_interval(np.degrees(np.abs(one.records.final[:, 2])))
    return value, (low, high)


@pytest.fixture
def extra(monkeypatch):
    """What somebody writes who wants one more score: the median heading error of the final epoch."""
    column = columns.estimate("median_final_heading", "final heading", "deg", median_at_end, slot=Slot.COST)
    monkeypatch.setattr(columns, "COLUMNS", [*columns.COLUMNS, column])
    return column


@pytest.mark.parametrize("make", [lambda: results("one", 800), navigating], ids=["alignment", "navigation"])
def test_a_new_entry_is_in_all_five_forms(extra, make, tmp_path, monkeypatch):
    one = dataclasses.replace(make(), stored_bound=None)
    value, (low, high) = median_at_end(one)
    cell = extra.shown(one)
    text = text_of(terminal_tables.table([one], WIDE), WIDE)
    assert "deg" in text.split("─")[0]
    assert all(part in text for part in ("heading", cell.value, cell.below))
    head, (row,) = markdown([one])
    assert row[head.index("final heading, deg")] == f"{cell.value} [{cell.below}]"
    (row,) = csv.DictReader(io.StringIO(plain_tables.as_csv([one])))
    found = [float(row[f"median_final_heading_{end}"]) for end in ("deg", "low", "high")]
    assert found == [value, low, high]
    (entry,) = json.loads(plain_tables.as_json([one]))
    assert (entry["median_final_heading_deg"], entry["median_final_heading_ci"]) == (value, [low, high])
    monkeypatch.setattr(page, "drawings", lambda task: [])
    key = Key.of(one.task.name, one.suite, one.solver, {}, "1")
    with Store(tmp_path / "r.sqlite") as store:
        monkeypatch.setattr("sins_env.evaluation.store.store.bounds.find", lambda task: None)
        monkeypatch.setattr("sins_env.evaluation.store.store.digest", lambda task: "0")
        store.add_task(one.task)
        store.add(key, one.records)
        html = page.html_report(store, [key])
    assert "final heading <small>deg</small></th>" in html
    assert f"{cell.value}</span><small>{cell.below}</small>" in html


def test_a_narrow_terminal_leaves_a_new_entry_out_last_and_says_so(extra):
    lines = [results("filterpy_ukf", 829, runs=100)]
    order = terminal_tables.dropping(columns.table_columns(lines, TERMINAL), TASK)
    assert order[-1] == "final heading"
    assert order[0] == "intervals of median"
    narrow = text_of(terminal_tables.table(lines, 42), 42)
    assert "heading, deg" not in narrow
    assert "final heading;" in " ".join(narrow.split())


def test_a_column_that_does_not_apply_is_in_no_table(monkeypatch):
    column = columns.estimate("x", "never seen", "deg", median_at_end, known=lambda one: False)
    monkeypatch.setattr(columns, "COLUMNS", [*columns.COLUMNS, column])
    lines = [results("one", 800)]
    assert "never seen" not in plain_tables.as_markdown(lines)
    assert not any(column in columns.table_columns(lines, form) for form in (TERMINAL, MARKDOWN, PAGE))
    assert "x_deg" in plain_tables.as_csv(lines)
