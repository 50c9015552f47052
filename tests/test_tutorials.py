"""The tutorials run as they stand: their files and commands in order, in a folder each, with little work."""

import contextlib
import io
import re
import runpy
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from evaluation.short import cut_short
from places import ROOT

from sins_env.cli.main import main
from solvers import registry

TUTORIALS = runpy.run_path(str(ROOT / "benchmarks" / "tutorials.py"))
PAGES = TUTORIALS["PAGES"]
NAMES = TUTORIALS["names"]()
#: What is written in the files and commands of a page, and what is played instead.
LITTLE = {
    "aiding": {"RUNS, BEGIN, END = 10, 100, 160": "RUNS, BEGIN, END = 2, 3, 4"},
    "first_alignment": {"duration=120.0": "duration=31.0", "k % 300": "k % 150", "--runs 40": "--runs 1"},
    "own_filter": {
        "--runs 10": "--runs 1",
        "--runs 20": "--runs 1",
        "RUNS, STEPS, one = 1000, 2000": "RUNS, STEPS, one = 9, 9",
    },
    "own_recording": {
        "SECONDS = 90": "SECONDS = 20",  # so short a drive shows the unit of the gyros by itself
        "sed -i": "true",
        "(60, 75)": "(16, 18)",
        "60 75": "16 18",
        "time > 60": "time > 16",
    },
    "own_scenario": {
        "duration_s: 300": "duration_s: 30",
        "coarse_s: 60": "coarse_s: 10",
        "gsf_imm coarse_oba --runs 20": "--runs 1",
    },
    "learning": {
        '"quay.yaml", 300': '"quay.yaml", 20',
        "duration_s: 60": "duration_s: 12",
        "hold_s: 10": "hold_s: 5",
        "gsf_imm --runs 20": "--runs 1",
        "RUNS = 16": "RUNS = 2",
    },
}
#: Settings with which the tasks of the suite are played.
TASKS = {"sway-white-v0": {"duration": 20.0}, "sway-told-wrong-v0": {"duration": 20.0}}
#: Least share of the words of a printed block that its commands must print.
WORDS_KEPT = 0.7


@pytest.fixture(autouse=True)
def _little_work(monkeypatch):
    """Tasks cut short and few steps timed, in this process; what a page registers is forgotten afterwards."""
    cut_short(monkeypatch, TASKS, blocks=1)
    before = set(registry.FILTERS), set(sys.modules)
    yield
    for name in set(registry.FILTERS) - before[0]:
        del registry.FILTERS[name]
    for name in set(sys.modules) - before[1]:
        if str(getattr(sys.modules[name], "__file__", None)).startswith(str(Path.cwd())):
            del sys.modules[name]


def run(line):
    """Run one command, those of Python and of sins-env in this process and whole, and return what it prints."""
    line, may_fail = line.removesuffix(" || true"), line.endswith(" || true")
    words, out = shlex.split(line.split(" | ")[0], comments=True), io.StringIO()
    words, file = (words[:-2], words[-1]) if ">" in words[-2:-1] else (words, None)
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        if words[0] == "sins-env":
            workers = ["--workers", "1"] if "--runs" in words else []
            assert (main(words[1:] + workers) == 0) != may_fail, out.getvalue()
        elif words[0] == "python":
            runpy.run_path(words[1], run_name="__main__")
        else:
            return subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=True).stdout
    if file:
        Path(file).write_text(out.getvalue())
        return ""
    return out.getvalue()


def words_of(text):
    return set(re.findall(r"[a-zA-Z]{3,}", text))


@pytest.mark.parametrize("name", NAMES)
def test_a_tutorial_runs(name, tmp_path, monkeypatch):
    """Each command ends well, prints about the words that the page shows, and draws the figures that it has."""
    page, shorter = (PAGES / f"{name}.md").read_text(), LITTLE[name]
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    asked = "".join(block.text for block in TUTORIALS["blocks"](page) if block.language != "text")
    assert [long for long in shorter if long not in asked] == []
    printed = ""
    for block in TUTORIALS["blocks"](page):
        text = block.text
        if block.language == "text":
            shown = words_of(text)
            assert len(shown & words_of(printed)) >= WORDS_KEPT * len(shown), f"shown:\n{text}\nprinted:\n{printed}"
            continue
        for long, short in shorter.items():
            text = text.replace(long, short)
        if block.file:
            (tmp_path / block.file).write_text(text)
        elif block.language == "sh":
            printed = "".join(map(run, text.replace("\\\n", " ").splitlines()))
    drawn = [(stored, file) for stored, file in TUTORIALS["figures"](page)]
    assert [file for stored, file in drawn if not ((tmp_path / file).is_file() and (PAGES / stored).is_file())] == []


def test_every_page_is_listed():
    """The first page names all others, each with a time that was measured."""
    listed = re.findall(r"\]\((\w+)\.md\)", (PAGES / "index.md").read_text())
    assert sorted(listed) == NAMES
    for name in NAMES:
        assert re.search(r"^\*Run time: .* \d+ s of CPU time", (PAGES / f"{name}.md").read_text(), re.MULTILINE), name
