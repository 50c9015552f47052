"""Adoption of rows: what an older version of the code has made counts as made by the present one, if that makes the same.

Some rows of each solver and task are run again. If all are equal to what is stored, as ``verify`` would find them, the rows get
the present version in one transaction. The file keeps who did so, when, with which packages, from which version, and how many
rows were compared. If any row differs, nothing is adopted. A run that the present code has made itself stays as it is, and the
cost of a step is not adopted, for equal scores do not tell the speed.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import groupby
from typing import NamedTuple

from sins_env.evaluation import monte_carlo
from sins_env.evaluation.bound import oracle
from sins_env.evaluation.estimators import version
from sins_env.evaluation.play.executors import Runner
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.schema import KEY
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.store.verify import Verified, verify

_OF_KEY = " AND ".join(f"{name} = ?" for name in KEY[:-1])


class Adoption(NamedTuple):
    """Rows of one solver and task that were adopted."""

    before: str  #: version of the code that had them
    code: str  #: version of the code that has them since
    runs: str  #: their numbers, such as "0-199 205"
    compared: int  #: number of rows that were run again
    session: int  #: session that adopted them (:meth:`Store.sessions` has machine, time and packages)


def older(store: Store, tasks: Sequence[str] = (), solvers: Sequence[str] = ()) -> list[Key]:
    """Return the rows to adopt: those of the latest other version of the code, by solver and task.

    What the present code has made in full is left out.
    """
    codes: dict[str, str] = {}
    found: dict[tuple[str, ...], Key] = {}
    for key in store.keys(tasks, solvers, every_code=True, oracles=True):
        code = codes.setdefault(key.solver, _present(key.solver))
        if key.code != code and store.runs_of(key) - store.runs_of(replace(key, code=code)):
            found[key.task, key.suite, key.solver, key.settings] = key
    return list(found.values())


def _present(solver: str) -> str:
    """Return the present version of the code; empty for a solver that is not there, of which ``verify`` says so."""
    try:
        return version.code_version(None if solver == oracle.SOLVER else solver)
    except ValueError:
        return ""


def adopt(
    store: Store,
    keys: Sequence[Key],
    rows: int,
    seed: int | None = None,
    draw: int | None = None,
    *,
    trusted: Collection[str] = (),
    where: Runner | None = None,
    progress: monte_carlo.Report | None = None,
) -> tuple[Verified, list[Adoption]]:
    """Run ``rows`` rows of these keys again, at least one of each, and adopt all rows of the keys if none differs.

    The arguments are those of :func:`verify`. Keys whose rows cannot be run again are left out, as there.

    Raises:
        ValueError: fewer rows than keys, or code that has changed meanwhile.
    """
    if rows < len(keys):
        raise ValueError(
            f"rows = {rows} for {len(keys)} pairs of a solver and a task; allowed: at least one row of each, "
            "so more rows, or fewer tasks and solvers"
        )
    before = {key.solver: _present(key.solver) for key in keys}
    found = verify(
        store, keys, rows, seed, draw, trusted=trusted, other_code=True, where=where, progress=progress
    )  # fmt: skip
    if changed := [name for name, code in before.items() if _present(name) != code]:
        raise ValueError(f"the code of {', '.join(changed)} has changed meanwhile; nothing was adopted, so try again")
    if found.differences:
        return found, []
    return found, _write(store, found.compared, before)


def _write(store: Store, compared: Mapping[Key, int], codes: Mapping[str, str]) -> list[Adoption]:
    """Give the rows of all keys their new version in one transaction, and keep what was done."""
    out = []
    with store.explaining(), store.transaction():
        session = store.session()
        for key, count in compared.items():
            code = codes[key.solver]
            sql = f"UPDATE OR IGNORE runs SET code = ? WHERE {_OF_KEY} RETURNING run"
            runs = [run for (run,) in store.connection.execute(sql, (code, *key.values))]
            one = Adoption(key.code, code, ranges(runs), count, session)
            row = (*key.values[:-1], *one)
            store.connection.execute(f"INSERT INTO adoptions VALUES ({', '.join('?' * len(row))})", row)
            out.append(one)
    return out


def adoptions(store: Store, key: Key) -> list[Adoption]:
    """Return the adoptions of this solver's rows on this task and suite, the earliest first."""
    sql = "SELECT before, code, runs, compared, session FROM adoptions"
    sql += " WHERE task = ? AND suite = ? AND solver = ? AND settings_hash = ? ORDER BY session"
    with store.explaining():
        return [Adoption(*row) for row in store.connection.execute(sql, key.values[:-1])]


def ranges(numbers: Iterable[int]) -> str:
    """Write numbers of runs as ranges, such as "0-199 205"."""
    parts = []
    for _, group in groupby(enumerate(sorted(numbers)), key=lambda pair: pair[1] - pair[0]):
        some = [number for _, number in group]
        parts.append(f"{some[0]}" if len(some) == 1 else f"{some[0]}-{some[-1]}")
    return " ".join(parts)
