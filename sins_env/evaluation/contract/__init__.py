"""The estimator contract as named checks, which a plug-in must pass.

A solver comes in, a result for each point of docs/tasks_and_scores.md#estimator-contract goes out, with advice if it fails.
Read ``told``, ``checker``, ``points``, ``checking``.
"""

from sins_env.evaluation.contract.checker import TOLERANCE, Check
from sins_env.evaluation.contract.checking import check_estimator

__all__ = ["TOLERANCE", "Check", "check_estimator"]
