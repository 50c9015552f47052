"""One table, written as instruments and spreadsheets of many kinds write it, is read as the same numbers."""

import gzip
import io
import json
import zipfile

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from sins_env.reading.files import following
from sins_env.recordings import load
from sins_env.recordings.text.dates import calendar_seconds

N, HZ = 300, 100.0
RNG = np.random.default_rng(5)
T = 1000.0 + np.arange(1, N + 1) / HZ
GYRO = 1e-2 * RNG.standard_normal((N, 3))
ACCEL = np.array([0.2, -0.1, 9.8]) + 1e-2 * RNG.standard_normal((N, 3))
NAMES = ["t", "wx", "wy", "wz", "ax", "ay", "az"]
ROWS = [[repr(float(x)) for x in row] for row in np.column_stack([T, GYRO, ACCEL])]
MAP = {
    "format": "csv",
    "axes": "RFU",
    "site": [48.1, 11.6, 520.0],
    "time": {"column": "t"},
    "gyro": {"columns": NAMES[1:4], "unit": "rad/s"},
    "accel": {"columns": NAMES[4:], "unit": "m/s2"},
}
NUMBERED = {
    "time": {"column": 1},
    "gyro": {"columns": [2, 3, 4], "unit": "rad/s"},
    "accel": {"columns": [5, 6, 7], "unit": "m/s2"},
}


def lines(delimiter=",", names=NAMES, change=str, end=""):
    head = [delimiter.join(names) + end] if names else []
    return [*head, *(delimiter.join(map(change, row)) + end for row in ROWS)]


def text(*args, between="\n", **more):
    return between.join(lines(*args, **more)) + between


def write(folder, content, name="imu.csv", **mapping):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    given = {key: value for key, value in {**MAP, **mapping}.items() if value is not None}
    (folder / "imu.json").write_text(json.dumps(given))
    return path


def comma(field):
    return field.replace(".", ",")


def fortran(field):
    return f"{float(field):.15E}".replace("E", "D")


def zipped(content):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as made:
        made.writestr("log/imu.csv", content)
    return out.getvalue()


def below_names(row):
    head, *rows = lines()
    return "\n".join([head, row, *rows]) + "\n"


COMMENTED = "// Start Time: Unknown\n// Update Rate: 100.0Hz\n\n"
WAYS = {
    "semicolons and decimal commas": (text(";", change=comma), {}),
    "told": (text(";", change=comma), {"delimiter": ";", "decimal": ","}),
    "quoted decimal commas": (text(change=lambda f: f'"{comma(f)}"'), {"delimiter": ",", "decimal": None}),
    "tabs and decimal commas": (text("\t", change=comma), {}),
    "white space and decimal commas": (text("   ", change=comma), {}),
    "white space": (text("  "), {}),
    "bars": (text(" | "), {}),
    "a delimiter at every end": (text(end=","), {}),
    "a delimiter at the ends of rows": (text(end=",").replace("az,", "az", 1), {}),
    "quotes": (text(names=[f'"{name}"' for name in NAMES], change=lambda f: f'"{f}"'), {}),
    "a space behind each comma": (text(", "), {}),
    "units below the names": (below_names("s,rad/s,rad/s,rad/s,m/s2,m/s2,m/s2"), {}),
    "Fortran": (text(change=fortran), {}),
    "UTF-16": (text(between="\r\n").encode("utf-16"), {}),
    "UTF-16, the other order": (b"\xfe\xff" + text().encode("utf-16-be"), {}),
    "UTF-8 with a mark": (text().encode("utf-8-sig"), {}),
    "slashes": (COMMENTED + text(), {}),
    "a mark of its own": ("! by hand\n" + text(), {"comment": "!"}),
    "lines to skip": ("Logger 3\nSerial 17, 4\n" + text(), {"skip_lines": 2}),
    "names in the comment": ("#" + text(), {}),
    "names with units": (
        text(names=["#t [s]", *(f"w{x} [rad s^-1]" for x in "xyz"), *(f"a{x} [m s^-2]" for x in "xyz")]),
        {},
    ),
    "numbers below names": (text(), NUMBERED),
    "numbers without names": (text(names=()), NUMBERED),
    "gzip": (gzip.compress(text().encode()), {}),
    "zip": (zipped(text()), {}),
}


