"""Sigma-point filters: moments through a few chosen points instead of derivatives.

Read ``ckf`` first, then ``sigma_point`` and ``square_root``, which these filters share.
"""
