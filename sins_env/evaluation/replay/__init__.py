"""Replay: a solver on windows of a recording, with tables and figures.

A recording and a solver come in; a :class:`~sins_env.evaluation.replay.replaying.Replay` goes out, which has the angles and
tracks of every window, their scatter, and what the solver tells of itself. Read ``told``, ``replaying``, ``track``,
``consistency``, ``tables``, ``angles_figure``, ``track_figure``.
"""
