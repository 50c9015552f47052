"""Verbs that read results files: board, report, compare, export, verify, merge; and the hash of a suite seed."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from rich.console import Console

from sins_env.checks import unknown
from sins_env.cli.output import RunFailed, check_plot, remark, save_figure
from sins_env.evaluation.bound import oracle
from sins_env.evaluation.play.executors import runner
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.report import page as pages
from sins_env.evaluation.score import paired
from sins_env.evaluation.show import error_figure, terminal_tables
from sins_env.evaluation.show import plain_tables as boards
from sins_env.evaluation.show.templates import check_jinja2
from sins_env.evaluation.store import adopting, merging
from sins_env.evaluation.store import export as exports
from sins_env.evaluation.store import verify as verification
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.catalogue import named
from sins_env.evaluation.tasks.task import seed_hash
from sins_env.writing.files import write_text

VERIFIED_ROWS, ADOPTED_ROWS = 20, 200  #: rows to run again by default, and before an adoption
LEAST_SECRET_BITS = 64  #: least length of a secret suite seed, which could be guessed from its hash otherwise


def _chosen(given: Namespace, store: Store, oracles: bool = False) -> list[Key]:
    """Return the keys of the tasks and solvers that the options name; with ``oracles`` also those of the oracle.

    Raises:
        ValueError: a name that the file does not have.
    """
    held, tasks = store.keys(oracles=oracles), named(given.task)
    for kind, wanted, there in (
        ("task", tasks, {key.task for key in held}),
        ("solver", given.solver, {key.solver for key in held}),
    ):
        for name in wanted:
            if name not in there:
                raise unknown(f"{kind} in {given.db}", name, there)
    return [key for key in held if key.among(tasks, given.solver)]


def board(given: Namespace, console: Console) -> int:
    """Print the ranked tables of a results file."""
    check_plot(given.plot)
    with Store(given.db, read_only=True) as store:
        keys = _chosen(given, store)
        results = [store.results(key, whole=bool(given.plot)) for key in keys]
    if given.form:
        text = {"md": boards.as_markdown, "csv": boards.as_csv, "json": boards.as_json}[given.form](results)
        print(text.rstrip("\n"))
    elif not results:
        remark(f"{given.db}: no results yet")
    else:
        terminal_tables.print_tables(results, console)
    if given.plot and results:
        save_figure(error_figure.error_figure(results), given.plot)
    return 0


def report(given: Namespace, console: Console) -> int:
    """Write the HTML page of a results file."""
    path = Path(given.html)
    if not path.resolve().parent.is_dir():
        raise ValueError(f"--html {path}: the directory does not exist")
    check_jinja2()
    with Store(given.db, read_only=True) as store:
        keys = _chosen(given, store)
        if not keys:
            raise ValueError(f"{given.db}: no results yet; sins-env eval makes some")
        with Bar(f"report of {given.db}") as bar:
            text = pages.html_report(store, keys, lambda done, total: bar.update(done / total, 1.0))
    write_text(path, text)
    remark(f"report: {path}, {len(text.encode()) / 1e6:.1f} MB")
    return 0


def compare(given: Namespace, console: Console) -> int:
    """Compare two solvers of a results file over the runs that both have."""
    with Store(given.db, read_only=True) as store:
        names = Namespace(task=[given.task], solver=[given.solver, given.reference], db=given.db)
        chosen = _chosen(names, store)
        pairs = [
            (a, b)
            for a in chosen
            for b in chosen
            if (a.suite, a.solver, b.solver) == (b.suite, given.solver, given.reference) and a != b
        ]
        if not pairs and given.solver == given.reference:
            raise ValueError(
                f"{given.solver} against itself; allowed: two solvers, or two settings of one in {given.db}"
            )
        if not pairs:
            raise ValueError(f"{given.solver} and {given.reference} on {given.task}: no suite in common in {given.db}")
        for a, b in pairs:
            print(paired.compare(store.results(a), store.results(b), given.score))
    return 0


def export(given: Namespace, console: Console) -> int:
    """Export every run of the file, or those of some tasks and solvers."""
    form = next(name for name in exports.FORMATS if getattr(given, name))
    path = Path(getattr(given, form))
    if not path.resolve().parent.is_dir():
        raise ValueError(f"--{form} {path}: the directory does not exist")
    if form == "parquet":
        exports.check_parquet()
    with Store(given.db, read_only=True) as store:
        count = exports.export(store, _chosen(given, store), form, path)
    remark(f"{form}: {path}, {count} run{'s' * (count != 1)}")
    return 0


def verify(given: Namespace, console: Console) -> int:
    """Run random rows of a results file again, and print the differences; with ``--adopt`` those of an older code.

    Raises:
        RunFailed: runs that differ, or none that could be run again.
    """
    rows = given.rows or (ADOPTED_ROWS if given.adopt else VERIFIED_ROWS)
    adopted: list[adopting.Adoption] = []
    with Store(given.db, read_only=not given.adopt) as store:
        keys = _chosen(given, store, oracles=True)
        if given.adopt:
            keys = adopting.older(store, named(given.task), given.solver)
            if not keys:
                print(f"{given.db}: all rows are of the present code")
                return 0
        with runner(None, given.workers, rows) as where, Bar(f"verifying {given.db}") as bar:
            what = {"trusted": given.solver, "where": where, "progress": bar.update}
            if given.adopt:
                found, adopted = adopting.adopt(store, keys, rows, given.seed, given.draw, **what)
            else:
                found = verification.verify(store, keys, rows, given.seed, given.draw, **what)
    for reason, count in found.left_out.items():
        remark(f"not verifiable, {count} run{'s' * (count != 1)}: {reason}")
    for text in found.differences:
        remark(text)
    if found.differences:
        nothing = "; nothing was adopted" if given.adopt else ""
        raise RunFailed(f"{given.db}: {len(found.differences)} differences in {found.runs} runs{nothing}")
    if not found.runs:
        raise RunFailed(f"{given.db}: no run could be verified")
    luck = any(key.solver == oracle.SOLVER for key in found.compared)
    also = ", those of the oracle to 1e-6" if luck else ""
    print(f"{found.runs} run{'s' * (found.runs != 1)} made again: equal to 1e-9{also}")
    if adopted:
        before, now = (", ".join(sorted(set(codes))) for codes in zip(*(one[:2] for one in adopted), strict=True))
        print(f"{len(adopted)} pairs of a solver and a task, made with code {before}, count as made with {now}")
    return 0


def merge(given: Namespace, console: Console) -> int:
    """Merge results files into a new one, and print what its tables will not compare.

    Raises:
        RunFailed: conflicts; nothing is written then.
    """
    try:
        with Bar(f"merging {len(given.file)} files") as bar:
            merged = merging.merge(given.file, given.db, bar.update)
    except merging.Conflicts as error:
        for text in error.found:
            remark(text)
        several = "s" * (len(error.found) != 1)
        raise RunFailed(
            f"{len(error.found)} conflict{several}, {given.db} is not written: leave a file out; "
            "sins-env verify --db FILE shows whose runs can be made again"
        ) from error
    for text in merged.remarks:
        remark(text)
    again = f", {merged.repeated} rows were there already" if merged.repeated else ""
    print(f"{given.db}: {merged.runs} run{'s' * (merged.runs != 1)} of {len(given.file)} files{again}")
    return 0


def suite(given: Namespace, console: Console) -> int:
    """Print the hash of a suite seed."""
    if given.seed.bit_length() < LEAST_SECRET_BITS:
        remark(f"a seed of fewer than {LEAST_SECRET_BITS} bits can be guessed from its hash")
    print(seed_hash(given.seed))
    return 0
