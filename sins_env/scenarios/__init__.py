"""Scenarios: a motion, its place, its sensors and what counts as aligned, in one YAML or JSON file or one dict.

A file comes in; the id of an environment with its keyword arguments, and the fields of a task, go out. Read ``key``,
``motions`` and ``table``, which list every key once, then ``scenario``. docs/scenarios.md shows the way with examples.
"""
