"""Sigma-point filters: moments through a few chosen points instead of derivatives."""