@pytest.mark.parametrize("way", WAYS)
def test_ways_to_write_one_table(tmp_path, way):
    content, mapping = WAYS[way]
    found = load(write(tmp_path, content, **mapping))
    assert (found.rate_hz, found.t0) == (HZ, pytest.approx(1000.0))
    assert_allclose(found.dtheta, GYRO / HZ, rtol=1e-13)
    assert_allclose(found.dvel, ACCEL / HZ, rtol=1e-13)


def test_compressed_files_by_their_ending(tmp_path):
    found = load(write(tmp_path, gzip.compress(text().encode()), "imu.csv.gz"))
    assert_allclose(found.dvel, ACCEL / HZ, rtol=1e-13)


def replaced(number, new, **more):
    there = lines(**more)
    there[number - 1] = new
    return "\n".join(there) + "\n"


@pytest.mark.parametrize(
    ("content", "mapping", "message"),
    [
        (
            text(change=comma),
            {"delimiter": ","},
            "line 2 has 14 columns .delimiter ','., the header 7 names; allowed: a name for every column",
        ),
        (replaced(9, "1000.08,1,2,3,1;5,0,9.8"), {}, r"line 9, column 5 is '1;5'; allowed: a finite number$"),
        (
            replaced(9, "1000.08;1;2;3;1,5;0;9.8", delimiter=";"),
            {"delimiter": ";"},
            'line 9, column 5 is \'1,5\'; allowed: a finite number with a decimal point, or "decimal": ","',
        ),
        (
            replaced(9, '1000.08,1,2,3,"1,0,9.8'),
            {},
            "line 9 has a quote that does not end before a delimiter",
        ),
        (text(";", change=lambda f: "1,000"), {}, '\'1,000\' may be 1.000 or 1000; allowed: "decimal": ","'),
        (
            below_names("s,deg/s,deg/s,deg/s,m/s2,m/s2,m/s2"),
            {},
            "unit of gyro is 'rad/s', and the header says 'deg/s' of column 2 .'deg/s'.; allowed: that unit",
        ),
        (
            text(names=["t", *(f"w{x} (deg/s)" for x in "xyz"), *"abc"]),
            {"accel": {"columns": [5, 6, 7], "unit": "m/s2"}},
            "the header says 'deg/s' of column 2",
        ),
        (
            "one\ntwo words\n" + text(),
            {"header": False, **NUMBERED, "delimiter": ","},
            "column of gyro = 2; allowed: .* from 1 to 1, the columns of line 1",
        ),
        (text(), {"comment": [1]}, "comment = .1.; allowed: the marks of comments"),
        (text(), {"skip_lines": -1}, "skip_lines = -1"),
        (text(), {"decimal": ";"}, "unknown decimal mark ';'"),
        (text(), {"decimal": ",", "delimiter": ","}, 'delimiter and decimal are both ","'),
        (text(), {"time": {"column": "t", "unit": "days"}}, "unknown unit of time .days..*seconds as a number"),
        (text(), {"time": {"column": "t", "scale": "TAI"}}, "unknown scale of time 'TAI'"),
        (text(), {"gyro": {**MAP["gyro"], "scale": [1, 2]}}, "scale of gyro = .1, 2.; allowed: a number, or 3 of them"),
    ],
)
def test_what_is_wrong_is_said_where_it_is(tmp_path, content, mapping, message):
    with pytest.raises(ValueError, match=message):
        load(write(tmp_path, content, **mapping))


def test_the_way_out_of_a_wrong_header_works(tmp_path):
    """The advice is to take the columns by number."""
    content = below_names("s,deg/s,deg/s,deg/s,m/s2,m/s2,m/s2")
    assert_allclose(load(write(tmp_path, content, **NUMBERED)).dtheta, GYRO / HZ, rtol=1e-13)


