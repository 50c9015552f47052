"""The score: tasks, Monte Carlo, metrics, the results file and the board.

An estimator is seen only through its protocol: it gets observations and the public Task, and is found by
name through the entry-point group ``sins_env.estimators`` or as ``package.module:Factory``.
"""

from sins_env.evaluation.bounds import Bound
from sins_env.evaluation.check import Check, check_estimator
from sins_env.evaluation.episode import Course, run_episode
from sins_env.evaluation.metrics import Summary
from sins_env.evaluation.monte_carlo import Results, evaluate
from sins_env.evaluation.paired import Comparison, compare
from sins_env.evaluation.records import Records
from sins_env.evaluation.tasks import TASKS, EvaluationTask, digest, get_task

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
