"""Functions of the verbs; small verbs of one subject share a file.

A function takes the parsed options and a console, prints its result, and returns the exit code. Read ``run``,
``evaluate``, ``results_file``, ``recordings``, then ``check``, ``bench``, ``warm``, ``reproduce``.
"""
