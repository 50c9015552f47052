"""Moments of functions of a Gaussian by a tensor grid of Gauss-Hermite points: slow, and exact to high degree."""

from itertools import product

import numpy as np


def gauss_hermite(g, mean, P, per_axis=30):
    """Mean (m,), covariance (m, m) and cross covariance (n, m) of g(x), x ~ N(mean, P); ``g`` takes (..., n)."""
    nodes, weights = np.polynomial.hermite_e.hermegauss(per_axis)
    weights = weights / weights.sum()
    n, L = len(mean), np.linalg.cholesky(P)
    w = np.array([np.prod(c) for c in product(weights, repeat=n)])
    x = mean + np.array(list(product(nodes, repeat=n))) @ L.T
    y = g(x)
    mean_y = w @ y
    return mean_y, (w[:, None] * (y - mean_y)).T @ (y - mean_y), (w[:, None] * (x - mean)).T @ (y - mean_y)
