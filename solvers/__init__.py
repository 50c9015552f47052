"""solvers: the mathematics. Every filter of the sources as a small frozen dataclass, and the pipeline around it.

    make("ckf")                             the complete estimator, as ``sins-env`` runs it: aligns or navigates as the task asks
    make("ckf", feedback="closed")          settings of the pipeline and of the filter, by name
    Pipeline(MyFilter())                    the same around a filter of your own
    smooth_navigation(make("inekf"), env)   the track of an episode from all its fixes, earlier and later ones
    names()                                 what there is
    @register("mine")                       make a filter or an estimator of your own known by name

The bare filters are in :mod:`solvers.filters`, the contract in :mod:`solvers.types`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from sins_env.moved import forward

if TYPE_CHECKING:
    from solvers.making import Pipeline, describe, make, names, register, settings
    from solvers.pipeline.smoother import Smoother, smooth_navigation

__all__ = ["Pipeline", "Smoother", "describe", "make", "names", "register", "settings", "smooth_navigation"]

# The zoo is imported when it is first asked for: forty filters take a tenth of a second, which types and blocks do without.
__getattr__ = forward(__name__, ("solvers.making", "solvers.pipeline.smoother"))
