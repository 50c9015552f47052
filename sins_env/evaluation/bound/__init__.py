"""The Cramer-Rao bound of a task: the smallest RMS error that its sensors and its prior allow.

It has its own linear error dynamics at the truth, apart from those of the solvers.
Read ``error_dynamics``, ``fisher``, ``bounds``, ``cache``.
"""
