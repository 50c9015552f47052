"""Records become scores: metrics with intervals, paired comparisons and ranks.

Read ``quantities``, ``metrics``, ``navigation``, ``consistency``,
``resampling``, ``paired``, ``repeatability``, ``ranking``, ``results``.
"""
