"""Figures of the reproduction paper: errors of single runs, flights, and the toy examples of 002.

Results come in; Matplotlib figures go out. Read ``courses``, then ``navigation`` and ``toy``.
"""
