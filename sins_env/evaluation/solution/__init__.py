"""Solutions: a recording navigated by a solver, as one value that can be drawn and written to files.

A recording and a solver come in; a :class:`Solution` goes out. It has states with their sigmas at every epoch, and what they say
against themselves. Read ``epochs``, ``columns``, ``files``, ``solution``, ``navigating``, ``aligning``.
"""
