"""A file in the folder ``formats`` is a format, and nothing else has to name it."""

import dataclasses
from pathlib import Path

import pytest
from oracles import made

from sins_env.cli.grammar import parser
from sins_env.recordings import FORMATS, format_of, formats, load, save
from sins_env.recordings.formats import kfgins, npz


def test_every_file_of_the_folder_is_a_format():
    files = {path.stem for path in Path(formats.__file__).parent.glob("*.py")} - {"__init__"}
    assert {format.load.__module__.rpartition(".")[2] for format in FORMATS.values()} == files
    assert list(FORMATS) == [format.name for format in FORMATS.values()]


def test_help_and_errors_name_every_format(capsys, tmp_path):
    with pytest.raises(SystemExit):
        parser().parse_args(["convert", "--help"])
    help_text = " ".join(capsys.readouterr().out.split())
    with pytest.raises(ValueError, match="no format has the ending") as caught:
        format_of(tmp_path / "a.xyz")
    for name, format in FORMATS.items():
        assert f"{name} ({format.ending}" in help_text
        assert f"{format.ending} ({name})" in str(caught.value)
        assert all(f"NAME{more}{format.ending}" in help_text for more in format.companions)


@pytest.fixture
def other(monkeypatch):
    """A second format of texts: one that begins with a word."""
    other = dataclasses.replace(
        kfgins.FORMAT, name="words", load=lambda path, mapping: npz.load(path.with_suffix(".npz"), mapping),
        recognises=lambda path: path.read_text().startswith("WORDS"),
    )  # fmt: skip
    monkeypatch.setitem(FORMATS, "words", other)
    return other


def test_where_formats_share_an_ending_the_file_decides(other, tmp_path):
    recording = made.recording()
    save(recording, tmp_path / "a.txt", format="kfgins")
    save(recording, tmp_path / "b.npz")
    (tmp_path / "b.txt").write_text("WORDS\n")
    assert [format_of(tmp_path / name) for name in ("a.txt", "b.txt")] == ["kfgins", "words"]
    assert load(tmp_path / "b.txt").rate_hz == recording.rate_hz


@pytest.mark.parametrize("text", ["", "1 2 3\n"])
def test_a_file_that_none_of_them_takes_for_its_own_is_an_error(other, tmp_path, text):
    (tmp_path / "c.txt").write_text(text)
    with pytest.raises(
        ValueError, match=r"c.txt: the ending '.txt' is that of kfgins, .*, words; allowed: one of them, given"
    ):
        format_of(tmp_path / "c.txt")
    with pytest.raises(ValueError, match=r"the ending '.txt' is that of kfgins, words"):
        save(made.recording(), tmp_path / "d.txt")
