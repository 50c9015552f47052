"""What reaches the terminal: one line at Ctrl-C from the start on, ASCII where there is no Unicode, and no text that steers it."""

import io
import os
import signal
import subprocess
import sys

import pytest
from rich.table import Table

from sins_env.cli import command, interrupts
from sins_env.cli.main import main

#: Ctrl-C at the import of a module that comes late, and early.
STOP = """
import os, signal, sys
class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            os.kill(os.getpid(), signal.SIGINT)
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may start its children without it
sys.meta_path.insert(0, Finder())
from sins_env.cli.main import main
sys.exit(main(["list", "presets"]))
"""


@pytest.mark.parametrize("name", ["rich.console", "sins_env.evaluation"])
def test_ctrl_c_during_the_imports_is_one_line(name):
    done = subprocess.run([sys.executable, "-c", STOP.format(name=name)], capture_output=True, text=True, timeout=300)
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "sins-env: interrupted\n")


def test_another_handler_of_ctrl_c_stays():
    for before in (signal.SIG_IGN, lambda *_: None, signal.default_int_handler):
        old = signal.signal(signal.SIGINT, before)
        try:
            with interrupts.quiet():
                within = signal.getsignal(signal.SIGINT)
            assert signal.getsignal(signal.SIGINT) is before
            assert (within is before) == (before is not signal.default_int_handler)
        finally:
            signal.signal(signal.SIGINT, old)


@pytest.mark.parametrize("words", [["list"], ["describe", "sway-white-v0"], ["board", "--db", "é–\udc80.sqlite"]])
def test_a_terminal_without_unicode_gets_ascii(words, monkeypatch):
    streams = [io.TextIOWrapper(io.BytesIO(), encoding="ascii") for _ in range(2)]
    for name, stream in zip(("stdout", "stderr"), streams, strict=True):
        monkeypatch.setattr(sys, name, stream)
    code = main(words)
    text = b"".join(stream.buffer.getvalue() for stream in streams if not stream.flush())
    assert code == (2 if words[0] == "board" else 0)
    assert text.isascii()
    assert len(text) > 50


def test_no_text_steers_the_terminal():
    out = io.StringIO()
    console = command.ShownConsole(file=out, force_terminal=True, width=80)
    table = Table("\x9bhead, which is as wide as what it holds")
    table.add_row("a\x1b[2J\u202eb")
    console.print(table, style="red")
    assert "\\x1b[2J\\u202eb" in out.getvalue()
    assert "\x1b[2J" not in out.getvalue()
    assert not set("\x9b\u202e") & set(out.getvalue())
    assert "\x1b[31m" in out.getvalue()  # its own colours


def test_a_long_message_is_cut(capsys, monkeypatch):
    assert main(["describe", "x" * 100_000]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert len(line) < 5000
    assert line.endswith(" ...")
    assert os.linesep not in line
