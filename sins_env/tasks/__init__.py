"""Tasks by name and from files: ``sins_env.tasks.load("ferry.yaml")``. docs/scenarios.md.

``load`` makes a task of a scenario, and ``register`` also makes it known by its name in this process. ``get`` takes a name or
a scenario. ``names`` lists the tasks of the suite, of installed packages, and those that were registered.
"""

from sins_env.evaluation.tasks.catalogue import get_task as get
from sins_env.evaluation.tasks.catalogue import load, names, register
from sins_env.evaluation.tasks.task import EvaluationTask

__all__ = ["EvaluationTask", "get", "load", "names", "register"]
