"""The evaluation tasks, a family a file. A file defines ``TASKS``, a tuple of :class:`EvaluationTask`; that alone makes them known.

Each states its environment, the settings of it, and what counts as aligned. Begin with ``swaying_base``.
docs/tasks_and_scores.md#tasks tells what the fields mean, docs/tasks_and_scores.md#alignment-criterion how thresholds are set.
"""
