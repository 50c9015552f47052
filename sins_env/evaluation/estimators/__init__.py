"""Estimators seen from outside: finding them, guarding their calls, and isolating their processes.

A name, ``module:Factory`` or class comes in; an object with ``reset`` and ``step`` goes out, which can do no harm to others.
Read ``finding``, ``offers``, ``about``, ``guard``, ``isolation``, ``child`` and ``wire``, then the other end of a process,
``keeper`` and ``serving``, and ``processes``, ``memory``, ``version``.
"""
