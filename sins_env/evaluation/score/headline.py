"""The score that a task is about: azimuth in alignment, what the task names in navigation."""

from __future__ import annotations

from sins_env.evaluation.tasks.task import EvaluationTask

FAILURES = "failures"


def by_failures(task: EvaluationTask) -> bool:
    """Whether the share of failed runs ranks the solvers, before any error."""
    return task.rank_by == FAILURES


def headline(task: EvaluationTask) -> str:
    """The quantity that a task is about, also where failures rank."""
    return "azimuth" if by_failures(task) else task.rank_by


def shown_headline(task: EvaluationTask) -> str:
    """The quantity that stands for the headline in tables, which show horizontal and vertical parts by themselves."""
    main = headline(task)
    return {"position": "position_h", "velocity": "velocity_h"}.get(main, main)
