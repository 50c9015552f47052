"""A terminal without Unicode gets the nearest ASCII, and never an error."""

import io

from sins_env.writing.plain import fit, nearest


def written(text, encoding):
    stream = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    fit(stream)
    stream.write(text)
    stream.flush()
    return stream.buffer.getvalue()


def test_the_nearest_ascii():
    text = "12.4°–25.4° Cramér-Rao ━━ 3 µs … 漢 \ud800"
    assert nearest(text) == "12.4d-25.4d Cramer-Rao -- 3 us ~ \\u6f22 \\ud800"
    assert written(text, "ascii") == nearest(text).encode()


def test_what_the_encoding_has_stays():
    assert written("é ° – µ", "latin-1") == "é ° - µ".encode("latin-1")
    assert written("é – \ud800", "utf-8") == "é – ".encode() + b"\\ud800"
