"""The verbs ``list`` and ``describe``: environments, tasks, solvers, presets, flights and recordings.

A name or a file comes in; a table or a figure goes out. Read ``listing``, ``named``, then ``flight``, ``recording``,
``figures``, ``layout``.
"""
