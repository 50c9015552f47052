"""The zoo of filters, without the pipeline around them: ``make_filter("ckf")``.

Symbols: x, P mean and covariance, f, Q transition, z, h, R measurement, K gain, S innovation covariance (in
``square_root`` and ``moments``: a root of P), J Jacobian, xi, wm, wc points and weights.
"""

from solvers.filters.registry import FILTERS, make_filter, names, register

# isort: split
# importing a filter registers it
from solvers.filters import kf, ekf, ukf, ckf, filterpy_adapter  # noqa: F401, I001

__all__ = ["FILTERS", "make_filter", "names", "register"]
