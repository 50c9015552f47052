"""Ctrl-C before the command has a handler, and after its work: one line or nothing, never a traceback."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

SCRIPT = Path(sys.executable).parent / "sins-env"
#: What makes a module of the command press Ctrl-C when it is imported, or at the end of the interpreter.
PRESSING = """
import atexit, os, signal, sys
def press(*_): os.kill(os.getpid(), signal.SIGINT)
class Finder:
    def find_spec(self, name, path, target=None):
        if name == {name!r}:
            press()
sys.meta_path.insert(0, Finder())
if {name!r} == "end":
    atexit.register(press)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="no SIGINT for another process")
@pytest.mark.parametrize("command", [[str(SCRIPT)], [sys.executable, "-m", "sins_env"]])
@pytest.mark.parametrize("name", ["sins_env.cli", "sins_env.moved", "sins_env.cli.command", "end"])
def test_ctrl_c_at_the_edges(tmp_path, command, name):
    (tmp_path / "sitecustomize.py").write_text(PRESSING.format(name=name))
    environment = {**os.environ, "PYTHONPATH": str(tmp_path)}
    done = subprocess.run(
        [*command, "--version"], cwd=tmp_path, env=environment, capture_output=True, text=True, timeout=120,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    if name == "end":
        assert (done.returncode, done.stderr) == (0, "")
    else:
        assert done.stderr == "sins-env: interrupted\n"
        assert done.returncode in (130, -signal.SIGINT)  # which a shell calls 130, too


def test_ctrl_c_that_became_another_error(cli, monkeypatch):
    """Before Python 3.12 that is what ``__set_name__`` makes of it while a class is made."""

    def interrupted(seed):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise RuntimeError("Error calling __set_name__") from error

    monkeypatch.setattr("sins_env.cli.verbs.results_file.seed_hash", interrupted)
    code, _, err = cli("suite-hash", "--seed", 2**70)
    assert (code, err) == (130, ["sins-env: interrupted"])
