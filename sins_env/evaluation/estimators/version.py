"""Version of the code behind a result, which is part of the key of stored rows. docs/tasks_and_scores.md#stale-rows."""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Iterable, Iterator
from importlib import metadata
from pathlib import Path

from sins_env.evaluation.estimators import finding, offers

WORLD = Path(__file__).parents[2]  #: folder of the package ``sins_env``
#: Parts of the package that do not decide scores, except the folders SCORING. All other parts make the world.
#: ``__init__.py`` has the public names and the version of the package, which alone makes no row stale.
APART = ("__init__.py", "cli", "evaluation", "learning", "wrappers", "writing")
#: Folders of the evaluation that decide what a row holds: seeds and starts of runs, calls of an estimator, playing and
#: scoring of runs, and the bound. The other folders only use rows.
SCORING = ("tasks", "estimators", "play", "bound")
#: Folder of the tasks. Each is compared by its definition and digest, so that a new task leaves the rows of others valid.
DEFINITIONS = "evaluation/tasks/suite"

#: Packages that compute, so that a score may depend on their versions.
COMPUTING: tuple[str, ...] = ("numpy", "scipy", "numba")


def packages(names: Iterable[str]) -> dict[str, str]:
    """Return the versions of Python and of these packages; "not installed" for one that is not there."""
    out = {"python": sys.version.split()[0]}
    for name in names:
        try:
            out[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            out[name] = "not installed"
    return out


def code_version(solver: finding.Solver | None) -> str:
    """Return "sha256:" with 8 hex digits of the hash of the sources of world, scoring and solvers.

    For a solver of another package the sources of all packages with solvers enter, because it may use any of them. Without a
    solver none does, as for the oracle.

    Raises:
        ValueError: no such solver.
    """
    files = set(_scoring())
    for package in _packages(solver) if solver is not None else ():
        files.update(sources(package))
    digest = hashlib.sha256()
    for path in sorted(files):
        digest.update(path.name.encode() + path.read_bytes())
    return f"sha256:{digest.hexdigest()[:8]}"  # never a number, whatever reads it


def _scoring() -> Iterator[Path]:
    """Yield the files of world and scoring."""
    parts = [part for part in WORLD.iterdir() if part.name not in APART]
    parts += [WORLD / "evaluation" / folder for folder in SCORING]
    for part in parts:
        files = part.rglob("*.py") if part.is_dir() else [part] if part.suffix == ".py" else []
        yield from (file for file in files if WORLD / DEFINITIONS not in file.parents)


def _packages(solver: finding.Solver) -> set[str]:
    """Return the top-level packages and modules that a solver may use."""
    own, others = offers.points()
    packages = {offers.package_of(point) for point in own}
    if not finding.is_own(solver):
        packages |= {offers.package_of(point) for point in others} | {finding.module_of(solver).partition(".")[0]}
    return packages


def sources(package: str) -> list[Path]:
    """Return the Python files of a top-level package or module without importing it; none if it is not there."""
    try:
        spec = finding.spec_of(package)
    except (ImportError, ValueError):  # a misspelt name; the script that runs has none, but a file
        file = getattr(sys.modules.get(package), "__file__", None)
        return [Path(file)] if file else []
    if spec is None:
        return []
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()]
    single = [Path(spec.origin)] if spec.origin and not folders and Path(spec.origin).is_file() else []
    return single + [path for folder in folders for path in folder.rglob("*.py")]
