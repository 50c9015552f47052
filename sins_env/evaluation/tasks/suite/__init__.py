"""Definitions of the evaluation tasks, with a family in each file.

A file defines ``TASKS``, a tuple of :class:`EvaluationTask`, and the catalogue finds it without further registration.
It ends with ``DIGESTS`` of their worlds, made by :func:`sins_env.evaluation.digest`, to which the tests hold the code.
Read ``swaying_base`` first. docs/tasks_and_scores.md#tasks explains the fields, and
docs/tasks_and_scores.md#alignment-criterion the choice of thresholds.
"""
