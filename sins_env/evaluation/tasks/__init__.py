"""Evaluation tasks: what is run, with which seeds, and what counts as aligned.

A name comes in; an :class:`EvaluationTask` goes out, which has an environment with its settings, thresholds, and the error
that ranks. Read ``task``, a file of ``suite``, ``catalogue``, then ``fingerprint``.
"""

from sins_env import moved

#: In version 0.1.0 this was a module; its names are found here still.
__getattr__ = moved.forward(__name__, [f"{__name__}.{part}" for part in ("task", "catalogue", "fingerprint")])
