"""The HTML report: one self-contained page of tables and figures from a results file.

Read ``page``, ``tables``, ``figures``, ``panel``, ``svg``.
"""

from sins_env import moved

#: In version 0.1.0 this was a module; its names are found here still.
__getattr__ = moved.forward(__name__, ("sins_env.evaluation.report.page",))
