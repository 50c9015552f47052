"""What an import brings along, and that Gymnasium knows the environments in whichever order the two are imported."""

import ast
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import gymnasium
import pytest

from sins_env.envs import ENV_IDS, environments

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "sins_env").rglob("*.py")) + sorted((ROOT / "solvers").rglob("*.py"))
UNIX = ("fcntl",)  # not on every system
SLOW = ("IPython", "filterpy", "matplotlib", "numba", "scipy", "yaml")
HEAVY = ("gymnasium", "matplotlib", "rich", "filterpy", "yaml", "scipy.special", "scipy.stats", "numba", "llvmlite")
MAKE = "assert gymnasium.make('SINS/AlignSway-v0', start='told', duration=1.0).reset(seed=1)"


def fresh(code, *options, arguments=(), **environment):
    """Standard output of a new interpreter, in which warnings are errors."""
    line = [sys.executable, "-W", "error", *options, "-c", code, *arguments]
    done = subprocess.run(line, cwd="/", env={**os.environ, **environment}, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
    return done.stdout


@pytest.mark.parametrize("module", ["sins_env", "solvers", "sins_env.recordings", "sins_env.cli.grammar"])
def test_heavy_packages_stay_out(module):
    loaded = fresh(f"import sys, {module}; print(*sys.modules)").split()
    assert [name for name in HEAVY if name in loaded] == []


def test_the_zoo_is_imported_when_it_is_asked_for():
    """By a name of the package, by a submodule of its own, and by ``import *``; what is not there is an error."""
    assert (
        "solvers.making" not in fresh("import sys, solvers.types, solvers.blocks.moments; print(*sys.modules)").split()
    )
    for use in ("import solvers; solvers.names()", "import solvers; solvers.filters.FILTERS['ckf']"):
        loaded = fresh(f"{use}; import sys; print(*sys.modules)").split()
        assert "solvers.filters.sigma.ckf" in loaded
        assert {"numba", "llvmlite"}.isdisjoint(loaded)
    assert fresh("from solvers import *; print('ckf' in names(), make('ckf').batched)") == "True True\n"
    assert fresh("import solvers; print(hasattr(solvers, 'nothing'))") == "False\n"


def test_help_starts_without_the_evaluation():
    code = "import sys; from sins_env.cli.main import main; main(['--help']); print(*sys.modules)"
    assert {"gymnasium", "sins_env.evaluation", "scipy.special"}.isdisjoint(fresh(code).split())


def test_nothing_needs_scipy_stats_to_be_imported():
    verbs = "sins_env.cli.describe.listing, sins_env.cli.verbs.run, sins_env.cli.verbs.reproduce"
    code = f"import sys, sins_env.evaluation.store.database, {verbs}; print(*sys.modules)"
    assert {"scipy.stats", "matplotlib", "filterpy"}.isdisjoint(fresh(code).split())


def test_the_evaluation_needs_no_scipy_to_be_imported():
    """It is imported anew in each worker, and in each process of a solver."""
    loaded = fresh("import sys, sins_env.evaluation.play.pool; print(*sys.modules)").split()
    assert [
        name
        for name in loaded
        if name.split(".")[0] in ("scipy", "matplotlib", "rich", "yaml", "filterpy", "numba", "llvmlite")
    ] == []


ORDERS = {
    "Gymnasium last": f"import sins_env, gymnasium; {MAKE}",
    "Gymnasium first": f"import gymnasium, sins_env; {MAKE}",
    "by the solvers": f"import solvers, gymnasium; {MAKE}",
    "by a part of it": f"import sins_env, gymnasium.vector, gymnasium; {MAKE}",
    "after a look for it": f"import sins_env, importlib.util; importlib.util.find_spec('gymnasium'); import gymnasium; {MAKE}",
    "an environment first": f"from sins_env.envs.base import EpisodeEnv; import gymnasium; {MAKE}",
    "by Gymnasium": "import gymnasium; gymnasium.make('sins_env:SINS/AlignSway-v0', start='told', duration=1.0)",
}


@pytest.mark.parametrize("order", ORDERS.values(), ids=ORDERS)
def test_every_order_from_a_checkout_that_is_not_installed(order):
    """Without ``site`` no package is installed: the checkout and its dependencies are folders on the path."""
    packages = sysconfig.get_paths()["purelib"]
    fresh(order, "-S", PYTHONPATH=f"{ROOT}{os.pathsep}{packages}")


@pytest.mark.parametrize("order", ["Gymnasium last", "Gymnasium first"])
def test_both_orders_of_what_is_installed(order):
    fresh(ORDERS[order])


def test_a_class_is_all_that_an_environment_needs():
    """Every class with an id is registered, under its own path, alone and as a vector."""
    classes = [cls for cls in vars(environments).values() if isinstance(cls, type) and "env_id" in vars(cls)]
    assert len(classes) == 6
    for cls in classes:
        spec = gymnasium.spec(cls.env_id)
        assert spec.entry_point == f"sins_env.envs.environments:{cls.__name__}"
        assert spec.vector_entry_point == f"sins_env.envs.environments:{cls.__name__.removesuffix('Env')}VectorEnv"
        assert gymnasium.envs.registration.EnvSpec.from_json(spec.to_json()).id == cls.env_id
    assert {cls.env_id for cls in classes} == set(ENV_IDS)


def test_imports_inside_functions_have_their_reason():
    """Slow packages and those of Unix alone, each with a comment; of the project none but in the command line."""
    for path in SOURCES:
        text = path.read_text()
        functions = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.FunctionDef)]
        inside = [n for f in functions for n in ast.walk(f) if isinstance(n, ast.Import | ast.ImportFrom)]
        said = {n.lineno for n in inside if "#" in text.splitlines()[n.lineno - 1]}
        for node in inside:
            package = (node.module if isinstance(node, ast.ImportFrom) else node.names[0].name).partition(".")[0]
            where = f"{path.relative_to(ROOT)}, line {node.lineno}"
            assert package in SLOW + UNIX or path.parent == ROOT / "sins_env" / "cli", where
            assert {node.lineno, node.lineno - 1} & said, f"{where}: no reason"


