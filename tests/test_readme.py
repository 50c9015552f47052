"""What README and the pages of docs promise runs as it stands: their code, their commands, and the first one, ``make board``."""

import contextlib
import io
import os
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from evaluation.short import cut_short
from places import ROOT

from sins_env.cli.grammar import parser
from sins_env.cli.main import main

PAGES = ("README.md", "docs/command_line.md", "docs/tasks.md", "docs/zoo.md")


class Block(NamedTuple):
    """A block of a page: Python, or commands, which run one after the other in one folder."""

    page: str
    number: int
    language: str
    code: str

    @property
    def commands(self) -> list[str]:
        return [line.split(" #")[0].rstrip() for line in self.code.splitlines() if line.startswith("sins-env ")]


def blocks():
    """Yield the blocks of all pages; a line that a page before has, too, is left out."""
    lines: set[str] = set()
    for page in PAGES:
        found = re.findall(r"^```(\w+)\n(.*?)^```", (ROOT / page).read_text(), flags=re.DOTALL | re.MULTILINE)
        for number, (language, code) in enumerate(found):
            if language == "sh":
                code = "".join(line for line in code.splitlines(True) if line.split(" #")[0].rstrip() not in lines)
                lines |= {line.split(" #")[0].rstrip() for line in code.splitlines()}
            if language in ("python", "sh"):
                yield Block(page, number, language, code)


BLOCKS = [pytest.param(block, id=f"{Path(block.page).stem}-{block.number}") for block in blocks()]
#: The commands that only read a results file; a block that makes none is given that of ``make board``.
READERS = ("board", "compare", "report", "export", "verify", "merge", "submit")
#: Settings with which the tasks of the commands are short.
SHORTER: dict[str, dict[str, Any]] = {
    "sway-white-v0": {"duration": 20.0},
    "sway-scratch-v0": {"duration": 60.0, "coarse": 30.0},
    "flight-hotstart60-v0": {"duration": 60.0},
    "rlg-car-v0": {"window": [0.0, 60.0], "coarse": 30.0},
}
#: What the options of a command are given instead of what is printed.
LITTLE = {"--runs": ["2"], "--window": ["0", "100"]}


def words_of(line):
    """The arguments of a command, with few runs, which stay in this process, and short windows."""
    words = line.split()[1:]
    for option, values in LITTLE.items():
        if option in words:
            at = words.index(option) + 1
            words[at : at + len(values)] = values
    return words + ["--workers", "1"] * ("--runs" in words)


def run(line):
    """Run a command in this process; ``> FILE`` takes its output."""
    line, _, file = (part.strip() for part in line.partition(" > "))
    out = io.StringIO()
    with contextlib.redirect_stdout(out) if file else contextlib.nullcontext():
        code = main(words_of(line))
    if file:
        Path(file).write_text(out.getvalue())
    return code


@pytest.fixture(scope="module", autouse=True)
def _shorter_tasks():
    """The commands run whole on tasks cut short, and time few steps; in this process, for a fresh one would not know."""
    with pytest.MonkeyPatch.context() as patch:
        cut_short(patch, SHORTER, blocks=2)
        yield


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """What ``make board`` leaves: the folder, and the solvers on its board."""
    folder = tmp_path_factory.mktemp("board")
    (line,) = [line for line in (ROOT / "Makefile").read_text().splitlines() if "sins-env eval" in line]
    words = words_of(line)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert main(words) == 0
    return folder, words[words.index("--solver") + 1 : words.index("--runs")]


def test_the_board_of_the_makefile(made, monkeypatch, capsys):
    folder, solvers = made
    monkeypatch.chdir(folder)
    assert solvers == ["kf", "ekf", "ukf", "ckf"]
    assert (folder / "board.png").read_bytes().startswith(b"\x89PNG")
    assert (folder / "board.png").stat().st_size > 30_000
    assert main(["board"]) == 0
    out = capsys.readouterr().out
    for part in ("sway-white-v0", "azimuth", *solvers):
        assert part in out
    assert out.count("of 2") == len(solvers)


