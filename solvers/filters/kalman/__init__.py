"""Kalman filters by linearisation: linear, extended, iterated, invariant and predictive, and an adapter to filterpy.

Read ``kf`` and ``ekf`` first; they differ only in where the tangent is taken.
"""
