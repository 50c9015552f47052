"""A short task for the tests: 20 s of sway, told start, hold 5 s."""

import dataclasses

import pytest

from sins_env.cli.main import main
from sins_env.evaluation.tasks import task

_WHITE = task.get_task("sway-white-v0")
SHORT = dataclasses.replace(
    _WHITE, name="short-v0", what="short", kwargs={**_WHITE.kwargs, "duration": 20.0}, hold_s=5.0
)


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    """Bounds are kept apart from the user's; subprocesses find them, too."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def short(monkeypatch):
    """Registered under its name for the time of a test."""
    monkeypatch.setitem(task.TASKS, SHORT.name, SHORT)
    return SHORT


@pytest.fixture
def start_of(short):
    """The told attitude of a run: how a test tells an estimator which run is meant."""

    def find(run):
        env = short.make(1)
        _, info = short.reset(env, [run])
        return info["start"]["q_nb"][0].tolist()

    return find


@pytest.fixture
def cli(capsys):
    """Run a command; its exit code, standard output, and lines on standard error."""

    def call(*arguments):
        code = main([str(a) for a in arguments])
        out, err = capsys.readouterr()
        return code, out, err.splitlines()

    return call
