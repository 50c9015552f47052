"""Text steers nothing, in whatever form; what prints stays as it is."""

import csv
import io
import unicodedata

import numpy as np
import pytest

from sins_env.writing.visible import LAYOUT, in_csv, in_json, in_markdown, visible


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("ckf (gate=3.5) é µ 漢 😀 <b>", None),
        ("\x1b[31mred\x07", "\\x1b[31mred\\x07"),
        ("\x9b31m\x85", "\\x9b31m\\x85"),
        ("\u202egnp\u2066\u200e", "\\u202egnp\\u2066\\u200e"),
        ("\u200b\ufeff\xad\U000e0041", "\\u200b\\ufeff\\xad\\U000e0041"),
        ("a\nb\r\tc\0\u2028", "a\\nb\\r\\tc\\x00\\u2028"),
        ("\ud800", "\\ud800"),
    ],
)
def test_what_does_not_print_is_an_escape(text, shown):
    assert visible(text) == visible(visible(text)) == (text if shown is None else shown)


def test_line_breaks_stay_where_they_are_layout():
    assert visible("a\nb\xa0c\r", keep=LAYOUT) == "a\nb\xa0c\\r"


SIGNS = [c for c in map(chr, range(0x10000)) if unicodedata.normalize("NFKC", c) in ("=", "+", "-", "@", "\u2212")]


@pytest.mark.parametrize("begin", ["\t", "\r", "\n", *SIGNS], ids=ascii)
def test_a_spreadsheet_computes_nothing(begin):
    assert in_csv(f"{begin}1+1").startswith("'")
    assert in_csv(f"a{begin}1").startswith("a")


def test_no_cell_is_computed_whatever_separates_cells():
    """Texts of signs, quotes, blanks and separators, read as programs of other locales read them."""
    rng = np.random.default_rng(17)
    for text in map("".join, rng.choice(list("=+@-\uff1d\"' \n\r\t\xa0;,a1\u061b"), (3000, 7))):
        out = io.StringIO(newline="")
        csv.writer(out, lineterminator="\n").writerow(["a", in_csv(text), in_csv(text)])
        for separator in ",;\t\u061b":
            for row in csv.reader(io.StringIO(out.getvalue(), newline=""), delimiter=separator):
                assert not [one for one in row if one.strip(' "\n\xa0').startswith(tuple(SIGNS))], (text, separator)


def test_what_is_computed_nowhere_stays_as_it_is():
    for text in ("ckf (gate=3.5)", "a = b; c-d", '{"a": [1, -2]}', "a, -b", "x\n  y=1", "\xa0a"):
        assert in_csv(text) == text


def test_numbers_stay_numbers():
    assert [in_csv(one) for one in (-1.5, 3, None, True)] == [-1.5, 3, None, True]


def test_markdown_brings_no_page_no_link_and_no_cell():
    given = "a|b <script>x</script> [c](javascript:d) &lt; $x$ \x1b"
    assert in_markdown(given) == "a\\|b &lt;script&gt;x&lt;/script&gt; [c]\\(javascript:d) &amp;lt; $x$ \\x1b"


def test_json_has_neither_inf_nor_nan():
    assert in_json({"a": [float("inf"), {"b": float("nan")}], "c": 1.0}) == {"a": [None, {"b": None}], "c": 1.0}
