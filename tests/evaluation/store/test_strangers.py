"""A results file of a stranger: nothing in it is run or computed, what does not belong is one line, and the rest is shown."""

import contextlib
import csv
import json
import math
import os
import sqlite3
import struct
import sys
import zlib
from pathlib import Path

import pytest
from evaluation.short import SHORT

from sins_env.evaluation import evaluate
from sins_env.evaluation.bound import bounds
from sins_env.evaluation.estimators import version
from sins_env.evaluation.speed.cost import Cost
from sins_env.evaluation.store import inspection
from sins_env.evaluation.store.database import StoreError
from sins_env.evaluation.store.key import Key, settings_hash
from sins_env.evaluation.store.rows import MOST_TEXT, cut
from sins_env.evaluation.store.store import Store

SOLVERS = ("evaluation.plugins:At", "evaluation.plugins:Told")
NASTY = "=1<b>|[red]$x$\x1b[2J\x9b\u202e\u2066\u200b\n\r"


@pytest.fixture(scope="session")
def small(tmp_path_factory):
    """A file with two solvers and three runs each, as bytes."""
    path = tmp_path_factory.mktemp("small") / "small.sqlite"
    with Store(path) as db:
        db.add_task(SHORT)
        for solver in SOLVERS:
            found = evaluate(SHORT, solver, 3, workers=1, cost=False)
            key = Key.of(SHORT.name, found.suite, solver, {}, "1")
            db.add(key, found.records)
            db.add_cost(key, Cost(100.0, 150.0, 1.5))
    return path.read_bytes()


