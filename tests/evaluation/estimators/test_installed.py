"""A package outside the repository: installed, it is listed, checked, evaluated and on the board like any other."""

import json
import os
import shutil
import subprocess
import sys
from importlib.metadata import EntryPoint
from types import SimpleNamespace

import pytest
from evaluation import plugins
from places import ROOT

from sins_env.cli.main import main
from sins_env.evaluation.estimators import finding, offers, version

PACKAGE = ROOT / "examples" / "plugin_package"


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """A folder of installed packages of its own, beside which the developer's environment stays as it is."""
    outside = tmp_path_factory.mktemp("outside")
    shutil.copytree(PACKAGE, outside / "package", ignore=shutil.ignore_patterns("build", "*.egg-info", "__pycache__"))
    install = (sys.executable, "-m", "pip", "install", "--quiet", "--no-build-isolation", "--no-deps", "--no-index")
    done = subprocess.run(
        [*install, "--disable-pip-version-check", "--target", str(outside / "site"), str(outside / "package")],
        capture_output=True, text=True, timeout=300, cwd=outside,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return outside / "site"


def test_a_fresh_process_lists_it(site, tmp_path):
    """In a folder that is not the repository."""
    environment = {**os.environ, "PYTHONPATH": f"{site}{os.pathsep}{ROOT}", "COLUMNS": "160"}
    go = "import sys; from sins_env.cli.main import main; sys.exit(main())"
    line = [sys.executable, "-c", go, "list", "solvers"]
    done = subprocess.run(line, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    (row,) = [line for line in done.stdout.splitlines() if "gyro_reckoning" in line]
    assert "Turns the told attitude by every gyro increment" in row
    assert "[gyro-reckoning 0.1.0]" in row


def test_it_is_checked_evaluated_and_on_the_board(site, short, cli, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(site)
    offers.asked.cache_clear()
    monkeypatch.setenv("COLUMNS", "160")
    code, out, _ = cli("check", "gyro_reckoning")
    assert (code, "gyro_reckoning meets the contract" in out) == (0, True)
    given = ("--solver", "gyro_reckoning", "coarse_inertial", "--runs", 2, "--workers", 1)
    code, out, _ = cli("eval", "--task", "short-v0", *given)
    assert (code, "gyro_reckoning" in out) == (0, True)
    board = {entry["solver"]: entry for entry in json.loads(cli("board", "--json")[1])}
    assert board["gyro_reckoning"]["runs"] == board["coarse_inertial"]["runs"] == 2
    assert board["gyro_reckoning"]["failures"] == 0
    assert 1 < board["gyro_reckoning"]["rms"]["U"] / 3600 < 45  # deg: the error of the start, 15 deg (1 sigma)


def test_the_example_equals_the_tests_own_dead_reckoning():
    """Two codes written apart; the one sums the increments of an epoch. Without the earth they differ by 1.5e-3 rad."""
    from evaluation.short import SHORT

    from sins_env.evaluation import evaluate

    sys.path.insert(0, str(PACKAGE))
    try:
        one = evaluate(SHORT, "gyro_reckoning:GyroReckoning", 3, workers=1, cost=False).records
    finally:
        sys.path.remove(str(PACKAGE))
    assert "gyro_reckoning" not in sys.modules
    other = evaluate(SHORT, plugins.DeadReckoning, 3, workers=1, cost=False).records
    assert abs(one.final - other.final).max() < 5e-4


class Points:
    """Entry points as if packages had been installed: (distribution, name, value)."""

    def __init__(self, *rows):
        self.points = [self._point(*row) for row in rows]

    def __call__(self, group):
        return self.points

    @staticmethod
    def _point(package, name, value):
        point = EntryPoint(name, value, offers.GROUP)
        return point._for(SimpleNamespace(name=package, version="1.2"))


@pytest.fixture
def offered(monkeypatch):
    def offer(*rows):
        monkeypatch.setattr("importlib.metadata.entry_points", Points(*rows))

    return offer


@pytest.mark.parametrize("reverse", [False, True])
def test_nobody_takes_a_name_of_the_projects_own(offered, capsys, monkeypatch, reverse):
    monkeypatch.setenv("COLUMNS", "200")
    rows = [
        ("Sins_Env", "ckf", "evaluation.plugins:DeadReckoning"),
        ("cuckoo", "ckf", "evaluation.plugins:Lost"),
        ("cuckoo", "egg", "evaluation.plugins:Lost"),
    ]
    offered(*(rows[::-1] if reverse else rows))
    assert finding.find("ckf") is plugins.DeadReckoning
    assert finding.find("egg") is plugins.Lost
    assert (finding.is_own("ckf"), finding.is_own("egg"), finding.is_own(plugins.Lost)) == (True, False, False)
    assert finding.is_own("evaluation.plugins:DeadReckoning") is False
    assert {one.name: one.package for one in finding.listing()} == {"ckf": "", "egg": "cuckoo 1.2"}
    assert main(["list", "solvers"]) == 0
    assert "taken: ckf of cuckoo (evaluation.plugins:Lost); use module:Factory" in " ".join(
        capsys.readouterr().out.split()
    )


def test_one_name_of_two_packages(offered):
    offered(("a", "mine", "evaluation.plugins:DeadReckoning"), ("b", "mine", "evaluation.plugins:Lost"))
    both = r"is offered by a \(evaluation.plugins:DeadReckoning\) and b \(evaluation.plugins:Lost\); allowed: one of"
    with pytest.raises(ValueError, match=both):
        finding.find("mine")
    offered(
        ("a", "mine", "evaluation.plugins:Lost"), ("a", "mine", "evaluation.plugins:Lost")
    )  # found twice on the path
    assert finding.find("mine") is plugins.Lost


def test_a_broken_entry_point_breaks_nothing_else(offered, capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "leaves.py").write_text("raise SystemExit(3)\n")
    (tmp_path / "lacks.py").write_text("import no_such_package\n")
    (tmp_path / "divides.py").write_text("1 / 0\n")
    offered(
        ("good", "good", "evaluation.plugins:DeadReckoning"),
        ("bad", "leaves", "leaves:X"),
        ("bad", "lacks", "lacks:X"),
        ("bad", "divides", "divides:X"),
        ("bad", "absent", "evaluation.plugins:Absent"),
        ("bad", "misspelt", "no module at all!"),
        ("bad", "number", "evaluation.plugins:EARTH_RATE"),
        ("bad", "nothing", "evaluation.plugins:Nothing"),
        ("bad", "fails", "evaluation.plugins:broken_factory"),
    )
    assert main(["list", "solvers"]) == 0
    out = capsys.readouterr().out
    assert "The told attitude, carried on by the gyros." in out
    for part in ("SystemExit: 3", "No module named 'no_such_package'", "ZeroDivisionError", "no attribute 'Absent'"):
        assert part in out
    assert version.code_version("good")
    for name in ("leaves", "lacks", "divides", "absent", "misspelt", "number", "nothing", "fails"):
        assert main(["run", "sway-white-v0", name]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert repr(name) in line
