"""Reproduction of the published tables: each is run as a Monte Carlo and set beside the printed figures.

The tables of the source documents come in, as data; the text of REPRODUCTION.md and its figures go out. A table is a
:class:`~sins_env.evaluation.reproduction.tables.Table` made by a module of ``documents``, which lists it. Read ``tables``,
``verdicts``, ``readings``; then one of ``documents``; then ``running``; then ``showing``, ``pictures``,
``claims``, ``paper``. See docs/tasks_and_scores.md#reproduction.
"""

from __future__ import annotations

from sins_env.checks import unknown
from sins_env.evaluation.reproduction import documents
from sins_env.evaluation.reproduction.tables import Table

TABLES: dict[str, Table] = {table.number: table for table in documents.TABLES}


def names() -> list[str]:
    """Return the numbers of all tables, in the order of the documents."""
    return list(TABLES)


def printed() -> list[str]:
    """Return the numbers of the tables that the documents print. The others go further, and are made on demand only."""
    return [number for number, table in TABLES.items() if not table.beyond]


def get_table(number: str) -> Table:
    """Return a table by its number.

    Raises:
        ValueError: an unknown number; the nearest is offered.
    """
    if number not in TABLES:
        raise unknown("table", number, TABLES)
    return TABLES[number]
