"""Imports go downward only: the world knows nothing of the solvers, the score nothing of their inside."""

import ast
import graphlib
from collections import Counter

import pytest
from places import ROOT

SOURCES = sorted((ROOT / "sins_env").rglob("*.py")) + sorted((ROOT / "solvers").rglob("*.py"))

#: Layers from the bottom up; a module imports from its own layer or from those below.
LAYERS = (
    ("sins_env.arrays", "sins_env.moved", "sins_env.units", "sins_env.__version__", "sins_env._COMMAND"),
    ("sins_env.kernels",),
    ("sins_env.checks", "sins_env.presets", "sins_env.reading", "sins_env.writing"),
    ("sins_env.earth", "sins_env.attitude", "sins_env.specs", "sins_env.states"),
    ("sins_env.prior",),
    ("sins_env.types",),
    ("sins_env.motion",),
    ("sins_env.trajectory", "sins_env.sensors", "sins_env.recordings"),
    ("sins_env.worlds",),
    ("sins_env.scenarios",),
    ("sins_env.envs",),
    ("sins_env.evaluation.tasks",),
    ("sins_env.evaluation.estimators",),
    ("sins_env.evaluation.play",),
    ("sins_env.evaluation.bound",),
    ("sins_env.evaluation.tasks.catalogue",),  # thresholds follow from bounds
    ("sins_env.evaluation.play.one_run", "sins_env.evaluation.speed"),
    ("sins_env.evaluation.score",),
    ("sins_env.evaluation.show", "sins_env.evaluation.contract", "sins_env.evaluation.monte_carlo"),
    ("sins_env.evaluation.store", "sins_env.evaluation.replay", "sins_env.evaluation.planning"),
    (
        "sins_env.evaluation.report",
        "sins_env.evaluation.reproduction",
        "sins_env.evaluation.contest",
        "sins_env.evaluation.solution",
    ),
    ("sins_env.evaluation",),
    ("sins_env.learning", "sins_env.wrappers"),
    ("sins_env.cli", "sins_env.tasks"),
    ("sins_env",),
    ("solvers.types",),
    ("solvers.registry",),
    ("solvers.blocks",),
    ("solvers.filters", "solvers.smoothing"),
    ("solvers.pipeline",),
    ("solvers",),
)
#: What the mathematics may use of the world.
SHARED = (
    "sins_env.arrays",
    "sins_env.attitude",
    "sins_env.checks",
    "sins_env.earth",
    "sins_env.kernels",
    "sins_env.moved",
    "sins_env.prior",
    "sins_env.specs",
    "sins_env.states",
    "sins_env.types",
    "sins_env.units",
)


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(path):
    """Absolute names of every import of the project's own modules, those inside functions too."""
    tree = ast.parse(path.read_text())
    package = module_name(path) if path.name == "__init__.py" else module_name(path).rpartition(".")[0]
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            up = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*up, *([node.module] if node.module else [])])
            names = [f"{base}.{alias.name}" for alias in node.names]
        else:
            continue
        yield from (name for name in names if name.split(".")[0] in ("sins_env", "solvers"))


def within(name, prefix):
    return name == prefix or name.startswith(prefix + ".")


def layer(name):
    """The layer of a module: that of the longest name that fits."""
    return max((len(p), i) for i, prefixes in enumerate(LAYERS) for p in prefixes if within(name, p))[1]


def violations(name, imported):
    """What is wrong with module ``name`` importing ``imported``; empty if nothing is."""
    if within(name, "sins_env"):
        if within(imported, "solvers"):
            return "the world imports the mathematics"
        return "upward" if layer(imported) > layer(name) else ""
    if within(imported, "sins_env"):
        return "" if any(within(imported, s) for s in SHARED) else "not shared with the mathematics"
    return "upward" if layer(imported) > layer(name) else ""


def test_imports_go_downward():
    arrows = [(module_name(path), imported) for path in SOURCES for imported in imports(path)]
    breaches = [(name, imported, why) for name, imported in arrows if (why := violations(name, imported))]
    assert breaches == []


def test_no_circles():
    """Imports inside functions and under TYPE_CHECKING count; ``__init__`` files, which only re-export, do not."""
    modules = {module_name(path) for path in SOURCES if path.name != "__init__.py"}
    graph = {
        module_name(path): {found for name in imports(path) if (found := known_module(name, modules))}
        for path in SOURCES
        if path.name != "__init__.py"
    }
    graphlib.TopologicalSorter(graph).prepare()


def test_a_circle_is_seen():
    with pytest.raises(graphlib.CycleError):
        graphlib.TopologicalSorter({"a": {"b"}, "b": {"a"}}).prepare()


def known_module(name, modules):
    """The module that an imported name is, or is of; None for a package."""
    return name if name in modules else parent if (parent := name.rpartition(".")[0]) in modules else None


def test_folders_are_small():
    """At most 14 files, so that a folder is read at one glance."""
    files = Counter(path.parent for path in SOURCES if path.name != "__init__.py")
    assert {str(folder.relative_to(ROOT)): n for folder, n in files.items() if n > 14} == {}


@pytest.mark.parametrize(
    ("name", "imported"),
    [
        ("sins_env.sensors.imu", "solvers.filters.sigma.ckf"),
        ("sins_env.earth", "sins_env.sensors.imu"),
        ("sins_env.sensors.imu", "sins_env.worlds.world"),
        ("sins_env.envs.environments", "sins_env.evaluation.score.metrics"),
        ("solvers.blocks.moments", "solvers.filters.sigma.ckf"),
        ("solvers.filters.sigma.ckf", "solvers.pipeline.estimator"),
        ("solvers.pipeline.estimator", "sins_env.worlds.world"),
        ("solvers.pipeline.strapdown", "sins_env.sensors.imu"),
    ],
)
def test_the_rule_sees_a_breach(name, imported):
    assert violations(name, imported)


def test_relative_and_local_imports_are_seen(tmp_path, monkeypatch):
    monkeypatch.setattr(f"{__name__}.ROOT", tmp_path)
    package = tmp_path / "sins_env" / "envs"
    package.mkdir(parents=True)
    file = package / "x.py"
    file.write_text("from ..sensors.imu import Imu\nfrom . import world\ndef f():\n    import solvers.zoo\n")
    assert set(imports(file)) == {"sins_env.sensors.imu.Imu", "sins_env.envs.world", "solvers.zoo"}