def test_counts_with_a_scale(tmp_path):
    counts = np.rint(np.hstack([GYRO / HZ / 5e-8, ACCEL / HZ / [1e-6, 1e-6, 2e-6]]))
    rows = [
        ",".join(NAMES),
        *(f"{t!r}," + ",".join(f"{x:.0f}" for x in row) for t, row in zip(T.tolist(), counts, strict=True)),
    ]
    gyro = {"columns": NAMES[1:4], "unit": "rad", "scale": 5e-8}
    accel = {"columns": NAMES[4:], "unit": "m/s", "scale": [1e-6, 1e-6, 2e-6]}
    found = load(write(tmp_path, "\n".join(rows), gyro=gyro, accel=accel))
    assert_allclose(found.dtheta, counts[:, :3] * 5e-8, rtol=1e-13)
    assert_allclose(found.dvel, counts[:, 3:] * [1e-6, 1e-6, 2e-6], rtol=1e-13)


def with_times(names, times, delimiter=","):
    rows = [[*time, *row[1:]] for time, row in zip(times, ROWS, strict=True)]
    return "\n".join(delimiter.join(row) for row in [[*names, *NAMES[1:]], *rows]) + "\n"


def stamps(form="datetime", start="2026-06-01T10:00:00", step_ms=10):
    at = np.datetime64(start, "ms") + step_ms * np.arange(1, N + 1)
    return np.datetime_as_string(at, unit="ms")


#: Calendar seconds of 2026-06-01T10:00:00 since 1980-01-06, 2421 weeks, one day and ten hours, in GPS time and as UTC.
GPS = 2421 * 604800.0 + 86400 + 36000
START = GPS + 18


@pytest.mark.parametrize(
    ("names", "times", "time", "start"),
    [
        (["t"], [[s + "Z"] for s in stamps()], {"column": "t"}, START),
        (["t"], [[s.replace("T", " ")] for s in stamps()], {"column": "t"}, START),
        (["t"], [[s + "+02:00"] for s in stamps()], {"column": "t"}, START - 7200),
        (["day", "t"], [s.replace("-", "/").split("T") for s in stamps()], {"columns": ["day", "t"]}, START),
        (
            list("YMDhms"),
            [[s[:4], s[5:7], s[8:10], s[11:13], s[14:16], s[17:]] for s in stamps()],
            {"columns": list("YMDhms")},
            START,
        ),
        (["w", "t"], [["2421", f"{122400 + (k + 1) / 100:.2f}"] for k in range(N)], {"column": "t", "week": "w"}, GPS),
        (
            ["w", "t"],  # a week ends inside
            [[str(2421 + (k >= 99)), f"{(604799 + (k + 1) / 100) % 604800:.2f}"] for k in range(N)],
            {"column": "t", "week": "w"},
            2421 * 604800.0 + 604799,
        ),
        (["t"], [[str(1780308000000 + 10 * k)] for k in range(1, N + 1)], {"column": "t", "unit": "ms", "scale": "Unix"}, START),
        (["t"], [[str((4294967000 + 100 * k) % 2**32)] for k in range(1, N + 1)], {"column": "t", "unit": 1e-4, "wraps": 2**32},
         429496.7),
    ],
    ids=["ISO", "a space", "an offset", "two columns", "six columns", "week", "a new week", "Unix", "a counter"],
)  # fmt: skip
def test_times(tmp_path, names, times, time, start):
    found = load(write(tmp_path, with_times(names, times), time=time))
    assert (found.rate_hz, found.t0) == (HZ, pytest.approx(start, abs=1e-6))
    assert_allclose(found.dvel, ACCEL / HZ, rtol=1e-4)  # held over steps of stamps in doubles, at 1e9 s
    assert (found.gaps, found.bridged) == ([], ())


def test_a_time_that_is_none_is_named(tmp_path):
    times = [[s] for s in stamps()]
    times[6] = ["2026-13-01T10:00:00"]
    with pytest.raises(
        ValueError, match=r"line 8, column 1 is '2026-13-01T10:00:00'; allowed: a date with a time, such as"
    ):
        load(write(tmp_path, with_times(["t"], times)))
    counts = [[str((4294967000 + 100 * k) % 2**32)] for k in range(1, N + 1)]
    with pytest.raises(ValueError, match=r'to 4 at line 4, as a counter of 32 bits does; allowed: "wraps": 4294967296'):
        load(write(tmp_path, with_times(["t"], counts)))


