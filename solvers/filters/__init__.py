"""The zoo of filters, without the pipeline around them: ``make_filter("ckf")``.

Symbols: x, P mean and covariance, f, Q transition, z, h, R measurement, K gain, S innovation covariance (in
``square_root`` and ``moments``: a root of P), J Jacobian, xi, wm, wc points and weights.
"""

from __future__ import annotations

from solvers.registry import FILTERS, import_all, make_filter, names, register

import_all(__path__, __name__)

__all__ = ["FILTERS", "make_filter", "names", "register"]
