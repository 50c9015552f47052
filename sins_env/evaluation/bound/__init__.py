"""The Cramer-Rao bound of a task: the smallest RMS error that its sensors and its prior allow.

A simulated task comes in; the bound of each error over time goes out, or None if the task has none. The linear error
dynamics at the truth are written here once more, apart from those of the solvers.
Read ``error_dynamics``, ``fisher``, ``aids``, ``bounds``, ``cache``. An aiding sensor has a file of its name.
"""
