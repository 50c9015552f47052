"""Runs the tutorials as a reader does, and writes into them what was printed and drawn, and what it cost.

    python benchmarks/tutorials.py                     every page of docs/tutorials
    python benchmarks/tutorials.py first_alignment     one of them

A page is plain Markdown. Its blocks are taken in their order, in a folder that is empty at first:

    python, yaml    a file, whose name is in the comment of the first line
    sh              commands
    text            what the commands before it printed

A figure ``![...](figures/PAGE-NAME.png)`` is the file ``NAME.png`` that a command drew. The line that begins with ``*Run time`` is
written too. Tests run the same blocks with little work (tests/test_tutorials.py).
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
import re
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

PAGES = Path(__file__).resolve().parents[1] / "docs" / "tutorials"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
FILE_NAME = re.compile(r"# ([\w.-]+\.(?:py|ya?ml))\n")
FIGURE = re.compile(r"!\[[^\]]*\]\((figures/([\w-]+?)-([\w.]+))\)")
RUN_TIME = re.compile(r"^\*Run time.*\*$", re.MULTILINE)
COLOURS = 64  #: number of colours of a stored figure; lines and text need no more


class Block(NamedTuple):
    """A block of a page."""

    language: str
    text: str
    span: tuple[int, int]  #: begin and end of the text in the page

    @property
    def file(self) -> str | None:
        """Name of the file that the block is, if it is one."""
        named = FILE_NAME.match(self.text) if self.language in ("python", "yaml") else None
        return named[1] if named else None


def names() -> list[str]:
    """Return the names of the pages that have commands."""
    return sorted(path.stem for path in PAGES.glob("*.md") if any(b.language == "sh" for b in blocks(path.read_text())))


def blocks(page: str) -> list[Block]:
    """Return the blocks of a page in their order."""
    return [Block(found[1], found[2], found.span(2)) for found in BLOCK.finditer(page)]


def figures(page: str) -> Iterator[tuple[str, str]]:
    """Yield where each figure of a page is stored, relative to the page, and the file that a command draws."""
    for found in FIGURE.finditer(page):
        yield found[1], found[3]


def played(page: str, folder: Path) -> str:
    """Run the blocks of a page in ``folder``, and return the page with what they print."""
    environment = {
        **os.environ,
        "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
        "COLUMNS": "100",
        "OPENBLAS_NUM_THREADS": "1",
    }
    parts, end, printed = [], 0, ""
    for block in blocks(page):
        if block.file:
            (folder / block.file).write_text(block.text)
        elif block.language == "sh":
            command = ["bash", "-euo", "pipefail", "-c", block.text]
            done = subprocess.run(
                command, cwd=folder, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
            )
            printed = done.stdout.replace(f"{folder}/", "")
            if done.returncode:
                raise SystemExit(f"{block.text}\n{printed}exit code {done.returncode}")
        elif block.language == "text":
            lines = [line.rstrip() for line in printed.strip("\n").splitlines()]
            parts += [page[end : block.span[0]], "\n".join(lines).strip("\n") + "\n"]
            end = block.span[1]
    return "".join([*parts, page[end:]])


def stored(drawn: Path, to: Path) -> None:
    """Write a figure with few colours, which makes it several times smaller."""
    from PIL import Image  # comes with matplotlib

    to.parent.mkdir(exist_ok=True)
    Image.open(drawn).convert("RGB").quantize(COLOURS).save(to, optimize=True)


def spent_s() -> float:
    """Return the CPU time of the processes that have ended, s."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("page", nargs="*", help="names of pages, without .md (default: all)")
    for name in parser.parse_args().page or names():
        path, began, cpu = PAGES / f"{name}.md", time.monotonic(), spent_s()
        page = path.read_text()
        with tempfile.TemporaryDirectory() as folder:
            page = played(page, Path(folder))
            for to, drawn in figures(page):
                stored(Path(folder) / drawn, PAGES / to)
        cpu, wall = spent_s() - cpu, time.monotonic() - began
        today = datetime.date.today().isoformat()
        line = f"*Run time: the commands of this page take {cpu:.0f} s of CPU time ({platform.system()}, {today}).*"
        path.write_text(RUN_TIME.sub(line, page))
        print(f"{name}: {cpu:.1f} s of CPU time, {wall:.0f} s")


if __name__ == "__main__":
    main()
