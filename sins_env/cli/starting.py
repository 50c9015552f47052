"""Ctrl-C while the command ``sins-env`` starts and ends, when it has no handler: one line instead of a traceback.

The package imports this file before anything else, and it imports nothing but ``sys``, which is there already.
"""

import sys

_NAME = sys.argv[0] if sys.argv else ""
#: Whether this process is the command, as a script ``sins-env`` or as ``python -m sins_env``.
COMMAND = _NAME.endswith(("sins-env", "sins-env.exe")) or (_NAME == "-m" and "sins_env" in sys.orig_argv)


def _said(kind, error, trace):  # type: ignore[no-untyped-def]  # their types would have to be imported
    """Print what ended the command: one line for Ctrl-C, and a traceback for all else."""
    if issubclass(kind, KeyboardInterrupt):
        sys.stderr.write("sins-env: interrupted\n")
    else:
        sys.__excepthook__(kind, error, trace)


if COMMAND:
    sys.excepthook = _said
