"""What tests of several folders share: the recordings beside the project, small ones, a short task, the command line."""

import os
from pathlib import Path

import pytest
from evaluation.short import SHORT
from oracles import recorded as files
from places import ROOT

from sins_env.cli.main import main
from sins_env.evaluation.tasks import catalogue
from sins_env.kernels.compiling import FOLDER, cache_folder

os.environ.setdefault("SINS_ENV_DATA", str(ROOT.parent / "shared" / "data"))


@pytest.fixture(scope="session", autouse=True)
def _own_cache(tmp_path_factory):
    """Bounds are kept apart from the user's, compiled kernels are not; subprocesses find both."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(FOLDER, str(cache_folder()))
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def recorded(request):
    """The name of a recording: ``@pytest.mark.parametrize("recorded", [...], indirect=True)``.

    Recordings stay beside the project; tests that need them are skipped where they are absent.
    """
    folder = Path(os.environ["SINS_ENV_DATA"])
    if not (folder / request.param).is_file():
        pytest.skip(f"{request.param} is not in $SINS_ENV_DATA = {folder}")
    return request.param


@pytest.fixture
def parked(tmp_path):
    """10 s at 100 Hz without GNSS; the reference begins at 0.1 s."""
    return files.counts(tmp_path / "parked.npz")


@pytest.fixture
def driven(tmp_path):
    """12 s at 200 Hz with fixes at 0.95 s + n."""
    return files.increments(tmp_path / "driven.npz")


@pytest.fixture
def short(monkeypatch):
    """The short task, registered under its name for the time of a test."""
    monkeypatch.setitem(catalogue.TASKS, SHORT.name, SHORT)
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
