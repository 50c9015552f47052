"""The world of an episode: a motion with its sensors, or a recording.

An environment's keyword arguments come in; the public ``Task``, and for each epoch increments, fix and truth, go out.
Read ``world``, ``settings``, ``simulated``, ``sway``, ``vehicle``,
``profiles``, ``flight``, ``replay_settings``, ``windows``, ``replay``.
"""
