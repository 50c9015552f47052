"""The zoo of filters, without the pipeline around them: ``make_filter("ckf")``.

Symbols: x, P mean and covariance, f, Q transition, z, h, R measurement, K gain, S innovation covariance (in
``square_root`` and ``moments``: a root of P), J Jacobian, xi, wm, wc points and weights.
"""

from __future__ import annotations

import importlib
import pkgutil

from solvers.filters.registry import FILTERS, make_filter, names, register

for _module in pkgutil.walk_packages(__path__, f"{__name__}."):  # importing a filter's module registers it
    importlib.import_module(_module.name)

__all__ = ["FILTERS", "make_filter", "names", "register"]
