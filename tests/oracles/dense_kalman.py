"""A textbook Kalman filter: dense matrices, one run, plain loops; nothing of the code under test."""

import numpy as np


def kalman(x, P, F, c, Q, H, d, R, measurements):
    """Filter ``measurements`` (None: no fix) of z = H x + d + v, x' = F x + c + w.

    Returns the list of (mean, covariance) after each step, and of (residual, S) or None.
    """
    x, P = np.array(x, dtype=float), np.array(P, dtype=float)
    beliefs, innovations = [], []
    for z in measurements:
        x = F @ x + c
        P = F @ P @ F.T + Q
        innovation = None
        if z is not None:
            residual = z - (H @ x + d)
            S = H @ P @ H.T + R
            K = P @ H.T @ np.linalg.inv(S)
            I_KH = np.eye(len(x)) - K @ H
            x = x + K @ residual
            P = I_KH @ P @ I_KH.T + K @ R @ K.T
            innovation = residual, S
        beliefs.append((x, P))
        innovations.append(innovation)
    return beliefs, innovations
