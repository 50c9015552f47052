"""The only loop that plays, one estimator against one world, and the workers in which such jobs run.

A task, a solver and run numbers come in; records of errors, failures and times go out. Read ``job``, ``loop``, ``playing``
with ``criteria``, ``errors`` and ``divergence``, then ``fields``, ``records``, ``one_run``. The workers are in ``pool``,
``executors``, ``queue`` and ``progress``.
"""
