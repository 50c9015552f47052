"""What other packages offer: one entry point, many names; a package that goes wrong costs its own names and nothing else."""

import sys
from textwrap import dedent

import pytest

import solvers
from sins_env.evaluation import evaluate
from sins_env.evaluation.estimators import child, finding, offers
from sins_env.evaluation.estimators.isolation import Limits, limits
from solvers.registry import ESTIMATORS, FILTERS

REGISTERS = """
    from dataclasses import dataclass
    from solvers import register
    from solvers.filters.sigma.ckf import CKF

    @register("soft")
    @dataclass(frozen=True)
    class Soft(CKF):
        '''A cubature filter of somebody else.'''

        softness: float = 0.5

    @register("steady")
    class Steady:
        '''The told attitude for ever.'''

        batched = True

        def reset(self, task, rng, num_runs=1):
            self.q = task.start.q_nb

        def step(self, obs):
            return self.q
"""
NAMES = """
    from evaluation.plugins import DeadReckoning, Told

    def names():
        return ["one", "two"]

    one, two = DeadReckoning, Told
"""
MAPS = """
    from evaluation.plugins import DeadReckoning, Told

    SOLVERS = {"first": DeadReckoning, "second": Told, "ckf": Told, "third": 3}
"""


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Install a module with entry points, as pip does; each call is a package of its own. All is forgotten afterwards."""
    monkeypatch.syspath_prepend(tmp_path)
    assert solvers.names()  # the zoo is imported when it is first asked for
    finding.names()  # own solvers are registered when they are first asked for
    known = dict(FILTERS), dict(ESTIMATORS)

    def install(module, source, **points):
        (tmp_path / f"{module}.py").write_text(dedent(source))
        folder = tmp_path / f"{module}-1.2.dist-info"
        folder.mkdir(exist_ok=True)
        (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {module.replace('_', '-')}\nVersion: 1.2\n")
        lines = [f"{name} = {value}" for name, value in points.items()]
        (folder / "entry_points.txt").write_text("\n".join([f"[{offers.GROUP}]", *lines]))

    offers.asked.cache_clear()
    yield install
    for registry, before in zip((FILTERS, ESTIMATORS), known, strict=True):
        for name in registry.keys() - before.keys():
            del registry[name]
    for name in ("my_filters", "with_names", "with_map", "again", "plainly"):
        sys.modules.pop(name, None)
    offers.asked.cache_clear()


def others():
    """The names that other packages offer, with what is shown of them."""
    return {one.name: one.about.text or one.error for one in finding.listing() if one.package}


def test_one_entry_point_many_registered_names(installed):
    installed("my_filters", REGISTERS, my_filters="my_filters")
    assert others() == {"soft": "A cubature filter of somebody else.", "steady": "The told attitude for ever."}
    assert {"soft", "steady"} < set(finding.names())
    assert finding.describe("soft").settings["softness"] == "0.5"
    assert not finding.is_own("soft")
    assert "my_filters" not in sys.modules
    assert type(finding.make("soft", {"softness": 0.25})).__name__ == "Pipeline"
    assert finding.make("steady").batched
    assert (limits("soft"), limits("ckf"), limits("sofd")) == (Limits(), None, None)
    assert not finding.is_own("soft")  # though it is registered in this process now
    assert finding.find("my_filters:steady")().batched
    with pytest.raises(ValueError, match="unknown factory in my_filters 'sofd'; did you mean 'soft'"):
        finding.find("my_filters:sofd")


def test_a_registered_name_runs_in_worker_processes(installed, short):
    installed("my_filters", REGISTERS, my_filters="my_filters")
    assert evaluate(short, "steady", 2, cost=False, workers=2).summary.runs == 2


def test_modules_and_mappings_offer_names(installed):
    installed("with_names", NAMES, anything="with_names")
    installed("with_map", MAPS, whatever="with_map:SOLVERS")
    found = others()
    assert found["one"] == found["first"] == "The told attitude, carried on by the gyros."
    assert set(found) == {"one", "two", "first", "second", "third"}
    assert "solver 'third' is an int; allowed: a class or function" in found["third"]
    assert finding.shadowed() == ["ckf of with-map (with_map:SOLVERS)"]
    assert finding.find("two").__name__ == "Told"
    with pytest.raises(ValueError, match="unknown solver 'whatever'"):
        finding.find("whatever")


def test_an_entry_point_of_the_name_comes_first_and_two_lists_of_it_are_no_choice(installed):
    installed("with_names", NAMES, anything="with_names")
    installed("again", NAMES, again="again")
    with pytest.raises(ValueError, match=r"'one' is offered by \S+ \(\w+\) and \S+ \(\w+\); allowed: one of them"):
        finding.find("one")
    installed("plainly", "from evaluation.plugins import Lost", one="plainly:Lost")
    assert finding.find("one").__name__ == "Lost"
    assert {one.name: one.package for one in finding.listing()}["one"] == "plainly 1.2"


#: What a package does as it is imported, and what is told of it.
WRONG = {
    "import nothing_of_that_name": "No module named 'nothing_of_that_name'",
    "import os; os._exit(7)": "importing it ended the process (exit code 7)",
    "raise SystemExit(3)": "SystemExit: 3",
    "from solvers import register; register('ckf')(dict)": "'ckf' is already registered, as CKF of solvers.",
    "x = 1": "it is a module that offers no solver; allowed: a class or function",
    "print('hello' * 99999, flush=True); 1 / 0": "ZeroDivisionError",
}


def test_packages_that_go_wrong_are_a_line_each_and_cost_nothing_else(installed, cli, monkeypatch):
    monkeypatch.setenv("COLUMNS", "250")
    for i, source in enumerate(WRONG):
        installed(f"wrong{i}", source, **{f"bad{i}": f"wrong{i}"})
    installed("with_names", NAMES, anything="with_names")
    code, out, _ = cli("list", "solvers")
    assert code == 0
    for i, told in enumerate(WRONG.values()):
        (row,) = [line for line in out.splitlines() if line.startswith(f" bad{i} ")]
        assert told in row
        assert row.rstrip().endswith(f"[wrong{i} 1.2]")
    assert [line.split()[0] for line in out.splitlines() if "[with-names 1.2]" in line] == ["one", "two"]
    assert not any(name.startswith("wrong") for name in sys.modules)


def test_a_package_that_hangs(installed, monkeypatch):
    monkeypatch.setattr(offers, "LIMIT_S", 2.0)
    installed("hangs", "import time; time.sleep(3600)", never="hangs")
    assert "importing it took longer than 2 s" in others()["never"]


def test_what_was_listed_before_a_package_ended_its_process_stays(installed, tmp_path):
    (tmp_path / "leaves.py").write_text("import os; os._exit(7)")
    installed("half", "from evaluation.plugins import Told", good="half:Told", left="leaves:X", never="half:Told")
    found = others()
    assert found["good"] == "The told attitude for ever: the cheapest estimator there is."
    assert found["left"] == "solver 'left' (leaves:X) cannot be loaded: importing it ended the process (exit code 7)"
    assert "not looked at: left: importing it ended the process (exit code 7)" in found["never"]


def test_own_solvers_need_no_other_process(installed, monkeypatch):
    installed("my_filters", REGISTERS, my_filters="my_filters")
    monkeypatch.setattr(child.Child, "call", None)
    assert finding.make("ckf").batched
    assert finding.is_own("ckf")
    assert not finding.is_own("soft")
    assert limits("ckf") is None
    installed("my_filters", REGISTERS, plain="evaluation.plugins:Told")
    assert finding.find("plain").__name__ == "Told"  # an entry point of its own name needs none, either


def test_without_other_packages_there_is_no_other_process(monkeypatch):
    own = offers.points()[0]
    monkeypatch.setattr(offers, "points", lambda: (own, []))
    monkeypatch.setattr(child.Child, "call", None)
    assert finding.names() == sorted(offers.own())
    with pytest.raises(ValueError, match="unknown solver 'ckff'; did you mean 'ckf'"):
        finding.find("ckff")
