"""What is run: the evaluation tasks, their runs and seeds, and a digest of what each delivers.

A task names an environment with its settings and says which error ranks. Read ``task``, a file of ``suite``, ``catalogue``,
then ``fingerprint``.
"""

from sins_env import moved

#: In version 0.1.0 this was a module; its names are found here still.
__getattr__ = moved.forward(__name__, [f"{__name__}.{part}" for part in ("task", "catalogue", "fingerprint")])
