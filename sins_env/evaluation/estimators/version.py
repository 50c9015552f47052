"""The version of the code behind a result: other code, other rows. docs/tasks_and_scores.md#stale-rows."""

from __future__ import annotations

import hashlib
import importlib.metadata
import importlib.util
import sys
from collections.abc import Iterator
from pathlib import Path

from sins_env.evaluation.estimators import finding, offers
from sins_env.version import VERSION

WORLD = Path(__file__).parents[2]  #: the package ``sins_env``
#: Parts of the package that decide no score: they show, store or ask for it. All others make the world.
APART = ("cli", "evaluation")
#: Folders of the evaluation that decide what a row holds: how runs are seeded and begun, what an estimator's answers count as,
#: how runs are played and scored, and the bound. The others work on rows that are there.
SCORING = ("tasks", "estimators", "play", "bound")
#: The tasks themselves: each is compared on its own, by definition and digest, so that a new one leaves the others' rows valid.
DEFINITIONS = "evaluation/tasks/suite"


def code_version(solver: finding.Solver) -> str:
    """Version, and 8 hex digits over the sources of world, scoring and solvers: other code, other rows.

    A solver of another package may be built on any that is installed, so all of them count for it.

    Raises:
        ValueError: no such solver.
    """
    files = set(_scoring())
    for package in _packages(solver):
        files.update(_sources(package))
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.name.encode() + path.read_bytes())
    return f"{VERSION}+{digest.hexdigest()[:8]}"


def _scoring() -> Iterator[Path]:
    """The files of world and scoring."""
    parts = [part for part in WORLD.iterdir() if part.name not in APART]
    parts += [WORLD / "evaluation" / folder for folder in SCORING]
    for part in parts:
        files = part.rglob("*.py") if part.is_dir() else [part] if part.suffix == ".py" else []
        yield from (file for file in files if WORLD / DEFINITIONS not in file.parents)


def _packages(solver: finding.Solver) -> set[str]:
    """The top-level packages and modules that a solver may be built on."""
    own, others = offers.points()
    packages = {offers.package_of(point) for point in own}
    if not finding.is_own(solver):
        packages |= {offers.package_of(point) for point in others} | {finding.module_of(solver).partition(".")[0]}
    return packages


def _sources(package: str) -> list[Path]:
    """The Python files of a top-level package or module, which is not imported; none if it is not there."""
    try:
        spec = importlib.util.find_spec(package)
    except (ImportError, ValueError):  # a misspelt name; the script that runs has none, but a file
        file = getattr(sys.modules.get(package), "__file__", None)
        return [Path(file)] if file else []
    if spec is None:
        return []
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()]
    single = [Path(spec.origin)] if spec.origin and not folders and Path(spec.origin).is_file() else []
    return single + [path for folder in folders for path in folder.rglob("*.py")]
