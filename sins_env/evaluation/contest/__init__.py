"""Entries of strangers for a board: what an entrant hands in, and what the holder of the board makes of it. docs/contest.md.

A results file comes in and a bundle goes out (``submitting``); a bundle comes in, and its figures go out beside those of a hidden
suite (``judging``). Read ``bundle``, ``submitting``, ``judging``.
"""
