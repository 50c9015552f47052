"""The only loop: one estimator against one world, and the workers in which such jobs run.

A task, a solver and run numbers come in; records of errors, failures and times go out.
Read ``criteria``, ``fields``, ``records``, ``playing``, ``one_run``, then ``pool``, ``executors`` and ``progress``.
"""