@pytest.mark.parametrize(
    ("text_", "seconds"),
    [
        ("1980-01-06T00:00:00Z", 0.0),
        ("2026-06-01 10:00:00.010", GPS + 0.01),
        ("2026/6/1 9:00:00", GPS - 3600),
        ("01.06.2026 10:00:00,5", GPS + 0.5),
        ("20260601T100000", GPS),
        ("2026-06-01T10:00:00-0130", GPS + 5400),
        ("06/01/2026 10:00:00", np.nan),  # month or day first?
        ("2026-06-01", np.nan),
        ("1000.0", np.nan),
        ("9999-01-01T00:00:00", np.nan),
    ],
)
def test_calendar_forms(text_, seconds):
    assert calendar_seconds([text_])[0] == pytest.approx(seconds, abs=1e-6, nan_ok=True)


def test_a_counter_tells_lost_packets(tmp_path):
    """As Xsens exports it: no stamps, a counter of 16 bits that begins again, and one packet lost."""
    counts = [str((65400 + k) % 65536) for k in range(N + 1) if k != 200]
    rows = [[count, "", *row[1:]] for count, row in zip(counts, ROWS, strict=True)]
    content = COMMENTED + "\n".join("\t".join(row) for row in [["PacketCounter", "SampleTimeFine", *NAMES[1:]], *rows])
    found = load(write(tmp_path, content, time=None, rate_hz=100))
    assert [(gap.samples, gap.start) for gap in found.bridged] == [(1, pytest.approx(2.0))]
    named = load(tmp_path / "imu.csv", counter={"column": "PacketCounter", "wraps": 65536})
    assert_array_equal(named.dvel, found.dvel)


FIX = ["48.1", "11.6", "520.0", "0.1", "0.2", "0.3"]


def one_table(*places, blank="", fix=FIX):
    rows = [[*row, *(fix if k in places else [blank] * 6)] for k, row in enumerate(ROWS)]
    names = [*NAMES, "lat", "lon", "h", "vn", "ve", "vd"]
    return [",".join(row) for row in [names, *rows]]


GNSS = {
    "time": {"column": "t"},
    "position": {"columns": ["lat", "lon", "h"], "unit": "deg"},
    "velocity": {"columns": ["vn", "ve", "vd"], "frame": "NED"},
}


@pytest.mark.parametrize("blank", ["", " ", "NaN", "null"])
def test_blank_columns_are_rows_without_a_fix(tmp_path, blank):
    found = load(write(tmp_path, "\n".join(one_table(99, 199, blank=blank)), gnss=GNSS, site=None))
    assert_allclose(found.gnss.t_s, [1001.0, 1002.0])
    assert_array_equal(found.gnss.vel, [[0.2, 0.1, -0.3]] * 2)
    assert_allclose(found.dvel, ACCEL / HZ, rtol=1e-13)


def test_a_part_of_a_fix_is_none(tmp_path):
    with pytest.raises(ValueError, match="no row holds a fix; allowed: a fix in some row, or a mapping without"):
        load(write(tmp_path, "\n".join(one_table()), gnss=GNSS, site=None))
    rows = one_table(99, 199)
    rows[100] = rows[100].replace("520.0", "")
    with pytest.raises(
        ValueError, match="line 101 has a part of a fix; allowed: all of its columns, or all of them blank"
    ):
        load(write(tmp_path, "\n".join(rows), gnss=GNSS, site=None))
    rows = one_table(99, 199)
    rows[50] = rows[50].replace("0.", "inf", 1)
    with pytest.raises(ValueError, match=r"line 51, column \d is"):
        load(write(tmp_path, "\n".join(rows), gnss=GNSS, site=None))


def test_scaled_fixes(tmp_path):
    """As u-blox writes them: 1e-7 deg, mm, mm/s, and one accuracy for the horizontal."""
    rows = one_table(99, 199, fix=["481000000", "116000000", "520000", "100", "200", "300"])
    spec = {
        "time": {"column": "t"},
        "position": {"columns": ["lat", "lon", "h"], "unit": "deg", "scale": [1e-7, 1e-7, 1e-3]},
        "velocity": {"columns": ["vn", "ve", "vd"], "frame": "NED", "scale": 1e-3},
        "position_std": {"columns": ["vn", "vn", "vd"], "frame": "ENU", "scale": 1e-3},
    }
    gnss = load(write(tmp_path, "\n".join(rows), gnss=spec, site=None)).gnss
    assert_allclose(gnss.pos, np.tile([np.radians(48.1), np.radians(11.6), 520.0], (2, 1)))
    assert_allclose(gnss.vel, [[0.2, 0.1, -0.3]] * 2)
    assert_allclose(gnss.pos_std, [[0.1, 0.1, 0.3]] * 2)


