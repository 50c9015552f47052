"""A bare filter in the pipeline: what ``check`` tells whoever gives it without."""

from solvers import Pipeline
from solvers.filters.sigma.ckf import CKF


def soft_ckf():
    return Pipeline(CKF())