def a_file_of_mine():
    """Write what the reader of README may have: a table of an IMU at rest, and one with fixes."""
    rng, t, latitude = np.random.default_rng(1), np.arange(1, 1001) / 100, np.radians(48.1)
    turn = 7.292115e-5 * np.array([np.cos(latitude), 0, -np.sin(latitude)]) + 1e-5 * rng.normal(size=(1000, 3))
    push = np.array([0, 0, -9.809]) + 1e-3 * rng.normal(size=(1000, 3))
    place = np.array([48.1, 11.6, 520]) + rng.normal(size=(10, 3)) * [1e-5, 1e-5, 1]
    fixes = np.column_stack([t[99::100], place, 0.05 * rng.normal(size=(10, 3))])
    for name, head, rows in (
        ("imu.csv", "t,wx,wy,wz,ax,ay,az", np.column_stack([t, turn, push])),
        ("fixes.csv", "t,lat,lon,h,vn,ve,vd", fixes),
    ):
        np.savetxt(name, rows, "%.12g", ",", header=head, comments="")


def my_filter():
    """The estimator that the page linked in README prints."""
    (page,) = re.findall(r"\[20 lines\]\((.*?\.md)", (ROOT / "README.md").read_text())
    (code,) = re.findall(r"```python\n((?:(?!```).)*class GyroAndLevel.*?)```", (ROOT / page).read_text(), re.DOTALL)
    return code


@pytest.mark.parametrize("block", BLOCKS)
def test_block_runs(block, request, tmp_path, monkeypatch, capsys):
    """A block runs from top to bottom in a folder of its own, with few runs."""
    monkeypatch.chdir(tmp_path)
    if block.language == "python":
        (tmp_path / "block.py").write_text(block.code)
        runpy.run_path("block.py", run_name="__main__")
        return
    words = [line.split()[1:] for line in block.commands]
    if any(verb[0] in READERS for verb in words) and not any(verb[0] == "eval" for verb in words):
        for name in ("results", "mine", "theirs"):
            shutil.copy(request.getfixturevalue("made")[0] / "results.sqlite", f"{name}.sqlite")
    if "imu.csv" in block.code:
        a_file_of_mine()
    if "my_filter" in block.code:
        Path("my_filter.py").write_text(my_filter())
        monkeypatch.syspath_prepend(tmp_path)
    left_out = []
    try:
        for line in block.commands:
            needed = re.findall(r"\S+\.npz", line) + ["rlg_parked_car.npz"] * ("rlg-car-v0" in line)
            if all((Path(os.environ["SINS_ENV_DATA"]) / name).exists() for name in needed):
                assert run(line) == 0, f"{line}\n{capsys.readouterr()}"
            else:
                left_out.append(line)
    finally:
        sys.modules.pop("my_filter", None)
    if left_out:
        pytest.skip(f"not in $SINS_ENV_DATA (the project's ../shared/data): the recordings of {left_out}")


def test_there_are_blocks_and_every_verb_has_its_line():
    assert {block.values[0].page for block in BLOCKS} == set(PAGES)
    page = (ROOT / "docs/command_line.md").read_text()
    (verbs,) = [action.choices for action in parser()._actions if action.choices]
    assert [verb for verb in verbs if not re.search(rf"(sins-env |`){verb}\b", page)] == []


def test_readme_is_short():
    assert len((ROOT / "README.md").read_text().splitlines()) <= 150


def test_the_console_script(tmp_path):
    """The command is installed beside this Python, and a fresh process needs nothing else."""
    found = shutil.which("sins-env", path=str(Path(sys.executable).parent))
    assert found, "the console script sins-env is not installed beside this Python"
    done = subprocess.run([found, "list"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")
    assert "sway-white-v0" in done.stdout
