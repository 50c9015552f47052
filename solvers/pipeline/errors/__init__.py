"""Error models of the inertial solution: how its errors grow between fixes, for alignment and for navigation.

Read ``model``, ``alignment``, ``navigation``, ``invariant``.
"""
