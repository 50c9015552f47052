"""A first mapping of a text table: what its names say and its numbers measure.

A path comes in, with what the user knows: site, axes, a file of fixes. A :class:`Guess` goes out: the keys of a mapping,
each with the measure behind it, and what cannot be measured, with what to write. Read ``names``, ``measures``,
``table``, then :func:`guess`, which asks ``times``, ``inertial`` and ``fixes``.
"""

from sins_env.recordings.guessing.guess import guess
from sins_env.recordings.guessing.table import Guess, Known

__all__ = ["Guess", "Known", "guess"]
