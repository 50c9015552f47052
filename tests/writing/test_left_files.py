"""Temporary files of processes that were killed are removed by the next one that writes the same file."""

import os
import subprocess
import sys

import pytest

from sins_env.writing.files import write_text

pytestmark = pytest.mark.skipif(os.name != "posix", reason="whether a process runs is asked on POSIX only")


def test_what_a_killed_process_left_is_removed(tmp_path):
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    kept = [
        f".page.html.{os.getppid()}.part",  # its process runs
        f".page.htm.{ended.pid}.part",  # of another file
        ".page.html.me.part",  # of something else
        f".page.html.{10**30}.part",
        "page.html.part",
    ]
    for name in [*kept, f".page.html.{ended.pid}.part"]:
        (tmp_path / name).touch()
    write_text(tmp_path / "page.html", "whole")
    assert sorted(os.listdir(tmp_path)) == sorted([*kept, "page.html"])
