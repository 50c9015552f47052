"""Robust filters: fixes that do not fit lose weight.

Read ``reweighting`` first, the update that the cubature filters share, then ``base``, its guard. ``gm_ekf`` stands alone.
"""

from sins_env import moved

#: In version 0.1.0 this was a module; its names are found here still.
__getattr__ = moved.forward(__name__, ("solvers.filters.robust.base",))
