"""The zoo of filters, without the pipeline around them: ``make_filter("ckf")``.

Symbols: x, P mean and covariance, f, Q transition, z, h, R measurement, K gain, S innovation covariance (in
``square_root`` and ``moments``: a root of P), J Jacobian, xi, wm, wc points and weights.
"""

from solvers.filters.registry import FILTERS, make_filter, names, register

# isort: split
# importing a filter registers it: the Gaussian family, adaptive, sums and models, H-infinity, robust, predictive, particles
from solvers.filters import kf, ekf, iekf, inekf, ukf, ckf, ckf5, ddf, filterpy_adapter  # noqa: F401, I001
from solvers.filters import aukf, augmented_aukf  # noqa: F401
from solvers.filters import gsf_ekf, imm, asmugsf  # noqa: F401
from solvers.filters import hinf, hinf_uif, mixed_hinf_ukf  # noqa: F401
from solvers.filters import huber_ckf, mcc_ckf, student_t_ckf, gm_ekf  # noqa: F401
from solvers.filters import mpf  # noqa: F401
from solvers.filters import pf, gpf, cgpf, upf  # noqa: F401

__all__ = ["FILTERS", "make_filter", "names", "register"]