HIDING = """
import sys
from importlib import import_module as load
sys.path.insert(0, sys.argv[1])
if sys.argv[2] == "before":
    import solvers
import sins_env, solvers
from sins_env.evaluation.estimators import offers
for use in (lambda: solvers.make("ckf"), lambda: load("solvers.zoo"), lambda: exec("from solvers import register"), offers.own):
    try:
        use()
    except (AttributeError, ImportError, ValueError) as error:
        print(type(error).__name__, error)
print(load("solvers.mine").Mine, hasattr(solvers, "make"))
"""


@pytest.mark.parametrize("order", ["before", "after"])
def test_a_package_that_hides_solvers_is_told(order, tmp_path):
    """A folder ``solvers`` of the user's own: every use of ours says where it is, and its own modules work."""
    (tmp_path / "solvers").mkdir()
    (tmp_path / "solvers/__init__.py").touch()
    (tmp_path / "solvers/mine.py").write_text("Mine = 1")
    *told, last = fresh(HIDING, arguments=(str(tmp_path), order)).splitlines()
    place = f"it is {tmp_path}/solvers/__init__.py, which hides the package 'solvers' of sins-env. Give that"
    assert [line.partition(" ")[0] for line in told] == ["AttributeError", "ImportError", "ImportError", "ValueError"]
    for line, name in zip(told, ("make", "zoo", "register", "zoo"), strict=True):
        assert f"'{name}': {place}" in line
    assert last == "1 False"


def test_a_folder_without_a_package_hides_nothing(tmp_path):
    (tmp_path / "solvers").mkdir()
    code = "import sys; sys.path.insert(0, sys.argv[1]); import sins_env, solvers; print('ckf' in solvers.names())"
    assert fresh(code, arguments=(str(tmp_path),)) == "True\n"
