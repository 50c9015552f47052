"""Completion in the shell: verbs from the grammar, names of tasks, solvers, environments, kinds and tables."""

import os
import subprocess
import sys

import pytest

from sins_env.cli import completion, grammar
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.tasks.catalogue import TASKS


def offered(verb, dest):
    (action,) = (action for action in completion.answering().verbs[verb]._actions if action.dest == dest)
    return action.completer(prefix="")


@pytest.mark.parametrize("verb", ["run", "eval", "board", "compare", "bound", "bench"])
def test_tasks(verb):
    assert set(TASKS) <= set(offered(verb, "task"))


@pytest.mark.parametrize("verb", ["run", "eval", "check", "replay", "compare", "navigate", "submit"])
def test_solvers(verb):
    assert set(offered(verb, "solver")) == set(finding.names())


def test_the_rest():
    assert {"tasks", "environments", "aids"} <= set(offered("list", "kind"))
    assert {"SINS/AlignSway-v0", "gsf_imm", "sway-white-v0", "mems", "scenario"} <= set(offered("describe", "name"))
    assert "6.zoo" in offered("reproduce", "table")
    given = {action.dest for sub in grammar.parser().verbs.values() for action in sub._actions}
    assert set(completion.NAMES) <= given, "a name that the grammar no longer has"


def test_a_shell_is_answered(tmp_path):
    """The command is asked as Bash asks it, and prints nothing of its own."""
    line, answer = "sins-env run sway-white-v0 gsf", tmp_path / "answer"
    asked = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\n", "COMP_LINE": line, "COMP_POINT": str(len(line))}
    command = [sys.executable, "-m", "sins_env"]
    environment = {**os.environ, **asked, "_ARGCOMPLETE_STDOUT_FILENAME": str(answer)}
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert answer.read_text().split("\n") == ["gsf_ekf", "gsf_imm"]
