"""Compiled kernels, and the small algebra that they share.

A function over one run goes in, and a NumPy gufunc over any batch comes out. Read ``compiling``, ``trigonometry``, ``algebra``,
then ``warming``. How to write, test and time a kernel: docs/kernels.md.
"""

from sins_env.kernels.compiling import Kernel, helper, interpreted, kernel, reduction

__all__ = ["Kernel", "helper", "interpreted", "kernel", "reduction"]
