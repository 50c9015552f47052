"""The README's code blocks run as they stand, and its promises are there."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from places import ROOT

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


@pytest.mark.parametrize("number", range(len(PYTHON)))
def test_python_block_runs(number, tmp_path):
    env = {**os.environ, "PYTHONPATH": str(ROOT)}
    script = tmp_path / "block.py"
    script.write_text(PYTHON[number])
    done = subprocess.run([sys.executable, script], cwd=tmp_path, env=env, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr


def test_there_are_blocks_and_commands():
    assert len(PYTHON) >= 2
    assert len(SHELL) >= 5


@pytest.mark.parametrize("line", SHELL)
def test_shell_line_runs(line, tmp_path):
    """Each command of the README, with few runs; the custom estimator of the README is on the path."""
    (tmp_path / "my_filter.py").write_text(PYTHON[1])
    words = line.split("#")[0].split()
    if "--runs" in words:
        words[words.index("--runs") + 1] = "2"
    elif words[1] in ("board", "compare", "report", "export", "verify"):
        prepare = ["eval", "--task", "sway-white-v0", "--solver", "ekf", "ckf", "--runs", "2"]
        prepare += words[words.index("--db") :][:2] if "--db" in words else []
        subprocess.run([command(), *prepare], cwd=tmp_path, check=True, capture_output=True, timeout=300)
    folder, needed = Path(os.environ["SINS_ENV_DATA"]), [word for word in words if word.endswith(".npz")]
    needed += ["rlg_parked_car.npz"] * ("rlg-car-v0" in words)
    for name in needed:
        if not (folder / name).exists():
            pytest.skip(f"the recording {name} is not in $SINS_ENV_DATA (the project's ../shared/data)")
    done = subprocess.run([command(), *words[1:]], cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout + done.stderr


def command():
    found = shutil.which("sins-env", path=str(Path(sys.executable).parent))
    assert found, "the console script sins-env is not installed beside this Python"
    return found