def test_a_file_for_each_part(tmp_path):
    """As gnss-ins-sim writes them."""
    for name, head, values in (
        ("gyro-0.csv", "gyro_x (deg/s),gyro_y (deg/s),gyro_z (deg/s)", np.degrees(GYRO)),
        ("accel-0.csv", "accel_x (m/s^2),accel_y (m/s^2),accel_z (m/s^2)", ACCEL),
        ("time.csv", "time (sec)", T[:, None]),
    ):
        np.savetxt(tmp_path / name, values, delimiter=",", header=head, comments="")
    mapping = {
        **{key: MAP[key] for key in ("format", "axes", "site")},
        "file": "gyro-0.csv",
        "time": {"file": "time.csv", "column": 1},
        "gyro": {"columns": [1, 2, 3], "unit": "deg/s"},
        "accel": {"file": "accel-0.csv", "columns": ["accel_x", "accel_y", "accel_z"], "unit": "m/s2"},
    }
    (tmp_path / "imu.json").write_text(json.dumps(mapping))
    found = load(tmp_path / "imu.json")
    assert_allclose(found.dtheta, GYRO / HZ, rtol=1e-12)
    assert_allclose(found.dvel, ACCEL / HZ, rtol=1e-12)
    np.savetxt(tmp_path / "time.csv", T[:-1, None], header="time (sec)", comments="")
    with pytest.raises(
        ValueError, match=r"time\.csv: 299 rows, gyro-0\.csv 300; allowed: a row for each sample in both"
    ):
        load(tmp_path / "imu.json")


def test_kfgins_text_with_decimal_commas_and_with_weeks(tmp_path):
    rows = np.column_stack([T, GYRO[:, [1, 0, 2]] / HZ, ACCEL[:, [1, 0, 2]] / HZ]) * [1, 1, 1, -1, 1, 1, -1]
    usual = " ".join(["%.6f"] + ["%.12e"] * 6)
    np.savetxt(tmp_path / "a.txt", rows, fmt=usual)
    expected = load(tmp_path / "a.txt", site=[48.1, 11.6, 520.0])
    (tmp_path / "b.txt").write_text((tmp_path / "a.txt").read_text().replace(".", ","))
    found = load(tmp_path / "b.txt", site=[48.1, 11.6, 520.0])
    assert_array_equal(found.dvel, expected.dvel)
    assert found.t0 == expected.t0
    np.savetxt(tmp_path / "c.txt", np.column_stack([np.full(N, 2421), rows]), fmt="%d " + usual)
    fixes = [[1001.0, 48.1, 11.6, 520.0, 0.1, 0.1, 0.1], [1002.0, 48.1, 11.6, 520.0, 0.1, 0.1, 0.1]]
    np.savetxt(tmp_path / "fixes.txt", fixes)
    found = load(tmp_path / "c.txt", gnss="fixes.txt")
    assert_array_equal(found.dvel, expected.dvel)
    assert found.t0 == pytest.approx(2421 * 604800 + 1000.0)
    assert_allclose(found.gnss.t_s - found.t0, [1.0, 2.0])


def test_reading_says_how_far_it_is_and_keeps_lines(tmp_path):
    """Of a file of several blocks a fault far behind has its line, and every row is there."""
    head, *rows = lines()
    many = [head, *rows]
    for k in range(1, 60):
        many += [f"{1000 + (k * N + i + 1) / HZ!r},{row.partition(',')[2]}" for i, row in enumerate(rows)]
    many[12000] = "# a comment"
    path, shares = write(tmp_path, "\n".join(many)), []
    with following(shares.append):
        found = load(path)
    assert len(found.dtheta) == 60 * N
    assert [gap.samples for gap in found.bridged] == [1]
    assert len(shares) > 2
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    many[17000] = many[17000].replace("9.", "x.", 1)
    with pytest.raises(ValueError, match=r"line 17001, column \d is"):
        load(write(tmp_path, "\n".join(many)))
