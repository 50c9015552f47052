"""CSV files as their mapping says, with every unit and frame, against plain NumPy and scipy."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles import made
from scipy.spatial.transform import Rotation

from sins_env.recordings import load

N, HZ = 600, 100.0
RNG = np.random.default_rng(3)
MS = 1000.0 + 10.0 * np.arange(1, N + 1)
RATES = 2.0 * RNG.standard_normal((N, 3))  # deg/s
FORCE = np.array([0.1, 0.05, -0.99]) + 0.01 * RNG.standard_normal((N, 3))  # g
NAMES = ["stamp", "wx", "wy", "wz", "fx", "fy", "fz"]
MAP = {
    "format": "csv",
    "axes": "FRD",
    "site": [34.0, 108.0, 400.0],
    "time": {"column": "stamp", "unit": "ms"},
    "gyro": {"columns": ["wx", "wy", "wz"], "unit": "deg/s"},
    "accel": {"columns": ["fx", "fy", "fz"], "unit": "g"},
}
TABLE = np.column_stack([MS, RATES, FORCE])


def write(folder, rows=TABLE, names=NAMES, **changes):
    table(folder / "imu.csv", rows, names, changes.get("delimiter", ","))
    mapping = {key: value for key, value in {**MAP, **changes}.items() if value is not None}
    (folder / "imu.json").write_text(json.dumps(mapping))
    return folder / "imu.csv"


def table(path, rows, names=(), delimiter=","):
    header = [delimiter.join(names)] if names else []
    lines = [delimiter.join(repr(float(x)) for x in row) for row in rows]
    path.write_text("\n".join(header + lines) + "\n")


def test_rates_are_held_over_the_sample_they_end(tmp_path):
    found = load(write(tmp_path))
    assert (found.rate_hz, found.t0, len(found.dtheta)) == (HZ, pytest.approx(1.0), N)
    assert_allclose(found.dtheta, np.radians(RATES) @ made.SWAP.T / HZ, rtol=1e-12)
    assert_allclose(found.dvel, FORCE @ made.SWAP.T * 9.80665 / HZ, rtol=1e-12)


def test_trapezoid(tmp_path):
    """Of a rate that grows evenly the increments are exact; held ones lag by half a sample."""
    t = MS / 1000
    rows = TABLE.copy()
    rows[:, 1:4] = np.outer(t, [1.0, -2.0, 3.0])
    exact = np.radians(np.outer(t[1:] ** 2 - t[:-1] ** 2, [0.5, -1.0, 1.5])) @ made.SWAP.T
    found = load(write(tmp_path, rows, rates="trapezoid"))
    assert_allclose(found.dtheta[1:], exact, rtol=1e-10)
    held = load(write(tmp_path, rows, rates="hold"))
    assert_allclose(held.dtheta[1:] - exact, np.radians(np.full((N - 1, 3), [0.5, -1.0, 1.5])) @ made.SWAP.T / HZ**2)


@pytest.mark.parametrize(
    ("gyro", "scale"),
    [("rad", 1.0), ("deg", np.pi / 180), ("arcsec", np.pi / 648000), ("rad/s", 0.01), ("deg/h", np.pi / 648000 / 100)],
)
@pytest.mark.parametrize(("accel", "force"), [("m/s", 1.0), ("m/s2", 0.01), ("mg", 9.80665e-5), ("g", 0.0980665)])
def test_units(tmp_path, gyro, scale, accel, force):
    rows = TABLE.copy()
    rows[:, 1:4] = 1e-5 * RATES / scale
    rows[:, 4:] = FORCE * 0.098 / force
    mapping = {"gyro": {**MAP["gyro"], "unit": gyro}, "accel": {**MAP["accel"], "unit": accel}}
    found = load(write(tmp_path, rows, **mapping))
    assert_allclose(found.dtheta, 1e-5 * RATES @ made.SWAP.T, rtol=1e-11)
    assert_allclose(found.dvel, 0.098 * FORCE @ made.SWAP.T, rtol=1e-11)


def test_columns_by_number_in_any_order_without_a_header(tmp_path):
    rows = np.column_stack([FORCE[:, ::-1], np.ones(N), RATES, MS])
    spec = {"gyro": {"columns": [5, 6, 7], "unit": "deg/s"}, "accel": {"columns": [3, 2, 1], "unit": "g"}}
    found = load(write(tmp_path, rows, (), time={"column": 8, "unit": "ms"}, **spec))
    assert_array_equal(found.dvel, load(_other(tmp_path)).dvel)
    headed = load(write(tmp_path, rows, list("abcdefgh"), header=True, time={"column": 8, "unit": "ms"}, **spec))
    assert_array_equal(headed.dvel, found.dvel)


def _other(folder):
    (folder / "other").mkdir(exist_ok=True)
    return write(folder / "other")


@pytest.mark.parametrize("rates", ["hold", "trapezoid"])
def test_a_rate_behind_a_gap_is_held_for_one_sample(tmp_path, rates):
    """What the base did in the gap is not known; by trapezoid the sample behind it has no neighbour either."""
    found = load(write(tmp_path, np.delete(TABLE, slice(300, 320), axis=0), rates=rates))
    assert [gap.samples for gap in found.gaps] == [20]
    assert_allclose(found.dvel[320], _dvel()[320], rtol=1e-12)
    whole = load(write(tmp_path, rates=rates))
    assert_allclose(found.dvel[321:], whole.dvel[321:], rtol=1e-12)
    assert_allclose(found.dvel[:300], whole.dvel[:300], rtol=1e-12)


def test_files_of_other_editors(tmp_path):
    """A byte order mark, carriage returns, quoted names, comments and blank lines."""
    path = write(tmp_path)
    lines = path.read_text().splitlines()
    text = "\r\n".join(['"' + '","'.join(NAMES) + '"', "", "# a comment, with commas", *lines[1:], ""])
    path.write_bytes(b"\xef\xbb\xbf" + text.encode() + b"\r\n")
    assert_allclose(load(path).dvel, _dvel(), rtol=1e-12)
    path.write_bytes(path.read_bytes().replace(lines[10].encode(), b"1,2"))
    with pytest.raises(ValueError, match="line 13 has 2 columns; allowed: 7"):
        load(path)


@pytest.mark.parametrize("delimiter", [";", "\t", "|"])
def test_delimiters(tmp_path, delimiter):
    assert_allclose(load(write(tmp_path, delimiter=delimiter)).dvel, _dvel(), rtol=1e-12)


def _dvel():
    return FORCE[:, [1, 0, 2]] * [1, 1, -1] * 9.80665 * 0.01


def test_a_rate_instead_of_times(tmp_path):
    found = load(write(tmp_path, time=None, rate_hz=HZ))
    assert (found.t0, found.rate_hz) == (0.0, HZ)
    assert_allclose(found.dvel, _dvel(), rtol=1e-12)


T = 1.0 + np.arange(1, 6)
ANGLES = np.column_stack([np.linspace(2, 350, 5), np.linspace(-60, 60, 5), np.linspace(-150, 150, 5)])


def test_fixes(tmp_path):
    rows = np.column_stack(
        [T, np.full(5, 34.1), np.full(5, 108.2), np.full(5, 401.0), np.tile([1.0, 2.0, 3.0], (5, 2))]
    )
    table(tmp_path / "gnss.csv", rows, ["t", *"abcdefghi"])
    spec = {
        "file": "gnss.csv",
        "time": {"column": "t"},
        "position": {"columns": ["a", "b", "c"], "unit": "deg"},
        "velocity": {"columns": ["d", "e", "f"], "frame": "NED"},
        "velocity_std": {"columns": ["g", "h", "i"], "frame": "ENU"},
    }
    found = load(write(tmp_path, gnss=spec, site=None, lever_arm_m=[1, 2, 3]))
    assert_array_equal(found.gnss.vel[0], [2, 1, -3])
    assert_array_equal(found.gnss.vel_std[0], [1, 2, 3])
    assert found.gnss.pos_std is None
    assert_allclose(found.site.pos, [np.radians(34.1), np.radians(108.2), 401.0])
    assert_array_equal(found.lever_arm, [2, 1, -3])


def reference(tmp_path, columns, unit=None, frame=None, **changes):
    table(tmp_path / "ref.csv", np.column_stack([T, columns]), ["t", *"abcd"[: columns.shape[1]]])
    attitude = {"columns": list("abcd"[: columns.shape[1]])}
    attitude |= {key: value for key, value in (("unit", unit), ("frame", frame)) if value}
    spec = {"file": "ref.csv", "time": {"column": "t"}, "attitude": attitude}
    q = load(write(tmp_path, reference=spec, **changes)).reference.q_nb
    return Rotation.from_quat(q, scalar_first=True).as_matrix()


def test_attitudes_against_scipy(tmp_path):
    """Yaw, pitch, roll of Forward-Right-Down in North-East-Down, as angles and as a quaternion of either frame."""
    C = Rotation.from_euler("ZYX", ANGLES, degrees=True)
    expected = made.SWAP @ C.as_matrix() @ made.SWAP.T
    assert_allclose(reference(tmp_path, ANGLES, "deg"), expected, atol=1e-14)
    assert_allclose(reference(tmp_path, np.radians(ANGLES), "rad"), expected, atol=1e-14)
    assert_allclose(reference(tmp_path, C.as_quat(scalar_first=True), frame="NED"), expected, atol=1e-14)
    turned = Rotation.from_matrix(made.SWAP @ C.as_matrix())
    assert_allclose(reference(tmp_path, turned.as_quat(scalar_first=True), frame="ENU"), expected, atol=1e-14)


def test_a_quaternion_is_of_the_axes_of_the_file(tmp_path):
    """Backward, right, up: a matrix that is not its own inverse, as those of Forward-Right-Down are."""
    C = Rotation.from_euler("ZYX", ANGLES, degrees=True)
    found = reference(tmp_path, C.as_quat(scalar_first=True), frame="ENU", axes="BRU")
    back, right, up = np.moveaxis(C.as_matrix(), -1, 0)  # axes of the body in East-North-Up
    assert_allclose(found, np.stack([right, -back, up], axis=-1), atol=1e-14)


def cell(row, column, text):
    def change(path):
        lines = path.read_text().splitlines()
        fields = lines[row - 1].split(",")
        fields[column - 1 : column] = [text] if text is not None else []
        lines[row - 1] = ",".join(fields)
        path.write_text("\n".join(lines) + "\n")

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (cell(17, 3, "nan"), "line 17, column 3 is 'nan'; allowed: a finite number"),
        (cell(17, 3, ""), "line 17, column 3 is ''"),
        (cell(17, 3, "2.5e"), "line 17, column 3 is '2.5e'"),
        (cell(17, 3, "1,2"), "line 17 has 8 columns; allowed: 7"),
        (cell(17, 3, None), "line 17 has 6 columns; allowed: 7"),
        (cell(601, 3, None), r"line 601 has 6 columns; allowed: 7 \(the last line: a truncated file\?\)"),
        (cell(17, 1, "1140.0"), "time does not increase at line 17: 1.14 s after 1.15 s"),
        (cell(1, 2, "gx"), "unknown column of gyro 'wx'; did you mean 'wy'|unknown column of gyro 'wx'"),
        (
            lambda path: path.write_text("stamp,wx,wy,wz,fx,fy,fz\n" + "0.1,0,0,0,0,0\n" * 9),
            r"line 2 has 6 columns .delimiter ','., the header 7 names; allowed: a name for every column",
        ),
        (cell(17, 3, "0;5"), "line 17, column 3 is '0;5'; allowed: a finite number$"),
        (lambda path: path.write_text("stamp,wx,wy,wz,fx,fy,fz\n"), "no rows of numbers"),
        (lambda path: path.write_text(""), "no rows of numbers"),
        (lambda path: path.write_bytes(bytes(range(256)) * 9), "a NUL byte in line 1"),
    ],
)
def test_malformed(tmp_path, change, message):
    path = write(tmp_path)
    change(path)
    with pytest.raises(ValueError, match=rf"imu\.csv: .*({message})"):
        load(path)


@pytest.mark.parametrize(
    ("unit", "factor", "guess"),
    [
        ("g", 9.80665, r"m/s\^2 given as g"),
        ("m/s2", 1.0, r"g given as m/s\^2"),
        ("m/s", 9.8, r"rates \(m/s\^2\) given as increments"),
        ("m/s", 1.0, r"rates in g given as increments"),
        ("m/s2", 0.098, r"increments \(m/s\) given as rates"),
        ("m/s2", 1000.0, r"mg given as m/s\^2"),
        ("g", 3.0, "Wrong unit, or wrong columns"),
        ("m/s2", 0.002, "acceleration without gravity"),
        ("g", 0.0, "Nothing but zeros"),
    ],
)
def test_wrong_units_of_force(tmp_path, unit, factor, guess):
    rows = TABLE * [1, 1, 1, 1, factor, factor, factor]
    with pytest.raises(ValueError, match=rf"imu\.csv: specific force is .* m/s\^2 .*allowed: 5 to 20\. ?.*{guess}"):
        load(write(tmp_path, rows, accel={**MAP["accel"], "unit": unit}))


def test_wrong_units_of_rate(tmp_path):
    """Angles that come out too large are seen; deg/s of a still base given as rad/s are not."""
    rows = TABLE * [1, 100, 100, 100, 1, 1, 1]
    load(write(tmp_path, rows))
    with pytest.raises(ValueError, match=r"turns by up to .* rad/s \(median\); allowed"):
        load(write(tmp_path, rows + np.array([0, 500, 0, 0, 0, 0, 0]), gyro={**MAP["gyro"], "unit": "rad/s"}))
    with pytest.raises(ValueError, match=r"turns by up to 0\.2.* and by 20"):
        load(write(tmp_path, TABLE + np.array([0, 20, 0, 0, 0, 0, 0]), gyro={**MAP["gyro"], "unit": "rad/s"}))
    with pytest.raises(ValueError, match="rad in one sample"):
        load(write(tmp_path, rows, gyro={**MAP["gyro"], "unit": "rad"}))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"axes": None}, "no axes; allowed: a mapping with axes, columns and units, imu.json"),
        ({"axes": "FRU"}, "axes = 'FRU'; allowed: .*right-handed"),
        ({"axse": "FRD"}, "unknown setting of a mapping 'axse'; did you mean 'axes'"),
        ({"time": None}, "neither time nor rate_hz"),
        ({"gyro": None}, "imu without 'gyro'"),
        ({"gyro": ["wx", "wy", "wz"]}, r"gyro of the mapping of imu.csv = \['wx'"),
        ({"gyro": {"columns": ["wx", "wy"], "unit": "deg"}}, r"allowed: \{\"columns\": \[3 of them\], \"unit\""),
        ({"gyro": {"columns": ["wx", "wy", 8], "unit": "deg"}}, "a whole number from 1 to 7"),
        ({"gyro": {**MAP["gyro"], "unit": "deg/sec"}}, "unknown unit of gyro 'deg/sec'; did you mean 'deg/s'"),
        (
            {"gyro": {**MAP["gyro"], "units": "deg"}},
            "unknown key of gyro in the mapping of imu.csv 'units'; did you mean",
        ),
        ({"accel": {"columns": ["fx", "fy", "fz"]}}, "unknown unit of accel None"),
        ({"time": {"column": "stamp", "unit": "min"}}, "unknown unit of time 'min'"),
        ({"rates": "held"}, "unknown way to integrate rates 'held'"),
        ({"rate_hz": -1}, "rate_hz = -1; allowed: a positive number of Hz"),
        ({"site": [1, 2]}, r"site = \[1, 2\]; allowed: \[latitude deg"),
        ({"site": [95, 2, 3]}, "site is .* at its mapping; allowed: latitude within 89.9"),
        ({"format": "csw"}, "unknown format 'csw'; did you mean 'csv'"),
        ({"gnss": {"file": "g.csv"}}, "gnss without 'time'"),
        ({"gnss": {"fil": "g.csv"}}, "unknown key of gnss in the mapping of imu.csv 'fil'; did you mean 'file'"),
        ({"gnss": "g.csv"}, "g.csv', which gnss of the mapping of imu.csv names"),
        ({"gnss": "imu.csv"}, "no fixes that describe themselves; allowed: an object of file, time"),
        ({"delimiter": ", "}, "delimiter = ', '; allowed: one character; a space"),
    ],
)
def test_bad_mappings(tmp_path, change, message):
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        load(write(tmp_path, **change))


def test_mappings_that_are_no_json(tmp_path):
    path = write(tmp_path)
    (tmp_path / "imu.json").write_text('{"axes": "FRD",\n "site": }\n')
    with pytest.raises(ValueError, match=r"imu\.json: line 2 is no JSON"):
        load(path)
    (tmp_path / "imu.json").write_text("[1]")
    with pytest.raises(ValueError, match="a list; allowed: a JSON object"):
        load(path)
    (tmp_path / "imu.json").write_text("{}")
    with pytest.raises(
        ValueError, match=r"no file named; allowed: a mapping with \"file\", or what it describes: imu.csv$"
    ):
        load(tmp_path / "imu.json")


def test_where_a_mapping_may_be(tmp_path):
    """Beside the file, given by name or as keys, or in the file's place; single keys replace its own."""
    path = write(tmp_path)
    usual = load(path).dvel
    mapping = (tmp_path / "imu.json").rename(tmp_path / "other.json")
    with pytest.raises(ValueError, match="no axes"):
        load(path)
    assert_array_equal(load(path, mapping=mapping).dvel, usual)
    assert_array_equal(load(path, mapping=MAP).dvel, usual)
    flat = load(path, mapping=MAP, axes="RFU")
    assert_allclose(flat.dvel @ made.SWAP.T, usual)
    mapping.write_text(json.dumps({**MAP, "file": "imu.csv"}))
    assert_array_equal(load(mapping).dvel, usual)
    mapping.write_text(json.dumps({**MAP, "file": "gone.csv"}))
    with pytest.raises(FileNotFoundError, match=r"gone\.csv', which other\.json names"):
        load(mapping)


def test_keys_that_a_format_does_not_take(tmp_path):
    from sins_env.recordings import save

    save(made.recording(), tmp_path / "x.npz")
    with pytest.raises(ValueError, match="unknown key of a mapping of npz files 'site'"):
        load(tmp_path / "x.npz", site=[1, 2, 3])
