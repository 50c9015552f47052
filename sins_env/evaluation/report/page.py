"""The leaderboard as one HTML file that needs nothing else: no network, no JavaScript.

Tables have the columns and footers of the terminal (sins_env.evaluation.show). One task is in memory at a time. The same
results file gives the same bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from sins_env.evaluation.report.page_figures import drawings
from sins_env.evaluation.report.page_tables import Failure, Row, failures_of, heads_of, page_columns, rows_of
from sins_env.evaluation.report.panel import DASHES, Drawing, Lineup, Look
from sins_env.evaluation.report.svg import LOOKS
from sins_env.evaluation.score import ranking
from sins_env.evaluation.score.headline import headline
from sins_env.evaluation.score.quantities import quantity
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show import footer
from sins_env.evaluation.show.cells import Cell
from sins_env.evaluation.show.templates import template
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Session, Store
from sins_env.evaluation.tasks.task import EvaluationTask

MOST_NAMED = LOOKS  #: number of best solvers in colour; the others are grey
MOST_REASONS = 60  #: most lines of a table of failures


class Section(NamedTuple):
    """Section of the page with one task, as the template shows it."""

    anchor: str  #: identifier of the section
    task: EvaluationTask
    suite: str
    scored: bool
    heads: list[tuple[str, str]]
    rows: list[Row]
    notes: list[str]
    legend: list[tuple[str, Look]]
    others: int
    has_bound: bool
    has_oracle: bool
    holds: bool
    drawings: list[Drawing]
    failures: list[Failure]
    failed: int  #: number of failed runs
    reasons_left: int
    runs: int
    fewest: int
    most: int
    leaders: list[str]
    best: Cell
    best_of: str  #: name of the best solver's error, for the overview; empty if its heading has it
    digest: str | None  #: digest of the task's world
    sessions: list[tuple[str, Session]]  #: code version and session of the runs
    task_navigates: bool


def html_report(
    store: Store, keys: Sequence[Key], progress: Callable[[float, float], None] = lambda done, total: None
) -> str:
    """Return the page with these keys of a store.

    Args:
        store: results file.
        keys: keys of the solvers to show.
        progress: function called with the number of solvers that are done and with their total.

    Raises:
        ValueError: jinja2 is not installed.
    """
    page_of = template("report/page.html.j2")
    groups: dict[tuple[str, str], list[Key]] = {}
    for key in keys:
        groups.setdefault((key.task, key.suite), []).append(key)
    looks: dict[str, Look] = {}  # a solver looks the same in every task
    sections, done = [], 0
    for number, group in enumerate(groups.values()):
        results = []
        for key in group:
            results.append(store.results(key))
            done += 1
            progress(done - 0.5, len(keys))
        made = store.digest_of(group[0].task), _sessions(store, group)
        sections.append(_section(f"t{number}", results, made, looks))
        progress(done, len(keys))
    css = Path(__file__).with_name("page.css").read_text()
    solvers = {(key.solver, key.settings) for key in keys}
    many_suites = len({key.suite for key in keys}) > 1
    page: str = page_of.render(
        sections=sections,
        css=css,
        solvers=len(solvers),
        dashes=DASHES,
        many_suites=many_suites,
    )
    return page


def _section(
    anchor: str,
    results: Sequence[Results],
    made: tuple[str | None, list[tuple[str, Session]]],
    looks: dict[str, Look],
) -> Section:
    lines = ranking.ranked(results)
    group = [one for _, one in lines]
    named = [one.label for one in group[:MOST_NAMED]]
    for label in named:
        looks.setdefault(label, Look(len(looks)))
    lineup = Lineup(group, {label: looks[label] for label in named}, anchor)
    failures = failures_of(group)
    runs = [len(one.records) for one in group]
    first = group[0].summary
    main = page_columns(group)[0]
    best = main.shown(group[0])
    digest, sessions = made
    return Section(
        anchor=anchor,
        task=group[0].task,
        suite=group[0].suite,
        scored=first.scored,
        heads=heads_of(group),
        rows=rows_of(lines, lineup),
        notes=footer.footer(group).split("\n"),
        legend=[(label, lineup.looks[label]) for label in named],
        others=len(group) - len(named),
        has_bound=lineup.bound is not None,
        has_oracle=lineup.oracle is not None,
        holds=lineup.bound is not None and bool(lineup.bound.holds),
        drawings=drawings(lineup),
        failures=failures[:MOST_REASONS],
        reasons_left=len(failures[MOST_REASONS:]),
        failed=sum(one.verdict.failures for one in group),
        runs=sum(runs),
        fewest=min(runs),
        most=max(runs),
        leaders=[one.label for rank, one in lines if rank == 1] if first.scored else [],
        best=best if first.scored else Cell("-", "not scored: no reference"),
        best_of=quantity(headline(group[0].task), True).name if first.navigation is not None else "",
        digest=digest,
        sessions=sessions,
        task_navigates=first.navigation is not None,
    )


def _sessions(store: Store, keys: Iterable[Key]) -> list[tuple[str, Session]]:
    """Return each code version with its session in the order of time; runs of all solvers are added up."""
    found: dict[tuple[int, str], Session] = {}
    for key in keys:
        for session in store.sessions(key):
            before = found.get((session.id, key.code))
            found[session.id, key.code] = session._replace(runs=session.runs + (before.runs if before else 0))
    return [(code, session) for (_, code), session in sorted(found.items(), key=lambda item: item[0])]
