"""Evaluation of estimators: tasks, Monte Carlo runs, scores, the results file, tables and figures.

A task and a solver come in; :class:`Results` go out. An estimator is used only through its protocol: it gets observations
and the public Task. It is found by name through the entry-point group ``sins_env.estimators``, or as
``package.module:Factory``.

Read ``monte_carlo``, then the folders from the bottom to the top: ``tasks``, ``estimators``, ``play``, ``bound``,
``speed``, ``score``, ``show``, ``store``, ``replay``, ``report``, ``reproduction``.
"""

import warnings

from sins_env.evaluation.bound import bounds as _bounds
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.contract import Check, check_estimator
from sins_env.evaluation.monte_carlo import evaluate
from sins_env.evaluation.play.one_run import Course, run_episode
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.score.metrics import Summary
from sins_env.evaluation.score.paired import Comparison, compare
from sins_env.evaluation.show.drawn_results import DrawnResults as Results
from sins_env.evaluation.tasks.catalogue import TASKS, get_task
from sins_env.evaluation.tasks.fingerprint import digest
from sins_env.evaluation.tasks.task import EvaluationTask

__all__ = [
    "TASKS",
    "Bound",
    "Check",
    "Comparison",
    "Course",
    "EvaluationTask",
    "Records",
    "Results",
    "Summary",
    "check_estimator",
    "compare",
    "digest",
    "evaluate",
    "get_task",
    "run_episode",
]


def _bound(task: EvaluationTask) -> Bound | None:
    """Return the Cramer-Rao bound of a task, as the method of version 0.1.0 did."""
    text = "EvaluationTask.bound() has moved to sins_env.evaluation.bound.bounds.find(task); the method ends with version 0.3"
    warnings.warn(text, DeprecationWarning, stacklevel=2)
    return _bounds.find(task)


EvaluationTask.bound = _bound  # type: ignore[attr-defined]  # a task lies below its bound, which imports it
