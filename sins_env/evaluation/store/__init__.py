"""The results file, an SQLite database: one row a run, complete or absent, found again by its key.

Read ``key``, ``rows``, ``schema``, ``database``, ``store``, ``filling``, then ``export`` and ``verify``.
"""

from sins_env import moved

#: In version 0.1.0 this was a module; its names are found here still.
__getattr__ = moved.forward(__name__, ("sins_env.evaluation.store.store",))
