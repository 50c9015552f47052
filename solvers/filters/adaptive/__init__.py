"""Adaptive filters: they are told a noise, and estimate Q, R and the means of the noise from their own innovations.

Read ``base`` first, then ``aukf`` with its three memories, then ``augmented_aukf``.
"""

from sins_env import moved

#: In version 0.1.0 this was a module; its names are found here still.
__getattr__ = moved.forward(__name__, ("solvers.filters.adaptive.base",))
