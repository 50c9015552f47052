"""Gaussian sums and interacting models: several hypotheses, weighted by their likelihood.

Read ``base`` first: what all banks of filters share. ``angles`` serves ``gsf_ekf`` alone.
"""
