"""Robust filters: measurements that do not fit lose weight."""

from sins_env import moved

#: In version 0.1.0 this was a module; its names are found here still.
__getattr__ = moved.forward(__name__, ("solvers.filters.robust.base",))
