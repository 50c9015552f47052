"""The results file, an SQLite database with one row per run, which is complete or absent and is found by its key.

The records of ``play`` come in, a chunk at a time; the results of ``score`` go out, as if they had just been played.
Read ``key``, ``schema``, ``rows``, ``database``, ``store``, ``filling``, then ``export``, ``verify`` and
``merging``.
"""

from sins_env import moved

_HERE = tuple(f"{__name__}.{name}" for name in ("store", "key", "database"))
#: In version 0.1.0 this was a module; its names are found here still.
__getattr__ = moved.forward(__name__, _HERE)
