"""Scores: metrics with intervals, paired comparisons and ranks, as functions of the records of runs.

The records of one solver on one task come in; a :class:`~sins_env.evaluation.score.results.Results` with its summary goes
out, and with those of other solvers a verdict on each. ``show`` makes tables of them. Read ``quantities``, ``headline``,
``exact``, ``losses``, ``verdicts``, ``results``, ``ranking``, ``paired``; then what stands beside the score: ``metrics``,
``navigation``, ``consistency``, ``resampling``, ``repeatability``.
"""
