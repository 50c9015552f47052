"""Readings: how a printed figure is read off our own runs, so that both mean the same.

The results of runs come in; estimates with intervals go out. Read ``common``, then ``sway`` and ``car``.
"""
