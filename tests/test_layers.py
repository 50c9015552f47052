"""Imports go downward only: the world knows nothing of the solvers, the score nothing of their inside."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SOURCES = sorted((ROOT / "sins_env").rglob("*.py")) + sorted((ROOT / "solvers").rglob("*.py"))

#: Layers from the bottom up; a module imports from its own layer or from those below.
LAYERS = (
    (
        "sins_env.errors",
        "sins_env.checks",
        "sins_env.earth",
        "sins_env.attitude",
        "sins_env.presets",
        "sins_env.specs",
        "sins_env.types",
    ),
    ("sins_env.trajectory", "sins_env.imu", "sins_env.gps", "sins_env.recordings", "sins_env.allan"),
    ("sins_env.envs", "sins_env.figures"),
    ("sins_env.evaluation",),
    ("solvers.types",),
    ("solvers.blocks",),
    ("solvers.filters", "solvers.smoothing"),
    ("solvers.pipeline",),
    ("solvers",),
)
#: What the mathematics may use of the world.
SHARED = (
    "sins_env.earth",
    "sins_env.attitude",
    "sins_env.types",
    "sins_env.errors",
    "sins_env.checks",
    "sins_env.specs",
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
    """The layer of a module; ``sins_env`` itself only re-exports, and counts as its environments."""
    matches = [(len(p), i) for i, prefixes in enumerate(LAYERS) for p in prefixes if within(name, p)]
    return max(matches)[1] if matches else 2


def violations(name, imported):
    """What is wrong with module ``name`` importing ``imported``; empty if nothing is."""
    if within(name, "sins_env"):
        if within(imported, "solvers"):
            return "the world imports the mathematics"
        return "upward" if layer(imported) > layer(name) else ""
    if within(imported, "sins_env"):
        return "" if any(within(imported, s) for s in SHARED) else "not shared with the mathematics"
    return "upward" if layer(imported) > layer(name) else ""


@pytest.mark.parametrize("path", SOURCES, ids=module_name)
def test_imports_go_downward(path):
    name = module_name(path)
    found = [(imported, violations(name, imported)) for imported in imports(path)]
    assert [f for f in found if f[1]] == []


@pytest.mark.parametrize(
    ("name", "imported"),
    [
        ("sins_env.imu", "solvers.filters.ckf"),
        ("sins_env.earth", "sins_env.imu"),
        ("sins_env.imu", "sins_env.envs.world"),
        ("sins_env.envs.align", "sins_env.evaluation.metrics"),
        ("solvers.blocks.moments", "solvers.filters.ckf"),
        ("solvers.filters.ckf", "solvers.pipeline.aligner"),
        ("solvers.pipeline.aligner", "sins_env.envs.world"),
        ("solvers.pipeline.strapdown", "sins_env.imu"),
    ],
)
def test_the_rule_sees_a_breach(name, imported):
    assert violations(name, imported)


def test_relative_and_local_imports_are_seen(tmp_path, monkeypatch):
    monkeypatch.setattr(f"{__name__}.ROOT", tmp_path)
    package = tmp_path / "sins_env" / "envs"
    package.mkdir(parents=True)
    file = package / "x.py"
    file.write_text("from ..imu import Imu\nfrom . import world\ndef f():\n    import solvers.zoo\n")
    assert set(imports(file)) == {"sins_env.imu.Imu", "sins_env.envs.world", "solvers.zoo"}