@pytest.fixture
def changed(small, tmp_path, monkeypatch, short):
    """Change the file by statements, and return its path."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")

    def change(*statements):
        path = tmp_path / "results.sqlite"
        path.write_bytes(small)
        db = sqlite3.connect(path)
        for one in statements:
            one(db) if callable(one) else db.execute(*((one,) if isinstance(one, str) else one))
        db.commit()
        db.close()
        return path

    return change


def settings(text):
    return "UPDATE runs SET settings = ?, settings_hash = ?", (text, settings_hash(text))


def document(column, **values):
    """A change of entries of a JSON document."""

    def change(db):
        (text,) = db.execute(f"SELECT {column} FROM tasks").fetchone()
        db.execute(f"UPDATE tasks SET {column} = ?", (json.dumps(json.loads(text) | values),))

    return change


def in_schema(change):
    """A change of the table of tables itself, which SQLite does not check."""

    def make(db):
        db.execute("PRAGMA writable_schema = ON")
        change(db)

    return make


def of_sessions(text):
    """A text that stands behind the columns of a table."""
    sql = "UPDATE sqlite_master SET sql = replace(sql, 'machine TEXT', 'machine TEXT' || ?) WHERE name = 'sessions'"
    return in_schema(lambda db: db.execute(sql, (text,)))


def many_tables(db):
    rows = [("table", f"x{i}", f"x{i}", 2, f"CREATE TABLE x{i} (a)") for i in range(3000)]
    db.executemany("INSERT INTO sqlite_master VALUES (?, ?, ?, ?, ?)", rows)


REFUSED = {
    "blob as a name": ("UPDATE runs SET solver = x'fffe' WHERE id = 2", "row 2: solver is a blob of 2 bytes; allowed: 1 to"),
    "no name": ("UPDATE runs SET task = NULL", "runs, row 1: task is NULL"),
    "long name": ("UPDATE runs SET code = hex(zeroblob(300))", "runs, row 1: code is text of length 600"),
    "name behind a zero byte": ("UPDATE runs SET code = 'a' || char(0) || hex(zeroblob(5000))", "runs, row 1: code is text of"),
    "text as a session": ("UPDATE runs SET session = '<b>'", "runs, row 1: session is text of length 3; allowed: the id"),
    "long machine": ("UPDATE sessions SET machine = hex(zeroblob(5000))", "sessions, row 1: machine is text of length 10000"),
    "blob as a digest": ("UPDATE tasks SET digest = x'00'", "tasks, row 1: digest is a blob of 1 bytes; allowed: 1 to"),
    "not UTF-8": ("UPDATE runs SET suite = cast(x'fffe41' AS text)", "a text that is not UTF-8"),
    "huge row": ("UPDATE runs SET reason = hex(zeroblob(10000000))", "a row of more than 16 MB"),
    "text as a score": ("UPDATE runs SET steady_rms_u = 'abc' WHERE run = 2", "row 3: steady_rms_u is text of length 3"),
    "blob as a score": ("UPDATE runs SET nees_50 = x'00'", "nees_50 is a blob"),
    "infinite angle": ("UPDATE runs SET final_u = -9e999", "final_u is -inf; allowed: an angle in rad"),
    "negative time": ("UPDATE runs SET t_conv_e = -5", "t_conv_e is -5.0; allowed: a number from 0 to 1e+50, or inf"),
    "huge NEES": ("UPDATE runs SET nees_100 = 1e308", "nees_100 is 1e+308; allowed: a number from 0 to 1e+50, or inf"),
    "huge cost": ("UPDATE costs SET ratio = 1e308", "ratio is 1e+308; allowed: a number from 0 to 1e+50"),
    "huge bound": ("UPDATE tasks SET bound = json_set(bound, '$.steady[0]', 1e308)", "each 0 or of size 1e-50 to 1e+50"),
    "tiny bound": ("UPDATE tasks SET bound = json_set(bound, '$.steady[0]', 5e-324)", "each 0 or of size 1e-50 to 1e+50"),
    "texts in a bound": ("UPDATE tasks SET bound = json_set(bound, '$.t[0]', '1')", "t; allowed: lists of finite numbers"),
    "text as a run": ("UPDATE runs SET run = 'a' WHERE run = 0", "run is text of length 1; allowed: a whole number"),
    "negative run": ("UPDATE runs SET run = -1 WHERE run = 0", "run is -1"),
    "fraction of a count": ("UPDATE runs SET repairs = 0.5", "repairs is 0.5"),
    "no count": ("UPDATE runs SET fallbacks = NULL", "fallbacks is NULL"),
    "status": ("UPDATE runs SET status = '<b>'", "status is text of length 3; allowed: one of ok, diverged"),
    "no reason": ("UPDATE runs SET reason = NULL", "reason is NULL"),
    "hash of the settings": ("UPDATE runs SET settings = '{\"a\": 1}'", "settings_hash is '44136fa355b3'; allowed: 'f9"),
    "no settings": ("UPDATE runs SET settings = NULL", "row 1: settings cannot be read"),
    "list of settings": (settings("[1]"), "row 1: settings cannot be read: a JSON list; allowed: an object"),
    "deep settings": (settings('{"a": ' + "[" * 5000 + "]" * 5000 + "}"), "nested deeper than 32 levels"),
    "settings of 50 levels": (settings('{"a": ' + "[" * 50 + "]" * 50 + "}"), "nested deeper than 32 levels"),
    "text as a cost": ("UPDATE costs SET ratio = 'b'", "table costs, row 1: ratio is text"),
    "negative cost": ("UPDATE costs SET median_us = -1", "median_us is -1.0; allowed: a number from 0"),
    "list of versions": ("UPDATE sessions SET versions = '[]'", "table sessions, row 1: versions cannot be read"),
    "no criteria": ("UPDATE tasks SET criteria = NULL", "row 1: task is 'short-v0', for which the table tasks has no criteria"),
    "empty criteria": ("UPDATE tasks SET criteria = '{}'", "table tasks, row 1: criteria cannot be read"),
    "epochs without end": (document("criteria", num_epochs=10**12), "num_epochs = 1000000000000; allowed: a whole"),
    "epochs as a fraction": (document("criteria", num_epochs=20.5), "num_epochs = 20.5"),
    "no time": (document("criteria", epoch_s=0), "epoch_s = 0"),
    "hardly any time": (document("criteria", epoch_s=5e-324), "epoch_s = 5e-324"),
    "no thresholds": (document("criteria", delta=[0, 0, 0]), "delta = [0, 0, 0]"),
    "many thresholds": (document("criteria", delta=[1.0] * 50), "three positive numbers"),
    "other limits": (document("criteria", navigates=True), "limit = "),
    "list as a definition": ("UPDATE tasks SET definition = '[]'", "definition cannot be read: a JSON list; allowed: an object"),
    "deep definition": ("UPDATE tasks SET definition = replace(hex(zeroblob(50000)), '00', '[')", "nested deeper than 32 levels"),
    "another name": (document("definition", name="other"), "another name than the task's"),
    "another's environment": (document("definition", env_id="CartPole-v1"), "unknown env_id 'CartPole-v1'"),
    "environment of a module": (document("definition", env_id="evil:Zen-v0"), "unknown env_id 'evil:Zen-v0'"),
    "settings of no object": (document("definition", kwargs=3), "kwargs = 3; allowed: an object"),
    "unknown rank": (document("definition", rank_by="x"), "unknown rank_by 'x'"),
    "many records": (document("definition", records=10**12, kwargs={"heading_deg": [1]}), "heading_deg = [1]"),
    "part of a bound": ("UPDATE tasks SET bound = '{\"t\": 1}'", "bound cannot be read"),
    "ragged bound": ("UPDATE tasks SET bound = json_insert(bound, '$.sigma[#]', json('[1]'))", "sigma; allowed: lists of finite"),
    "short bound": ("UPDATE tasks SET bound = json_set(bound, '$.t', json('[1]'), '$.sigma', json('[[1, 1, 1]]'))", "1 times"),
    "trigger": ("CREATE TRIGGER t AFTER INSERT ON runs BEGIN UPDATE runs SET final_u = 9; END", "the trigger 't'; allowed: "),
    "view": ("CREATE VIEW v AS SELECT 1", "the view 'v'"),
    "another table": ("CREATE TABLE evil (a)", "the table 'evil'"),
    "another index": ("CREATE INDEX evil ON runs (abs(run))", "the index 'evil'"),
    "another column": ("ALTER TABLE runs ADD COLUMN evil TEXT", "the table runs has 'evil TEXT'"),
    "computed column": ("ALTER TABLE tasks ADD COLUMN x AS (hex(zeroblob(1000000000)))", "tasks has the computed column 'x'"),
    "no column": ("ALTER TABLE costs DROP COLUMN ratio", "the table costs lacks 'ratio REAL'"),
    "no table": ("DROP TABLE histories", "it has no table histories"),
    "thousands of tables": (in_schema(many_tables), "not a results file of sins-env: too many tables and indices"),
    "long statement": (of_sessions(", CHECK (id IN (" + "1, " * 50_000 + "1))"), "damaged (not a whole SQLite file)"),
    "thousands of columns": (of_sessions(", c" + " INT, c".join(map(str, range(1900)))), "the table sessions has 'c"),
    "costly check": (of_sessions(", CHECK (hex(zeroblob(900000000)))"), "the table sessions has 'CHECK"),
    "older, with a costly index": (
        "CREATE INDEX x ON runs (length(hex(zeroblob(9000000 + run))))", "the index 'x'", 3,
    ),
    "virtual table": ("CREATE VIRTUAL TABLE evil USING fts5(a)", "the table 'evil"),
    "older, with a trigger": ("CREATE TRIGGER t AFTER INSERT ON tasks BEGIN SELECT 1; END", "the trigger 't'", 3),
    "older, computed": ("ALTER TABLE costs ADD COLUMN x AS (hex(zeroblob(1000000000)))", "the computed column 'x'", 3),
    "older, with a bad row": ("UPDATE runs SET status = 'x'", "status is text of length 1", 3),
}  # fmt: skip


@pytest.mark.parametrize("kind", REFUSED)
def test_what_does_not_belong_is_one_line_and_the_file_stays_as_it_is(changed, cli, kind):
    statement, text, *older = REFUSED[kind]
    path = changed(
        statement,
        *(f"PRAGMA user_version = {one}" for one in older),
        *(["DROP TABLE spans", "DROP TABLE adoptions"] if older else []),
    )
    before = path.read_bytes()
    code, out, (said,) = cli("board")
    assert (code, out) == (2, "")
    assert said.startswith("sins-env: results.sqlite: ")
    assert text in said
    assert len(said) < 600
    with pytest.raises(StoreError, match=r"results\.sqlite: "):
        Store(path)
    assert path.read_bytes() == before


def test_an_index_that_has_other_names_than_the_rows_is_damage(changed, cli):
    kept = "SELECT * FROM sqlite_master WHERE type = 'index' AND tbl_name = 'runs'"

    def without_index(db):
        (sql,) = db.execute("SELECT sql FROM sqlite_master WHERE name = 'runs'").fetchone()
        indices = db.execute(kept).fetchall()
        db.executescript(
            "PRAGMA writable_schema = ON; DELETE FROM sqlite_master WHERE type = 'index' AND tbl_name = 'runs'"
        )
        bare = f"{sql[: sql.index(', UNIQUE')]})"
        db.execute("UPDATE sqlite_master SET sql = ? WHERE name = 'runs'", (bare,))
        db.commit()
        (path,) = [one for _, _, one in db.execute("PRAGMA database_list")]
        with contextlib.closing(sqlite3.connect(path)) as other:
            other.executescript("UPDATE runs SET solver = x'00ff'; PRAGMA writable_schema = ON;")
            other.execute("UPDATE sqlite_master SET sql = ? WHERE name = 'runs'", (sql,))
            other.executemany("INSERT INTO sqlite_master VALUES (?, ?, ?, ?, ?)", indices)
            other.commit()

    changed(without_index)
    code, out, (said,) = cli("board")
    assert (code, out) == (2, "")
    assert "results.sqlite: damaged (row 1 missing from index " in said


def test_pages_that_refer_to_one_page_many_times_are_not_followed(changed, cli):
    """A table of 200^12 rows in 13 pages."""
    path = changed()
    with contextlib.closing(sqlite3.connect(path)) as db:
        (root,) = db.execute("SELECT rootpage FROM sqlite_master WHERE name = 'costs'").fetchone()
        (size,) = db.execute("PRAGMA page_size").fetchone()
    data = path.read_bytes()
    pages = [data[(root - 1) * size : root * size]]
    for child in range(len(data) // size + 1, len(data) // size + 13):
        at = [size - 6 * (i + 1) for i in range(200)]
        head = struct.pack(">BHHHBI200H", 5, 0, 200, at[-1], 0, child, *at)
        cells = b"".join(struct.pack(">IBB", child, 0x80 | i >> 7, i & 0x7F) for i in reversed(range(200)))
        pages.append(head.ljust(at[-1], b"\0") + cells)
    data = data[: (root - 1) * size] + pages.pop() + data[root * size :] + b"".join(pages)
    path.write_bytes(data[:28] + struct.pack(">I", len(data) // size) + data[32:])
    code, out, (said,) = cli("board")
    assert (code, out) == (2, "")
    assert "damaged (On tree page " in said
    assert len(said) < 200


def test_a_journal_that_names_another_file_removes_nothing(changed, cli):
    """SQLite removes the file that the end of a journal names after it has rolled back the first page."""
    path = changed("PRAGMA journal_mode = DELETE")
    victim = Path("victim").resolve()
    victim.write_text("dear")
    with contextlib.closing(sqlite3.connect(path)) as db:
        (size,) = db.execute("PRAGMA page_size").fetchone()
    data, mark, name = path.read_bytes(), bytes.fromhex("d9d505f920a163d7"), os.fsencode(victim)
    head = mark + struct.pack(">IIIII", 0, 0, len(data) // size, 512, size)
    end = struct.pack(">I", 2**30 // size + 1) + name + struct.pack(">II", len(name), sum(name)) + mark
    Path("results.sqlite-journal").write_bytes(head.ljust(512, b"\0") + end)
    for verb in (("board",), ("eval", "--task", "short-v0", "--solver", "kf", "--runs", 1)):
        code, _, (said,) = cli(*verb)
        assert (code, victim.read_text()) == (2, "dear")
        assert "results.sqlite-journal: names another file" in said
    Path("results.sqlite-journal").unlink()
    assert cli("board")[0] == 0


def test_every_column_has_a_rule():
    """A new field needs no entry: the rules follow from the descriptions of the fields."""
    ruled = {(table, name) for table, _, rules in inspection._RULES for name in rules}
    db = sqlite3.connect(":memory:")
    for statement in inspection.SCHEMA:
        db.execute(statement)
    tables = {table for table, _ in ruled}
    held = {(table, name) for table in tables for _, name, *_ in db.execute(f"PRAGMA table_info({table})")}
    seen_elsewhere = {("runs", "settings")}
    assert held - ruled - seen_elsewhere == {("runs", "id"), ("spans", "id"), ("sessions", "id")}


@pytest.mark.parametrize(
    "blob", [zlib.compress(b"abcd"), zlib.compress(bytes(10**8), 9), b"junk", b"", None, "text"], ids=repr
)
def test_a_history_is_inflated_up_to_its_size(changed, cli, blob):
    changed(("UPDATE histories SET history = ? WHERE id = 2", (blob[:200000] if blob else blob,)))
    assert cli("board", "--json")[0] == 0  # which needs no history
    code, _, (said,) = cli("report", "--html", "r.html")
    assert (code, "rows of evaluation.plugins:At on short-v0 cannot be read (the history of run 1 " in said) == (
        2,
        True,
    )
    assert not Path("r.html").exists()


@pytest.mark.parametrize(
    ("solver", "given"),
    [
        ("posix:system", {"command": "touch PWNED"}),
        ("subprocess:run", {"args": ["touch", "PWNED"]}),
        ("evil:Factory", {}),
        ("evil", {}),
        ("lib.evil:Factory", {}),
    ],
)
def test_verify_imports_nothing_that_only_the_file_names(changed, cli, solver, given):
    for path in ("evil.py", "lib/evil.py"):
        Path(path).parent.mkdir(exist_ok=True)
        Path(path).write_text("open('PWNED', 'w').close()\n")
    text = json.dumps(given, sort_keys=True)
    of_one = ("UPDATE runs SET solver = ?, settings = ?, settings_hash = ?", (solver, text, settings_hash(text)))
    changed("DELETE FROM runs WHERE solver LIKE '%Told'", of_one)
    before = list(sys.path)
    code, _, said = cli("verify", "--workers", 1)
    assert code == 1
    assert said[0].startswith("not verifiable, 3 runs: ")
    assert solver in said[0]
    assert said[-1] == "sins-env: results.sqlite: no run could be verified"
    if ":" in solver:  # not even then, for the code is another
        code, _, said = cli("verify", "--workers", 1, "--solver", solver)
        assert (code, "made with code 1, this is" in said[0] or "no solver" in said[0]) == (1, True)
    assert not Path("PWNED").exists()
    assert "evil" not in sys.modules
    sys.path[:] = before


def test_a_solver_that_is_named_on_the_command_line_is_run_again(changed, cli):
    changed(("UPDATE runs SET code = ?", (version.code_version(SOLVERS[1]),)))
    code, _, said = cli("verify", "--workers", 1)
    assert (code, "named by the file alone" in said[0]) == (1, True)
    code, out, _ = cli("verify", "--workers", 1, "--solver", SOLVERS[1])
    assert (code, out) == (0, "3 runs made again: equal to 1e-9\n")


def test_a_missing_bound_is_computed_for_the_installed_task_only(changed, monkeypatch):
    asked = []
    monkeypatch.setattr(bounds, "find", lambda task: asked.append(task.name))
    for change, expected in (
        ("UPDATE tasks SET bound = NULL", ["short-v0"]),
        ("UPDATE tasks SET bound = NULL, digest = 'another'", []),
        ("UPDATE tasks SET bound = NULL, definition = json_set(definition, '$.kwargs.duration', 1e7)", []),
        ("UPDATE tasks SET bound = 'null'", []),
    ):
        asked.clear()
        with Store(changed(change), read_only=True) as db:
            assert [db.results(key).bound for key in list(db.keys())] == [None, None]
        assert sorted(set(asked)) == expected


def test_a_bound_of_zero_is_shown_without_a_warning(changed, cli):
    changed("UPDATE tasks SET bound = json_set(bound, '$.steady', json('[0, 0, 0]'), '$.final', json('[0, 0, 0]'))")
    code, out, said = cli("board", "--json")
    assert (code, said) == (0, [])
    assert len(json.loads(out)) == 2


@pytest.fixture
def nasty(changed):
    """A file whose every text steers something."""
    text = json.dumps({NASTY: [NASTY]}, sort_keys=True)
    return changed(
        ("UPDATE runs SET task = ?, suite = ?, code = ?, status = 'raised', reason = ?, traceback = ?", (NASTY,) * 5),
        (
            "UPDATE runs SET solver = ? || length(solver), settings = ?, settings_hash = ?",
            (NASTY, text, settings_hash(text)),
        ),
        (
            "UPDATE tasks SET task = ?1, definition = json_set(definition, '$.name', ?1, '$.what', ?1, '$.source', ?1)",
            (NASTY,),
        ),
        ("UPDATE tasks SET digest = ?", (NASTY,)),
        ("UPDATE sessions SET machine = ?1, started = ?1, versions = json_object(?1, ?1)", (NASTY,)),
    )


def harmless(text):
    assert [one for one in text if not (one.isprintable() or one in "\n\xa0")] == []
    return text


def test_text_is_shown_and_steers_nothing(nasty, cli):
    shown = "\\x1b[2J\\x9b\\u202e\\u2066\\u200b\\n\\r"
    for form in ((), ("--md",), ("--csv",), ("--json",)):
        code, out, said = cli("board", *form)
        assert (code, said) == (0, [])
        assert "\\x1b[2J" in harmless(out)
    assert "<b>" not in cli("board", "--md")[1]
    row = next(csv.DictReader(cli("board", "--csv")[1].splitlines()))
    assert row["task"] == f"'=1<b>|[red]$x${shown}"
    assert float(row["rms_u_arcsec"]) > 0
    assert cli("report", "--html", "r.html")[0] == 0
    page = harmless(Path("r.html").read_text())
    assert "<b>|" not in page
    assert page.count(f"=1&lt;b&gt;|[red]$x${shown}") > 10
    with Store(nasty, read_only=True) as db:
        a, b = db.keys()
    assert NASTY in a.solver  # as it is stored
    code, out, _ = cli("compare", a.task, a.solver, b.solver)
    assert (code, shown in harmless(out)) == (0, True)
    code, _, said = cli("verify", "--workers", 1)
    assert (code, shown in harmless("\n".join(said))) == (1, True)
    code, _, said = cli("compare", a.task, a.solver, "\x1b[31mx")
    assert (code, harmless(said[0]).count("\\x1b") > 1) == (2, True)


def test_exports_compute_nothing_and_lose_nothing(nasty, cli):
    assert cli("export", "--csv", "e.csv")[0] == cli("export", "--json", "e.json")[0] == 0
    rows = list(csv.DictReader(harmless(Path("e.csv").read_text()).splitlines(keepends=True)))
    assert {row[name][:2] for row in rows for name in ("task", "solver", "suite", "code", "reason")} == {"'="}
    assert all(float(row["final_u_rad"]) for row in rows)
    assert json.loads(Path("e.json").read_text())[0]["reason"] == NASTY


def test_a_figure_shows_dollars_and_markup_as_they_are(nasty, cli):
    assert cli("board", "--plot", "p.svg")[0] == 0
    assert Path("p.svg").stat().st_size > 10_000
    assert not list(Path().glob(".*.part"))


def test_messages_are_cut_when_they_are_stored(tmp_path, short):
    assert cut("é" * MOST_TEXT) == "é" * (MOST_TEXT // 2)
    assert cut("\ud800x") == "\\ud800x"
    found = evaluate(short, SOLVERS[0], 1, workers=1, cost=False)
    key = Key.of(short.name, found.suite, "s", {}, "1")
    row = found.records.row(0) | {
        "status": "raised",
        "reason": "r" * 10**7,
        "traceback": "\udc80" * 10**6,
        "step_s": 1e300,
    }
    with Store(tmp_path / "r.sqlite") as db:
        db.add(key, found.records.of_rows(found.records.criteria, [row]))
        (records,) = [db.results(key).records]
    assert len(records.reason[0]) == MOST_TEXT
    assert records.step_s[0] == math.inf  # a finite one would be refused
    assert records.traceback[0].startswith("\\udc80\\udc80")
    assert os.path.getsize(tmp_path / "r.sqlite") < 200_000
