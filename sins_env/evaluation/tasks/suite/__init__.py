"""The tasks of the suite, with a scenario in each file; the numbers of the files give their order.

The catalogue reads every file of this folder without further registration. ``digest`` is that of the task's world, made by
:func:`sins_env.evaluation.digest`, to which the tests hold the code. The keys are in docs/scenarios.md, the tasks in
docs/tasks_and_scores.md#tasks, and the choice of thresholds in docs/tasks_and_scores.md#alignment-criterion.
"""
