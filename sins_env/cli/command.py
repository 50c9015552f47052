"""Execution of one command. An error is one line on standard error; :func:`execute` lists the exit codes."""

from __future__ import annotations

import importlib
import os
import sys
from collections.abc import Iterable, Sequence
from typing import Any

from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.table import Table

from sins_env.checks import unknown
from sins_env.cli.arguments import WrongUse
from sins_env.cli.grammar import parser
from sins_env.cli.interrupts import INTERRUPTED, quiet
from sins_env.cli.output import RunFailed, say
from sins_env.cli.whole_tables import whole
from sins_env.writing.plain import fit
from sins_env.writing.visible import LAYOUT, visible


class ShownConsole(Console):
    """Console on which no text steers the terminal, wherever it comes from: only the console's own styles do.

    A table that is too wide is printed as several, one below the other.
    """

    def print(self, *objects: Any, **settings: Any) -> None:
        tables = len(objects) == 1 and isinstance(objects[0], Table)
        for part in whole(objects[0], self.width) if tables else ():
            super().print(part, **settings)
        if not tables:
            super().print(*objects, **settings)

    def on_broken_pipe(self) -> None:
        raise BrokenPipeError

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        for one in super().render(renderable, options):
            yield one if one.control or one.text.isprintable() else one._replace(text=visible(one.text, keep=LAYOUT))


def execute(argv: Sequence[str] | None = None) -> int:
    """Run one command and return its exit code: 0, 1 for a failed run, 2 for wrong use, 130 for Ctrl-C."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    for stream in (sys.stdout, sys.stderr):
        fit(stream)
    try:
        code = _interruptible(arguments)
        sys.stdout.flush()
        return code
    except SystemExit as error:  # --help
        return int(error.code or 0)
    except KeyboardInterrupt as error:
        return _said(str(error) or "interrupted", INTERRUPTED)
    except BrokenPipeError:  # the reader (head, less) has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except RunFailed as error:
        return _said(str(error), 1)
    except (WrongUse, ValueError, OSError) as error:
        return _said(str(error), 2)
    except Exception as error:
        if os.environ.get("SINS_ENV_TRACEBACK"):
            raise
        return _said(f"{type(error).__name__}: {error} (SINS_ENV_TRACEBACK=1 shows where)", 1)


def _interruptible(arguments: list[str]) -> int:
    """Run one command; Ctrl-C that an import has turned into another error is Ctrl-C again."""
    try:
        return _run(arguments)
    except Exception as error:
        cause: BaseException | None = error
        while cause is not None:
            if isinstance(cause, KeyboardInterrupt):
                raise KeyboardInterrupt from error
            cause = cause.__cause__ or cause.__context__
        raise


def _run(arguments: list[str]) -> int:
    top = parser()
    if not arguments:
        top.print_help(sys.stderr)
        return 2
    if not arguments[0].startswith("-") and arguments[0] not in top.verbs:
        raise unknown("command", arguments[0], top.verbs)
    given = top.parse_args(arguments)
    module, _, name = given.go.partition(":")
    with quiet():
        go = getattr(importlib.import_module(f"sins_env.cli.{module}"), name)  # what help and other verbs do without
        memory = importlib.import_module("sins_env.evaluation.estimators.memory")  # brings the whole evaluation along
    memory.keep_freed_memory()
    return int(go(given, ShownConsole(soft_wrap=not sys.stdout.isatty() and "COLUMNS" not in os.environ)))


def _said(message: str, code: int) -> int:
    """Print a message as one line on standard error, and return the exit code."""
    say(message)
    return code
