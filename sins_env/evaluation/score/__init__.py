"""Scores: metrics with intervals, paired comparisons and ranks, as functions of the records of runs.

The records of one solver on one task come in; a :class:`~sins_env.evaluation.score.results.Results` with its summary goes
out, and ``show`` makes tables of it. Read ``quantities``, ``headline``, ``metrics``, ``navigation``, ``consistency``,
``resampling``, ``repeatability``, ``results``, ``paired``, ``ranking``.
"""
