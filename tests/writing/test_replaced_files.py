"""A file appears whole or not at all, and what was there stays until then."""

import os
import threading

import pytest

from sins_env.writing.files import replacing, write_text


def test_nothing_is_left_of_a_file_that_fails(tmp_path):
    path = tmp_path / "r.html"
    path.write_text("before")

    def fail():
        with replacing([path]) as (new,):
            new.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_text() == "before"
    assert os.listdir(tmp_path) == ["r.html"]
    write_text(path, "é")
    assert path.read_bytes() == "é".encode()
    assert os.listdir(tmp_path) == ["r.html"]


def test_a_file_that_cannot_take_its_place_is_one_line(tmp_path):
    with pytest.raises(OSError, match=r"r\.html cannot be written: No such file"), replacing([tmp_path / "r.html"]):
        pass  # nothing was written
    with pytest.raises(OSError, match="it is a directory"), replacing([tmp_path]):
        pytest.fail("the work began")


def test_a_link_stays_a_link(tmp_path):
    (tmp_path / "link").symlink_to(tmp_path / "target")
    write_text(tmp_path / "link", "x")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "target").read_text() == "x"


def test_a_pipe_is_written_to(tmp_path):
    path, said = tmp_path / "pipe", []
    os.mkfifo(path)
    reader = threading.Thread(target=lambda: said.append(path.read_text()))
    reader.start()
    write_text(path, "x")
    reader.join(10)
    assert said == ["x"]
    assert os.listdir(tmp_path) == ["pipe"]
