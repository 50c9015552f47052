"""The score that a task is about: azimuth in alignment, and in navigation the quantity that the task names."""

from __future__ import annotations

from sins_env.evaluation.tasks.task import EvaluationTask

FAILURES = "failures"


def by_failures(task: EvaluationTask) -> bool:
    """Return whether the share of failed runs ranks the solvers, before any error."""
    return task.rank_by == FAILURES


def headline(task: EvaluationTask) -> str:
    """Return the name of the quantity that a task is about; azimuth for a task that ranks by failures."""
    return "azimuth" if by_failures(task) else task.rank_by


def shown_headline(task: EvaluationTask) -> str:
    """Return the name of the headline quantity in tables, which show horizontal and vertical parts separately."""
    main = headline(task)
    return {"position": "position_h", "velocity": "velocity_h"}.get(main, main)
