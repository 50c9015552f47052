"""Adaptive filters: they estimate Q and R from their own innovations."""

from sins_env import moved

#: In version 0.1.0 this was a module; its names are found here still.
__getattr__ = moved.forward(__name__, ("solvers.filters.adaptive.base",))
