"""What is run: the evaluation tasks, their runs and seeds, and a digest of what each delivers.

A task names an environment with its settings and says which error ranks. Read ``task``, then ``catalogue``, then ``fingerprint``.
"""

from sins_env import moved

#: In version 0.1.0 this was a module; its names are found here still.
__getattr__ = moved.forward(__name__, ("sins_env.evaluation.tasks.task", "sins_env.evaluation.tasks.fingerprint"))
