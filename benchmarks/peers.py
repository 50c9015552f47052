"""Other filter packages on the problem of this project: ten states, two measurements, the same numbers for all.

    python benchmarks/peers.py                                   installs the packages, measures, prints the table
    python benchmarks/peers.py --json benchmarks/peers.json      and keeps the result; --md FILE: as Markdown
    python benchmarks/peers.py --doc                             writes docs/peers.md from the kept result, or from the new one
                                                                 if --json or --md is given too

The packages live in the environment ``.venv-peers``, which the first call makes. Every package filters the same record with
each filter that it has (KF, EKF, UKF, CKF), with a call for each fix, as an environment wants it. Those on JAX filter whole
records in one call, too. One cubature filter, written by hand for this problem alone, shows what is possible. The last two
columns, the differences from our filter of the same kind, show that they solve the same problem.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from collections.abc import Collection, Mapping, Sequence
from importlib.metadata import distribution
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from markers import replaced
from peers import environment, features, tables

RESULT = Path(__file__).with_name("peers.json")
PAGE = environment.ROOT / "docs/peers.md"
SECTION = "peers"
ONE_THREAD = {
    **dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    "JAX_ENABLE_X64": "1",
    "JAX_PLATFORMS": "cpu",
}


def parser() -> argparse.ArgumentParser:
    """Make the parser of the command line."""
    p = argparse.ArgumentParser(description="speed of filters beside that of other packages, on the alignment problem")
    p.add_argument("--steps", type=int, default=100, help="steps of a run, 2 or more (default %(default)s)")
    p.add_argument("--rounds", type=int, default=7, help="times that each block is timed (default %(default)s)")
    p.add_argument("--runs", type=int, nargs="+", default=[64, 1024], help="batch sizes beside 1 (default 64 1024)")
    p.add_argument("--json", type=Path, metavar="FILE", help="write the result")
    p.add_argument("--md", type=Path, metavar="FILE", help="write the table as Markdown")
    p.add_argument("--doc", action="store_true", help=f"write docs/{PAGE.name}; alone: from {RESULT.name}")
    return p


def main(arguments: Sequence[str] | None = None) -> int:
    given = parser().parse_args(arguments)
    if given.doc and not (given.json or given.md):
        write_page(json.loads(RESULT.read_text()))
        return 0
    for name, least in (("steps", 2), ("rounds", 1)):
        if getattr(given, name) < least:
            parser().error(f"--{name} {getattr(given, name)}: must be {least} or more")
    if min(given.runs) < 2 or sorted(set(given.runs)) != given.runs:
        parser().error(f"--runs {' '.join(map(str, given.runs))}: must be 2 or more, in ascending order")
    if Path(sys.prefix).resolve() != environment.FOLDER.resolve():
        environment.prepare()
        again = [str(environment.PYTHON), __file__, *(sys.argv[1:] if arguments is None else arguments)]
        return subprocess.run(again, env={**os.environ, **ONE_THREAD}).returncode
    measure(given)
    return 0


def measure(given: argparse.Namespace) -> None:
    """Measure, print the table and write the files; runs in the environment of the packages."""
    if hasattr(os, "sched_setaffinity"):  # before NumPy and JAX count the cores
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    from peers.measuring import measured
    from rich import box
    from rich.console import Console
    from rich.table import Table

    result = measured(given.steps, given.rounds, given.runs)
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False, padding=(0, 1, 0, 0))
    for i, heading in enumerate(tables.headings(result)):
        table.add_column(heading.replace(" ", "\n"), justify="left" if i < 2 else "right")
    packages = [tables.package(row) for row in result["rows"]]
    for row, name, following in zip(result["rows"], packages, [*packages[1:], None], strict=True):
        table.add_row(*tables.cells(row), end_section=name != following)
    console = Console()
    console.print(table)
    for line in [*tables.conditions(result), *tables.notes(result)]:
        console.print(line, highlight=False)
    for package, files in gone(result["versions"]).items():
        console.print(f"the feature table names files of {package} that are gone: {', '.join(files)}")
    if given.json:
        given.json.write_text(json.dumps(result, indent=1) + "\n")
    if given.md:
        given.md.write_text(tables.document(result))
    if given.doc:
        write_page(result)


def write_page(result: Mapping[str, Any]) -> None:
    """Write the tables of the page from a result."""
    PAGE.write_text(replaced(PAGE.read_text(), SECTION, tables.section(result)))


def gone(installed: Collection[str]) -> dict[str, list[str]]:
    """Return the files named as evidence in the feature table that the installed packages no longer have."""
    found = {}
    for package in installed:
        if package in environment.PEERS:
            folder = Path(str(distribution(environment.PEERS[package].distribution).locate_file("")))
            if missing := features.missing_evidence(package, folder):
                found[package] = missing
    return found


if __name__ == "__main__":
    sys.exit(main())
