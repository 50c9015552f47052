"""Kalman filters by linearisation: KF, EKF, iterated, invariant and predictive forms, and an adapter to filterpy."""
