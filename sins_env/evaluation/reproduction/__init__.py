"""The published tables again: each is run as a Monte Carlo and set beside what is printed. evaluation.md section 6.

A table is data: a module of this package that makes :class:`~sins_env.evaluation.reproduction.tables.Table` objects, and
a line below that lists them.
"""

from __future__ import annotations

from sins_env.errors import unknown
from sins_env.evaluation.reproduction import car_coarse, car_fine, car_interference
from sins_env.evaluation.reproduction.tables import Table

_ALL = (*car_coarse.TABLES, *car_fine.TABLES, *car_interference.TABLES)
TABLES: dict[str, Table] = {table.number: table for table in _ALL}


def names() -> list[str]:
    """The numbers of all tables, in the order of the documents."""
    return list(TABLES)


def get_table(number: str) -> Table:
    """A table by its number.

    Raises:
        ValueError: an unknown one; the nearest is offered.
    """
    if number not in TABLES:
        raise unknown("table", number, TABLES)
    return TABLES[number]
