"""JSON and YAML within limits of bytes, depth and values; an alias counts as all that it stands for."""

import itertools

import pytest

from sins_env.reading import documents
from sins_env.reading.documents import MOST_DEPTH, MOST_VALUES, parse_json, parse_yaml, read_document

SOUND = "a: [1, 2.5, x]\nb: {c: null, d: true}\nturn: &turn [turn, 20]\nall: [*turn, *turn]\n"


def test_sound_documents_are_what_they_were():
    assert parse_yaml(SOUND) == {
        "a": [1, 2.5, "x"],
        "b": {"c": None, "d": True},
        "turn": ["turn", 20],
        "all": [["turn", 20]] * 2,
    }
    assert parse_json('{"a": [1, 2.5, "x"], "b": -7}') == {"a": [1, 2.5, "x"], "b": -7}
    assert parse_yaml("base: &b {x: 1}\nmore: {<<: *b, y: 2}")["more"] == {"x": 1, "y": 2}


def bomb(levels):
    """Nine to the power of ``levels`` values in a line for each level."""
    lines = ["a0: &a0 [x, x, x, x, x, x, x, x, x]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, levels)]
    return "\n".join(lines)


def test_aliases_count_as_often_as_they_are_used():
    assert len(parse_yaml(bomb(4))) == 4  # 7,380 values
    with pytest.raises(ValueError, match=f"line 6: more than {MOST_VALUES} values"):
        parse_yaml(bomb(6))


@pytest.mark.parametrize("parse", [parse_json, parse_yaml])
def test_depth_is_bounded(parse):
    parse("[" * MOST_DEPTH + "]" * MOST_DEPTH)
    for depth in (MOST_DEPTH + 1, 900, 100_000):
        with pytest.raises(ValueError, match=f"deeper than {MOST_DEPTH} levels|exceeded maximum nesting depth"):
            parse("[" * depth + "]" * depth)


def test_depth_through_aliases_is_bounded():
    lines = itertools.accumulate(range(1, 40), lambda _, i: f"a{i}: &a{i} [*a{i - 1}]", initial="a0: &a0 [x]")
    with pytest.raises(
        ValueError, match=f"^line {MOST_DEPTH - 1}: lists or objects nested deeper than {MOST_DEPTH} levels"
    ):
        parse_yaml("\n".join(lines))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: &a [*a]", "line 1: the alias .a stands within itself"),
        ("a: 1\nb: 2\na: 3", "line 3 is no YAML .the key 'a' twice in one object"),
        ("a: 1\nb: [1, 2", "line 3 is no YAML"),
        ("a: *x", "line 1 is no YAML .found undefined alias"),
        ("a: 2020-99-99", "line 1 is no YAML .it cannot be read: month must be in 1..12"),
        (f"a: {'9' * 5000}", "a whole number of 5000 digits; allowed: at most 300"),
        ("!!python/name:os.system", "line 1 is no YAML .could not determine a constructor"),
        ("a: 1\n---\nb: 1", "line 2 is no YAML .but found another document"),
    ],
)
def test_bad_yaml_is_one_clear_line(text, message):
    with pytest.raises(ValueError, match=message) as error:
        parse_yaml(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": 1, "b": 2, "a": 3}', "the key 'a' twice in one object"),
        ("[" + "9" * 301 + "]", "a whole number of 301 digits"),
        ("[" + "1," * MOST_VALUES + "1]", "more than 200000 values"),
    ],
)
def test_bad_json_is_one_clear_line(text, message):
    with pytest.raises(ValueError, match=message):
        parse_json(text)


def test_errors_name_the_file_and_its_line(tmp_path, monkeypatch):
    path = tmp_path / "m.json"
    path.write_text('{"a": 1,\n "b" 2}')
    with pytest.raises(ValueError, match=r"m\.json: line 2 is no JSON"):
        read_document(path)
    path.write_text('{"a": 1, "a": 2}')
    with pytest.raises(ValueError, match=r"m\.json: line 1: the key 'a' twice"):
        read_document(path)
    monkeypatch.setattr(documents, "MOST_BYTES", 10)
    with pytest.raises(ValueError, match=r"m\.json: 16 bytes; allowed: a file of at most 10 bytes"):
        read_document(path)
