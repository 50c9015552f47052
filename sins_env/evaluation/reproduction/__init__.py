"""The published tables again: each is run as a Monte Carlo and set beside what is printed. docs/tasks_and_scores.md#reproduction.

A table is data: a module of ``documents`` that makes :class:`~sins_env.evaluation.reproduction.tables.Table` objects, and
a line in ``documents/__init__.py`` that lists them.
"""

from __future__ import annotations

from sins_env.checks import unknown
from sins_env.evaluation.reproduction import documents
from sins_env.evaluation.reproduction.tables import Table

TABLES: dict[str, Table] = {table.number: table for table in documents.TABLES}


def names() -> list[str]:
    """The numbers of all tables, in the order of the documents."""
    return list(TABLES)


def printed() -> list[str]:
    """Those that the documents print; the others go on where they end, and are made only when they are asked for."""
    return [number for number, table in TABLES.items() if not table.beyond]


def get_table(number: str) -> Table:
    """A table by its number.

    Raises:
        ValueError: an unknown one; the nearest is offered.
    """
    if number not in TABLES:
        raise unknown("table", number, TABLES)
    return TABLES[number]
