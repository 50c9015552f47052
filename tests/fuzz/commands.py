"""Command lines of every verb, and results files of others read by them."""

import contextlib
import io
import os
import sqlite3
import sys
import unicodedata
from functools import cache
from typing import Any

from hypothesis import strategies as st

from fuzz.kind import folder, kind, put
from fuzz.outcome import Failed, attempt
from fuzz.solving import lasting
from fuzz.values import Code, byte_edits, edited_bytes, junk, numbers, play, some
from sins_env.cli.grammar import parser
from sins_env.cli.main import main
from sins_env.evaluation import evaluate
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store

VERBS = sorted(parser().verbs)
PLAYING = (
    "run",
    "eval",
    "bench",
    "reproduce",
    "check",
    "replay",
)  #: verbs that would play for long with a sound solver
OPTIONS = sorted(
    {flag for verb in parser().verbs.values() for action in verb._actions for flag in action.option_strings}
)
WORDS = [
    "sway-white-v0", "ckf", "nope", ":", "::", "x:", "..", ".", "/", "", " ", "-", "--", "-1", "0", "nan", "inf",
    "1e999", "٣", "²", "é", "\udcff", "[bold]", "[/]", "a=b", "=", "a=", "x={", "x=NaN", "/nope/x.sqlite",
    "/dev/null", "/etc/passwd", "/dev/full", "x.html", "x.csv", "x.imu", "x.json", "x.png", "SINS/AlignSway-v0",
    "tactical", "hotstart60", "lu-gauss", "CartPole-v1", "hotstart60.yaml", "gps", "\x00", "1e-320", "\x1b[31m",
    "\u202e", "a\nb", "100000000000000000000", "environments", "solvers", "tables", "2.3", "FRD", Code("'9' * 5000"),
    Code("'x=' + '[' * 3000"), Code("'x=' + '9' * 5000"), Code("'a' * 5000"), Code("'[' * 3000"),
]  # fmt: skip
commands = st.tuples(
    st.sampled_from([*VERBS, *VERBS, "nope", "", "-"]), st.lists(st.sampled_from(WORDS + OPTIONS), max_size=6)
)


def run(arguments: list[str]) -> str:
    """Run a command; its errors are one line each, its exit code 0, 1 or 2."""
    out, err, code = io.StringIO(), io.StringIO(), [-1]

    def go() -> None:
        before, sys.stdin = sys.stdin, io.StringIO("")
        try:
            with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                code[0] = main(arguments)
        finally:
            sys.stdin = before

    attempt(go)
    said = err.getvalue()
    if "SINS_ENV_TRACEBACK" in said or "Traceback" in said:
        raise Failed(f"internal: {said.strip().splitlines()[-1][:80]}", said[-300:])
    if len(said) > 6000:
        raise Failed(f"{len(said)} characters of errors", said[:300])
    if any(unicodedata.category(c) in ("Cc", "Cf", "Cs") for c in said if c not in "\n\r"):
        raise Failed("control characters on standard error", repr(said[:300]))
    errors = [line for line in said.splitlines() if line.startswith("sins-env:")]
    if code[0] == 2 and len(errors) != 1 and arguments:
        raise Failed(f"{len(errors)} error lines", said[:300])
    if code[0] not in (0, 1, 2):
        raise Failed(f"exit code {code[0]}", said[:300])
    return "refused" if code[0] else "worked"


@kind("command lines", commands, share=5, slice=60)
def command_lines(example: Any) -> str:
    verb, words = play(example)
    if verb in PLAYING:
        words = ["nope" if word == "ckf" else word for word in words]
        words = {"reproduce": ["99.99"], "bench": ["nope"]}.get(verb, []) + words
        words += ["--solver", "nope"] * (verb == "eval")
    os.chdir(folder())
    return run([verb, *words])


@cache
def results() -> bytes:
    """Return a results file of two tasks' runs."""
    path = folder() / "sound.sqlite"
    with Store(path) as store:
        for name in ("sway-white-v0", "sway-jump-v0"):
            task = lasting(name, 2.0)
            store.add_task(task)
            for solver in ("kf", "ckf"):
                found = evaluate(task, solver, 3, workers=1, cost=False)
                store.add(Key.of(task.name, found.suite, solver, {}, "1"), found.records)
    return path.read_bytes()


READING = (
    ["board"], ["board", "--json"], ["board", "--md"], ["board", "--csv"], ["export", "--csv", "out.csv"],
    ["export", "--json", "out.json"], ["compare", "sway-white-v0", "kf", "ckf"], ["report", "--html", "out.html"],
    ["verify", "--rows", "1", "--draw", "0"],
)  # fmt: skip
reading = st.sampled_from(list(READING[:-2]) * 3 + [READING[-2]])


@kind("results files, bytes", st.tuples(byte_edits, reading), share=2, slice=8, prepare=results)
def results_bytes(example: Any) -> str:
    edits, words = example
    path = put("bytes.sqlite", edited_bytes(results(), edits))
    for more in ("-wal", "-shm", "-journal"):
        path.with_name(path.name + more).unlink(missing_ok=True)
    os.chdir(folder())
    return run([*words, "--db", path.name])


TEXTS = [
    "",
    "nan",
    "=1+1",
    "\x1b[31m",
    "<b>",
    "a" * 5000,
    "\u202e",
    "{",
    "[]",
    "null",
    '{"kind": 1}',
    "os:system",
    "\x00",
]
cells = st.lists(st.tuples(some, some, some, junk | numbers | st.sampled_from(TEXTS)), min_size=1, max_size=2)


@kind("results files, values", st.tuples(cells, reading), share=2, slice=8, prepare=results)
def results_values(example: Any) -> str:
    edits, words = example
    path = put("values.sqlite", results())
    with contextlib.closing(sqlite3.connect(path)) as db:
        tables = [row[0] for row in db.execute("SELECT name FROM sqlite_master WHERE type = 'table' ORDER BY name")]
        for which, column, row, value in edits:
            table = tables[which % len(tables)]
            columns = [found[1] for found in db.execute(f"PRAGMA table_info({table})")]
            name, value = columns[column % len(columns)], play(value)
            count = db.execute(f"SELECT count(*) FROM {table}").fetchone()[0]
            with contextlib.suppress(sqlite3.Error, ValueError, OverflowError):  # what SQLite itself cannot hold
                if count:
                    db.execute(f"UPDATE {table} SET {name} = ? WHERE rowid = ?", (value, 1 + row % count))
        db.commit()
    os.chdir(folder())
    return run([*words, "--db", path.name])
