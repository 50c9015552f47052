"""The published tables as data, in the order of the documents; a module holds a table or a family of tables.

The printed figures come in; ``TABLES`` goes out, with the runs and readings that stand beside each figure. Each module can
be read by itself; ``sun2012`` is the shortest.
"""

from __future__ import annotations

from sins_env.evaluation.reproduction.documents import (
    car_coarse,
    car_courses,
    car_fine,
    car_interference,
    lu,
    sun2012,
    thesis_coarse,
    thesis_excess,
    thesis_filters,
    thesis_points,
    thesis_smoother,
    thesis_together,
    zhao2010,
)
from sins_env.evaluation.reproduction.tables import Table

TABLES: tuple[Table, ...] = (
    *thesis_coarse.TABLES,
    *thesis_filters.TABLES,
    *thesis_smoother.TABLES,
    *thesis_points.TABLES,
    *thesis_together.TABLES,
    *thesis_excess.TABLES,
    *car_coarse.TABLES,
    *car_fine.TABLES,
    *car_courses.TABLES,
    *car_interference.TABLES,
    *sun2012.TABLES,
    *zhao2010.TABLES,
    *lu.TABLES,
)
