"""The code version: an edit of what decides scores makes stored rows stale, any other leaves them valid."""

import shutil

import pytest

import sins_env
from sins_env.evaluation.estimators import offers, version

GOOD = "evaluation.plugins:DeadReckoning"

#: Folders of ``sins_env`` whose files decide what a row holds, and some whose files do not.
DECIDE = (
    "",
    "sensors",
    "worlds",
    "recordings/formats",
    "envs",
    "evaluation/tasks",
    "evaluation/play",
    "evaluation/estimators",
    "evaluation/bound",
)
DO_NOT = (
    "evaluation",
    "evaluation/tasks/suite",
    "evaluation/score",
    "evaluation/show",
    "evaluation/store",
    "evaluation/report",
    "evaluation/reproduction/documents",
    "cli",
    "cli/describe",
)


@pytest.fixture
def world(tmp_path, monkeypatch):
    """A copy of the package ``sins_env``."""
    copy = tmp_path / "sins_env"
    shutil.copytree(version.WORLD, copy, ignore=shutil.ignore_patterns("__pycache__"))
    monkeypatch.setattr(version, "WORLD", copy)
    return copy


def test_what_makes_rows_stale(world):
    """A new Python file, an edit of one, and its end; a file of another kind never."""
    before = version.code_version("ckf")
    assert version.code_version("ekf") == before
    for folder in (*DECIDE, *DO_NOT):
        assert list((world / folder).glob("*.py")), folder
        (world / folder / "page.css").write_text("")
        assert version.code_version("ckf") == before, folder
        file = world / folder / "one_more.py"
        found = {before}
        for text in ("x = 1", "x = 2"):
            file.write_text(text)
            found.add(version.code_version("ckf"))
        assert len(found) == (3 if folder in DECIDE else 1), folder
        file.unlink()
        assert version.code_version("ckf") == before


def test_a_release_leaves_rows_valid(world):
    before = version.code_version("ckf")
    names = world / "__init__.py"
    names.write_text(names.read_text().replace(sins_env.__version__, "9.9"))
    assert version.code_version("ckf") == before


def test_the_folders_exist():
    """A rename would leave rows valid that are not, without a word."""
    for part in (*version.APART, version.DEFINITIONS, *(f"evaluation/{name}" for name in version.SCORING)):
        assert (version.WORLD / part).is_file() or list((version.WORLD / part).glob("*.py")), part


@pytest.fixture
def edited(tmp_path, monkeypatch):
    """Write, or write anew, a file of a package on the path."""
    monkeypatch.syspath_prepend(tmp_path)

    def write(text, file="somebodys/zoo.py"):
        (tmp_path / file).parent.mkdir(exist_ok=True)
        (tmp_path / file).write_text(text)

    write("", "somebodys/__init__.py")
    return write


def test_an_edit_of_a_solver_makes_rows_stale(edited, monkeypatch):
    """Own rows depend on own solvers alone; what is somebody else's may be built on any package that is installed."""
    edited("raise RuntimeError('never imported')")
    edited("x = 1", "mine.py")
    own = offers.points()[0]
    point = offers.EntryPoint
    others = [point("theirs", "somebodys.zoo:X", offers.GROUP), point("gone", "nowhere:X", offers.GROUP)]
    monkeypatch.setattr(offers, "points", lambda: (own, others))
    solvers = ("ckf", "theirs", GOOD, "mine:X")
    before = {name: version.code_version(name) for name in solvers}
    edited("raise RuntimeError('never imported!')")
    after = {name: version.code_version(name) for name in solvers}
    assert [name for name in solvers if before[name] == after[name]] == ["ckf"]
    edited("x = 2", "mine.py")
    assert [name for name in solvers if version.code_version(name) != after[name]] == ["mine:X"]


def test_an_edit_of_an_own_solver_makes_rows_stale(edited, monkeypatch):
    edited("x = 1")
    before = version.code_version("ckf"), version.code_version(GOOD)
    own = [*offers.points()[0], offers.EntryPoint("more", "somebodys", offers.GROUP)]
    monkeypatch.setattr(offers, "points", lambda: (own, []))
    whole = version.code_version("ckf"), version.code_version(GOOD)
    edited("x = 2")
    assert len({*before, *whole, version.code_version("ckf"), version.code_version(GOOD)}) == 6


def test_a_solver_that_is_not_there():
    for name, message in (
        ("ckff", "unknown solver 'ckff'; did you mean 'ckf'"),
        ("nobodys:X", "solver 'nobodys:X': No module named 'nobodys'; allowed: module:Factory"),
    ):
        with pytest.raises(ValueError, match=message):
            version.code_version(name)


def test_a_class_of_the_script_that_runs(monkeypatch, tmp_path):
    """Its file counts, though a script has no name by which it could be imported."""
    import __main__

    class Mine:
        __module__ = "__main__"

    script = tmp_path / "script.py"
    script.write_text("x = 1")
    monkeypatch.setattr(__main__, "__file__", str(script), raising=False)
    monkeypatch.setattr(__main__, "__spec__", None)
    before = version.code_version(Mine)
    script.write_text("x = 2")
    assert version.code_version(Mine) != before
