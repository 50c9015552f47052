"""Only regular files of a bounded size are opened, and text is UTF-8 in lines."""

import gzip
import io
import os
import zipfile

import numpy as np
import pytest

from sins_env.reading import archives, files
from sins_env.reading.archives import archive
from sins_env.reading.files import opened, read_text, text_blocks


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda path: path.mkdir(), "Is a directory"),
        (os.mkfifo, "a pipe; allowed: a regular file"),  # opening one waits for a writer
        (lambda path: path.symlink_to("/dev/zero"), "a device; allowed: a regular file"),
        (lambda path: path.symlink_to(path), "Too many levels of symbolic links"),
        (lambda path: (path.touch(), os.truncate(path, 9 << 30)), "9.664 GB; allowed: a file of at most 8.59 GB"),
    ],
    ids=["folder", "pipe", "device", "loop", "sparse"],
)
def test_what_is_no_file_of_a_sound_size(tmp_path, make, message):
    path = tmp_path / "x"
    make(path)
    with pytest.raises((ValueError, OSError), match=message), opened(path):
        pytest.fail("it was opened")


def test_a_file_without_a_size_is_bounded():
    with pytest.raises(ValueError, match="more than 10 bytes"):
        read_text(files.Path("/proc/self/status"), 10)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        ("1 2\n".encode("utf-16-le"), "a NUL byte in line 1; allowed: UTF-8 text, or UTF-16 with a byte order mark"),
        (b"\x1f\x8b\x08\n", "a damaged archive"),
        (b"PK\x03\x04" + b"1 2\n" * 9, "a damaged archive"),
        (gzip.compress(bytes(80 << 20)), "a NUL byte in line 1"),
        (gzip.compress(b"1\n" * (40 << 20)), "expands to more than 8"),
        (b"1\n2\n3\0\n", "a NUL byte in line 3"),
        (b"1 " * (1 << 20), "line 1 has more than 1.049 MB"),
        (b"1\n2\n" + b"1 " * (2 << 20), "line 3 has more than 1.049 MB"),
        (b"1\n" * (1 << 20) + b"\0", "a NUL byte in line 1048577"),
    ],
)
def test_what_is_no_text(tmp_path, data, message):
    (tmp_path / "x.txt").write_bytes(data)
    with pytest.raises(ValueError, match=rf"x\.txt: {message}"):
        for _ in text_blocks(tmp_path / "x.txt"):
            pass


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_marks_and_ends_of_lines_make_no_difference(tmp_path, end):
    path = tmp_path / "x.txt"
    path.write_bytes(b"\xef\xbb\xbf" + f"1 2{end}3 4{end}".encode())
    assert [line for block in text_blocks(path) for line in block] == ["1 2", "3 4"]
    assert read_text(path, 100) == "1 2\n3 4\n"
    path.write_bytes(b"1\n\xe9t\xe9\n")
    with pytest.raises(ValueError, match=r"x\.txt: line 2 is no UTF-8 text .byte 0xe9"):
        read_text(path, 100)


def test_arrays_are_read_only_when_asked_for(tmp_path):
    path = tmp_path / "x.npz"
    np.savez(path, good=np.arange(3), bad=np.array([{}], dtype=object))
    with archive(path) as found:
        assert found.keys() == ["good", "bad"]
        np.testing.assert_array_equal(found.read("good"), [0, 1, 2])
        with pytest.raises(ValueError, match="bad holds Python objects"):
            found.read("bad")


def test_an_archive_may_expand_so_far(tmp_path, monkeypatch):
    path = tmp_path / "x.npz"
    np.savez_compressed(path, a=np.zeros(1_000_000))
    with archive(path) as found:
        assert found.read("a").shape == (1_000_000,)
    monkeypatch.setattr(archives, "FREE_BYTES", 1 << 20)
    with pytest.raises(ValueError, match="expands to 8 MB; allowed: at most"), archive(path):
        pytest.fail("it was opened")


def test_a_header_that_promises_more_than_is_there(tmp_path):
    path, out = tmp_path / "x.npz", io.BytesIO()
    np.lib.format.write_array_header_1_0(out, {"descr": "<f8", "fortran_order": False, "shape": (300_000_000_000,)})
    with zipfile.ZipFile(path, "w") as made:
        made.writestr("a.npy", out.getvalue() + bytes(24))
    with (
        archive(path) as found,
        pytest.raises(ValueError, match=r"a of shape .* needs 2400000000000 bytes, and 24 are"),
    ):
        found.read("a")
