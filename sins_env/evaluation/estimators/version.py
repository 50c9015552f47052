"""The version of the code behind a result: other code, other rows."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import sys
from pathlib import Path

from sins_env.evaluation.estimators.finding import GROUP, Solver, find, offers, package_of
from sins_env.version import VERSION


def _module_name(solver: Solver) -> str:
    if not isinstance(solver, str):
        return str(getattr(solver, "__module__", ""))
    if ":" in solver:
        return solver.partition(":")[0]
    return next((point.value.partition(":")[0].strip() for point in offers().get(solver, [])), "")


#: Folders of the evaluation that decide scores; an edit of the others does not make stored rows stale.
APART = ("cli", "evaluation")  #: parts of the package that decide no scores, but for SCORING
SCORING = ("tasks", "estimators", "play", "bound")


def _files(part: Path) -> list[Path]:
    return list(part.rglob("*.py")) if part.is_dir() else [part] if part.suffix == ".py" else []


def _sources(package: str) -> list[Path]:
    """The Python files of a top-level package or module, which is not imported; none if it is not there."""
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):
        return []
    if spec is None:
        return []
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()]
    single = [Path(spec.origin)] if spec.origin and not folders and Path(spec.origin).is_file() else []
    return single + [path for folder in folders for path in folder.rglob("*.py")]


def code_version(solver: Solver) -> str:
    """Version, and 8 hex digits over the sources of world, scoring and solvers: other code, other rows.

    The packages of all installed solvers count for each of them: a plug-in may well be built on another's.
    """
    world = Path(__file__).parents[2]
    files = [path for part in world.iterdir() if part.name not in APART for path in _files(part)]
    files += [path for folder in SCORING for path in (world / "evaluation" / folder).rglob("*.py")]
    find(solver)
    module = sys.modules.get(_module_name(solver))
    source = getattr(module, "__file__", None)
    if module is not None and source:
        files += _sources(module.__name__.partition(".")[0]) or [Path(source)]
    for package in {package_of(point) for point in importlib.metadata.entry_points(group=GROUP)}:
        files += _sources(package)
    digest = hashlib.sha256()
    for path in sorted(set(files)):
        digest.update(path.name.encode() + path.read_bytes())
    return f"{VERSION}+{digest.hexdigest()[:8]}"
