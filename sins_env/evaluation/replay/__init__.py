"""A solver on a recording: attitudes and tracks of every window, their scatter, tables and figures.

Read ``replaying``, ``track``, ``tables``, ``angles_figure``, ``track_figure``.
"""
