"""The command line ``sins-env``.

The words of a command come in; a verb runs, and tables, figures and an exit code go out. Read ``main``, ``command``,
``grammar``, ``arguments``, ``output``, then the functions of the verbs in ``verbs`` and ``describe``.
"""
