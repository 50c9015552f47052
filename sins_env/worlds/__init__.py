"""The world of an episode: a motion with its sensors, or a recording.

The keyword arguments of an environment come in. The public ``Task`` goes out, and for each epoch increments, fix and
truth. Read ``limits``, ``world``; then ``settings``, ``simulated``, ``sway``, ``vehicle``; then ``profiles``, ``flight``;
then ``replay_settings``, ``windows``, ``replay``.
"""
