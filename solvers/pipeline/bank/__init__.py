"""The bank of the recommended solver: an INS for each slice of headings, models of the noises, and regimes of the fixes.

The told start of a run, or its first fix, comes in; weighted inertial solutions go out. Read ``regimes``, the update with a fix,
and ``models``, the noise of the IMU and an offset of the fixes. ``slices`` has the inertial solutions with their reset, merger
and estimate, and ``start`` makes them. ``episode`` goes through these epoch by epoch, and ``gsf_imm`` is the estimator.
Equations: docs/mathematics/filters.md#bank-of-inertial-solutions.
"""
