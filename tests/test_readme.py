"""What the README promises runs as it stands: its blocks of code, its commands, and the first one of them, ``make board``."""

import dataclasses
import os
import re
import runpy
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from places import ROOT

from sins_env.cli.main import main
from sins_env.evaluation.speed import cost
from sins_env.evaluation.tasks import catalogue

README = (ROOT / "README.md").read_text()
BLOCKS = re.findall(r"```(\w+)\n(.*?)```", README, flags=re.DOTALL)
PYTHON = [code for language, code in BLOCKS if language == "python"]
SHELL = [
    line
    for language, code in BLOCKS
    if language in ("sh", "bash")
    for line in code.splitlines()
    if line.startswith("sins-env ")
]
#: The commands that only read a results file; they are given that of ``make board``.
READERS = ("board", "compare", "report", "export", "verify", "merge", "submit")
#: Settings with which the tasks of the commands are short; what is to hold, holds for HOLD_S seconds.
SHORTER: dict[str, dict[str, Any]] = {
    "sway-white-v0": {"duration": 30.0},
    "sway-scratch-v0": {"duration": 60.0, "coarse": 30.0},
    "flight-hotstart60-v0": {"duration": 60.0},
    "rlg-car-v0": {"window": [0.0, 60.0], "coarse": 30.0},
}
HOLD_S = 5.0
#: What the options of a command are given instead of what is printed.
LITTLE = {"--runs": ["2"], "--window": ["0", "100"]}


def words_of(line):
    """The arguments of a command, with few runs, which stay in this process, and short windows."""
    words = line.split("#")[0].split()[1:]
    for option, values in LITTLE.items():
        if option in words:
            at = words.index(option) + 1
            words[at : at + len(values)] = values
    return words + ["--workers", "1"] * ("--runs" in words)


@pytest.fixture(scope="module", autouse=True)
def _shorter_tasks():
    """The commands run whole on tasks cut short, and time few steps; in this process, for a fresh one would not know."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COLUMNS", "100")
        patch.setattr(cost, "BLOCKS", 2)
        for name, settings in SHORTER.items():
            task = catalogue.get_task(name)
            shorter = dataclasses.replace(task, kwargs={**task.kwargs, **settings}, hold_s=HOLD_S)
            patch.setitem(catalogue.TASKS, name, shorter)
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


@pytest.mark.parametrize("number", range(len(PYTHON)))
def test_python_block_runs(number, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "block.py").write_text(PYTHON[number])
    runpy.run_path("block.py", run_name="__main__")


def test_there_are_blocks_and_commands():
    assert len(PYTHON) >= 2
    assert len(SHELL) >= 5


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


@pytest.mark.parametrize("line", SHELL)
def test_shell_line_runs(line, made, tmp_path, monkeypatch, capsys):
    """Each command of the README, with few runs; the estimator of the README is in the current folder."""
    words = words_of(line)
    folder, needed = Path(os.environ["SINS_ENV_DATA"]), [word for word in words if word.endswith(".npz")]
    needed += ["rlg_parked_car.npz"] * ("rlg-car-v0" in words)
    for name in needed:
        if not (folder / name).exists():
            pytest.skip(f"the recording {name} is not in $SINS_ENV_DATA (the project's ../shared/data)")
    (tmp_path / "my_filter.py").write_text(PYTHON[1])
    if words[0] in READERS:
        to = [words[words.index("--db") + 1] if "--db" in words else "results.sqlite"]
        if words[0] == "merge":
            to = words[1 : words.index("--db")]
        for name in to:
            shutil.copy(made[0] / "results.sqlite", tmp_path / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    try:
        code = main(words)
    finally:
        sys.modules.pop("my_filter", None)
    out, err = capsys.readouterr()
    assert code == 0, out + err


def test_the_console_script(tmp_path):
    """The command is installed beside this Python, and a fresh process needs nothing else."""
    found = shutil.which("sins-env", path=str(Path(sys.executable).parent))
    assert found, "the console script sins-env is not installed beside this Python"
    done = subprocess.run([found, "list"], cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stderr) == (0, "")
    assert "sway-white-v0" in done.stdout
