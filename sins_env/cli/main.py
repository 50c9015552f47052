"""Entry point of ``sins-env``. Ctrl-C is one line from the start on, also while packages are imported."""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence

from sins_env import _COMMAND
from sins_env.cli.interrupts import quiet


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0, 1 for a failed run, 2 for wrong use, 130 for Ctrl-C."""
    if "_ARGCOMPLETE" in os.environ:  # a shell asks what could stand at its cursor
        from sins_env.cli.completion import complete  # what no other command needs

        complete()
    with quiet():
        from sins_env.cli import command  # takes a tenth of a second, in which Ctrl-C would show where
    try:
        return command.execute(argv)
    finally:
        if _COMMAND:  # what is left is the end of the interpreter
            signal.signal(signal.SIGINT, signal.SIG_IGN)
