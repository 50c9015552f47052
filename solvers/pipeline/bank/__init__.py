"""The bank of the recommended solver: an INS for each slice of headings, models of the noises, and regimes of the fixes.

The told start of a run, or its first fix, comes in; weighted inertial solutions go out. Read ``regimes`` (the update with a
fix), ``models`` (the noise of the IMU, and an offset of the fixes), ``slices`` (inertial solutions with weights: reset, merger,
estimate), ``start``, and last ``gsf_imm``, the estimator. Equations: docs/mathematics/filters.md#bank-of-inertial-solutions.
"""
