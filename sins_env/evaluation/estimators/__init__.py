"""Estimators seen from outside: finding them, checking the contract, guarding their calls, and giving them a process of their own.

A name, ``module:Factory`` or class comes in; an object with ``reset`` and ``step`` that can do no harm to others goes out.
Read ``finding``, ``contract``, ``guard``, ``processes``, ``isolation``, ``version``.
"""
