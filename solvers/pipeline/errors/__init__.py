"""Error models of the inertial solution: how its errors grow between fixes, in alignment and in navigation.

The motion of an epoch comes in, and a transition of the errors for a filter goes out. Read ``model`` first, then ``alignment``,
``navigation``, ``group`` and ``invariant``. Equations: docs/mathematics/error_models.md.
"""
