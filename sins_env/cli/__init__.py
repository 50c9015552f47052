"""The command line ``sins-env``: words become settings, a verb runs, and tables, figures and an exit code come out.

Read ``grammar``, ``arguments``, ``main``, ``output``, then the verbs by subject.
"""
