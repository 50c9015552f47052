"""NovAtel logs, RTKLIB solutions, KITTI folders and NaveGo files, written here by their own rules, against plain NumPy."""

import json
import zlib

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles import made
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from sins_env.recordings import format_of, load, save

N, HZ = 200, 100.0
RNG = np.random.default_rng(9)
SOW = 1000.0 + np.arange(1, N + 1) / HZ
SITE = [48.1, 11.6, 520.0]
FSAS = (0.1 / 256 / 3600 * np.pi / 180, 0.05 / 32768)  # rad and m/s: OEM7 manual, RAWIMUSX
GYRO = np.rint(1000 * RNG.standard_normal((N, 3)))
FORCE = np.rint(np.array([20.0, -30.0, -9.81 / HZ / FSAS[1]]) + 10 * RNG.standard_normal((N, 3)))


def signed(text):
    """With NovAtel's checksum: the polynomial of CRC-32, from 0, bit by bit as its manual has it."""
    value = 0
    for byte in text[1:].encode():
        value ^= byte
        for _ in range(8):
            value = (value >> 1) ^ (0xEDB88320 if value & 1 else 0)
    return f"{text}*{value:08x}"


def raw(kind, sign=lambda text: text + "*9a8b7c6d"):
    """A line for each sample: z, -y, x of the accelerometers, then of the gyros."""
    rows = []
    for t, g, f in zip(SOW, GYRO.astype(int), FORCE.astype(int), strict=True):
        head = f"%{kind}A,2100,{t:.3f};" if "S" in kind else f"#{kind}A,COM1,0,60,FINESTEERING,2100,{t:.3f},0,0,1;"
        info = "00,13," if kind.endswith("X") else ""
        rows.append(sign(f"{head}{info}2100,{t:.9f},00000077,{f[2]},{-f[1]},{f[0]},{g[2]},{-g[1]},{g[0]}"))
    return rows


def log(folder, rows, name="span.ASC", **mapping):
    (folder / name).write_text("\r\n".join(rows) + "\r\n")
    return folder / name, {"axes": "RFU", "site": SITE, **mapping}


@pytest.mark.parametrize(
    ("kind", "mapping"),
    [
        ("RAWIMUS", {"imu": "imar fsas"}),
        ("RAWIMU", {"gyro": {"scale": FSAS[0], "unit": "rad"}, "accel": {"scale": FSAS[1]}}),
        ("RAWIMUSX", {}),
        ("RAWIMUX", {}),
    ],
)
@pytest.mark.parametrize("name", ["span.ASC", "span.txt", "span.log"])
def test_novatel_counts(tmp_path, kind, mapping, name):
    path, told = log(tmp_path, ["<OK", *raw(kind)], name, **mapping)
    found = load(path, mapping=told)
    assert (found.rate_hz, found.t0) == (HZ, pytest.approx(1000.0))
    assert_allclose(found.dtheta, GYRO * FSAS[0], rtol=1e-12)
    assert_allclose(found.dvel, FORCE * FSAS[1], rtol=1e-12)


def test_the_example_of_the_manual_weighs_one_g(tmp_path):
    """RAWIMUSX of an Epson G320N at 125 Hz: its accelerometers show gravity, and its gyros a tenth of a deg/s."""
    counts = "ea59fe00,329308016,-2706935,4508389,196192,417138,-1000837"
    rows = [f"%RAWIMUSXA,2209,{t:.3f};04,41,2209,{t:.6f},{counts}*00000000" for t in 491674 + np.arange(20) / 125]
    found = load(*log(tmp_path, rows)[:1], mapping=log(tmp_path, rows)[1], accept=["hung_sensor"])
    assert np.linalg.norm(found.dvel[5]) * 125 == pytest.approx(9.86, abs=0.01)
    assert np.linalg.norm(np.degrees(found.dtheta[5])) * 125 == pytest.approx(0.134, abs=0.001)


def test_a_damaged_line_is_a_missing_sample(tmp_path):
    rows = raw("RAWIMUSX", signed)
    assert zlib.crc32(b"") == 0
    rows[50] = rows[50].replace(",13,", ",14,")
    rows[-1] = rows[-1][:60]
    found = load(*log(tmp_path, rows)[:1], mapping=log(tmp_path, rows)[1])
    assert [(gap.samples, gap.start) for gap in found.bridged] == [(1, pytest.approx(1000.5))]
    assert len(found.dtheta) == N - 1


@pytest.mark.parametrize(
    ("kind", "mapping", "message"),
    [
        ("RAWIMUS", {}, r'allowed: "imu" in the mapping, .* \(the counts are gravity with IMAR-FSAS\), or "gyro"'),
        ("RAWIMUS", {"imu": "LN201"}, "unknown type of IMU 'LN201'; did you mean 'LN200'"),
        ("RAWIMUSX", {"axes": None}, "no axes; allowed: axes in the mapping; the accelerometers say that -z points up"),
        ("RAWIMUS", {"gyro": {"scale": 1e-9}}, r'accel = None; allowed: \{"scale": m/s per count\}'),
        ("RAWIMUS", {"imu": "IMAR-FSAS", "site": None}, "no place on the earth"),
    ],
)
def test_what_a_novatel_log_does_not_tell(tmp_path, kind, mapping, message):
    path, told = log(tmp_path, raw(kind), **mapping)
    with pytest.raises(ValueError, match=message):
        load(path, mapping={key: value for key, value in told.items() if value is not None})


def test_novatel_fixes_and_solution(tmp_path):
    rows = raw("RAWIMUSX")
    for t in (1001.0, 1002.0):
        head = f"COM1,0,60,FINESTEERING,2100,{t:.3f},00000000,0,1;"
        rows += [
            f"#BESTPOSA,{head}SOL_COMPUTED,SINGLE,48.1,11.6,473.0,47.0,WGS84,1.0,2.0,3.0,,0,0*0",
            f"#BESTVELA,{head}SOL_COMPUTED,DOPPLER,0,0,10.0,30.0,0.5,0*0",
            f"%INSPVASA,2100,{t:.3f};2100,{t:.9f},48.1,11.6,520.0,1.0,2.0,3.0,4.0,5.0,350.0,INS_SOLUTION_GOOD*0",
        ]
    rows.append("%INSPVASA,2100,1000.5;2100,1000.5,0,0,0,0,0,0,0,0,0,INS_INACTIVE*0")
    path, mapping = log(tmp_path, rows, site=None)
    found = load(path, mapping={"axes": "RFU"}, accept=("reference_attitude", "positions_and_velocities", "held_fixes"))
    assert_allclose(found.gnss.t_s, [1001, 1002])
    assert_allclose(found.gnss.pos[0], [np.radians(48.1), np.radians(11.6), 520.0])
    assert_allclose(found.gnss.vel[0], [5.0, 10 * np.cos(np.pi / 6), 0.5])
    assert_allclose(found.gnss.pos_std[0], [2.0, 1.0, 3.0])
    C = Rotation.from_quat(found.reference.q_nb[0], scalar_first=True)
    expected = Rotation.from_euler("ZXY", [-350.0, 5.0, 4.0], degrees=True)  # azimuth is clockwise, pitch about right
    assert (C * expected.inv()).magnitude() < 1e-12
    assert_allclose(found.reference.vel[0], [2.0, 1.0, 3.0])
    rows[-7] = rows[-7].replace("48.1", "x")
    with pytest.raises(ValueError, match="line 201 has no finite numbers in fields 3, 4"):
        load(log(tmp_path, rows)[0], mapping=mapping | {"site": SITE})


POS = """% program   : RTKPOST ver.2.4.3
% ref pos   : 48.1 11.6 520
%
%  {scale:<18} latitude(deg) longitude(deg) height(m) Q ns sdn(m) sde(m) sdu(m) sdne(m) sdeu(m) sdun(m) age(s) ratio{more}
"""


def pos(folder, times, scale="GPST", vel=False):
    more = "    vn(m/s)    ve(m/s)    vu(m/s)      sdvn     sdve     sdvu    sdvne    sdveu    sdvun" if vel else ""
    tail = "  0.1  0.2  0.3  0.01 0.02 0.03 0 0 0" if vel else ""
    rows = [
        f"{t}   48.100000000   11.600000000   520.0000   1  12   0.0100   0.0200   0.0300   0 0 0 0.00 99.9{tail}"
        for t in times
    ]
    (folder / "gnss.pos").write_text(POS.format(scale=scale, more=more) + "\n".join(rows) + "\n")
    return folder / "gnss.pos"


def imu(folder, t=SOW):
    rows = np.column_stack([t, np.zeros((N, 3)), np.tile([0, 0, -0.0981], (N, 1))])
    np.savetxt(folder / "imu.txt", rows, fmt="%.6f")
    return folder / "imu.txt"


@pytest.mark.parametrize(
    "times",
    [
        ["2020/04/05 00:16:41.000", "2020/04/05 00:16:42.000"],  # the Sunday that begins week 2100
        ["2100   1001.000", "2100   1002.000"],
    ],
)
@pytest.mark.parametrize("vel", [False, True])
def test_rtklib_fixes_go_with_seconds_of_the_week(tmp_path, times, vel):
    pos(tmp_path, times, vel=vel)
    gnss = load(imu(tmp_path), gnss="gnss.pos").gnss
    assert_allclose(gnss.t_s, [1001, 1002], atol=1e-6)
    assert_allclose(gnss.pos[1], [np.radians(48.1), np.radians(11.6), 520.0])
    assert_allclose(gnss.pos_std[0], [0.02, 0.01, 0.03])
    if vel:
        assert_allclose(gnss.vel[0], [0.2, 0.1, 0.3])
        assert_allclose(gnss.vel_std[0], [0.02, 0.01, 0.03])
    else:
        assert gnss.vel is gnss.vel_std is None


def test_rtklib_fixes_go_with_a_csv(tmp_path):
    pos(tmp_path, ["2100 1001.0", "2100 1002.0"])
    np.savetxt(tmp_path / "imu.csv", np.loadtxt(imu(tmp_path)), delimiter=",")
    mapping = {
        "axes": "FRD",
        "time": {"column": 1},
        "gyro": {"columns": [2, 3, 4], "unit": "rad"},
        "accel": {"columns": [5, 6, 7], "unit": "m/s"},
        "gnss": "gnss.pos",
    }
    (tmp_path / "imu.json").write_text(json.dumps(mapping))
    assert_allclose(load(tmp_path / "imu.csv").gnss.t_s, [1001, 1002], atol=1e-6)


def test_what_rtklib_files_do_not_serve_for(tmp_path):
    path = pos(tmp_path, ["2026/06/01 10:00:00.000", "2026/06/01 10:00:01.000"])
    with pytest.raises(ValueError, match=r'fixes of RTKLIB and no IMU data; allowed: .*"gnss": "gnss.pos"'):
        load(path)
    with pytest.raises(
        ValueError, match=r"fixes from 122400.* the IMU from 1000 to 1002 s; allowed: one clock for both"
    ):
        load(imu(tmp_path), gnss="gnss.pos")
    path.write_text(path.read_text().replace("10:00:01.000", "10:00:61.000"))
    with pytest.raises(ValueError, match=r"gnss\.pos: line 6, column 1 is '2026/06/01 10:00:61.000'; allowed: a date"):
        load(imu(tmp_path), gnss="gnss.pos")
    pos(tmp_path, ["2100 1001.0"], scale="JST")
    with pytest.raises(ValueError, match="times are in JST; allowed: GPST, UTC"):
        load(imu(tmp_path), gnss="gnss.pos")


def test_kitti_folder(tmp_path):
    """Yaw is counter-clockwise from east, and pitch positive with the front down."""
    folder = tmp_path / "oxts"
    (folder / "data").mkdir(parents=True)
    at = np.datetime64("2011-09-26T13:02:25.964389445") + np.arange(300) * np.timedelta64(10_000_000, "ns")
    (folder / "timestamps.txt").write_text("\n".join(str(t).replace("T", " ") for t in at) + "\n")
    rows = np.zeros((300, 30))
    rows[:, :3] = [49.0, 8.4, 116.0]
    rows[:, 3:6] = [0.02, -0.03, 0.5]  # roll, pitch, yaw
    rows[:, 6:11] = [1.0, 2.0, 0, 0, 0.1]
    C = Rotation.from_euler("ZYX", [0.5, -0.03, 0.02])  # Forward-Left-Up to East-North-Up
    rows[:, 11:14] = C.inv().apply([0, 0, 9.81])
    rows[:, 17:20] = 0.001 * RNG.standard_normal((300, 3))
    rows[:, 23:25] = [0.05, 0.02]
    for k, row in enumerate(rows):
        (folder / "data" / f"{k:010d}.txt").write_text(" ".join(map(repr, row.tolist())))
    found = load(folder / "timestamps.txt", accept=("positions_and_velocities", "held_fixes", "clock_offset", "axes"))
    assert found.rate_hz == pytest.approx(100.0, rel=1e-6)
    x, y, z = rows[:, 17:20].T
    assert_allclose(found.dtheta[1:], np.column_stack([-y, x, z])[1:] / 100, rtol=1e-4)
    up = Rotation.from_quat(found.reference.q_nb.copy(), scalar_first=True).apply(found.dvel.copy())
    assert_allclose(up * 100, np.tile([0, 0, 9.81], (300, 1)), atol=1e-3)
    forward = Rotation.from_quat(found.reference.q_nb[0], scalar_first=True).apply([0, 1, 0])
    assert_allclose(forward, C.apply([1, 0, 0]), atol=1e-12)
    assert_array_equal(found.gnss.vel[0], [2.0, 1.0, 0.1])
    (folder / "data" / "0000000007.txt").write_text("1 2 3")
    with pytest.raises(ValueError, match=r"0000000007\.txt: 3 fields; allowed: 30 finite numbers"):
        load(folder / "timestamps.txt", site=SITE)


def navego(path, **more):
    rates, force = 1e-4 * RNG.standard_normal((N, 3)), np.tile([0.1, -0.2, -9.8], (N, 1))
    one = np.ones((3, 1))
    structs = {
        "imu1": {"t": SOW[:, None], "wb": rates, "fb": force, "freq": 100.0},
        "gnss": {
            "t": [[1001.0], [1002.0]],
            "lat": 0.84 * one[:2],
            "lon": 0.2 * one[:2],
            "h": 520 * one[:2],
            "vel": [[1.0, 2.0, 3.0]] * 2,
            "stdm": [[1.0, 2.0, 3.0]],
            "larm": [[0.1], [0.2], [0.3]],
        },
        "ref": {"t": SOW[:, None], "roll": 0.01 + 0 * SOW, "pitch": 0.02 + 0 * SOW, "yaw": 0.7 + 0 * SOW},
    }
    savemat(path, structs | more)
    return path, rates, force


def test_navego_structs(tmp_path):
    path, rates, force = navego(tmp_path / "x.mat")
    found = load(path, accept=("positions_and_velocities", "held_fixes", "reference_attitude", "axes"))
    assert (found.rate_hz, found.t0) == (HZ, pytest.approx(1000.0))
    assert_allclose(found.dtheta * HZ, rates @ made.SWAP.T, rtol=1e-9)
    assert_allclose(found.dvel * HZ, force @ made.SWAP.T, rtol=1e-9)
    assert_array_equal(found.gnss.vel[1], [2.0, 1.0, -3.0])
    assert_array_equal(found.gnss.pos_std[1], [2.0, 1.0, 3.0])
    assert_allclose(found.gnss.pos[0], [0.84, 0.2, 520.0])
    assert_allclose(found.lever_arm, [0.2, 0.1, -0.3])
    C = Rotation.from_quat(found.reference.q_nb[0], scalar_first=True).as_matrix()
    frd = Rotation.from_euler("ZYX", [0.7, 0.02, 0.01]).as_matrix()
    assert_allclose(C, made.SWAP @ frd @ made.SWAP.T, atol=1e-12)
    other = {"imu2": {"t": SOW[:, None], "wb": rates, "fb": 1.01 * force}}
    navego(path, **other)
    with pytest.raises(ValueError, match=r'the IMUs imu1, imu2; allowed: one of them, as "imu" in the mapping'):
        load(path)


def test_they_are_only_read(tmp_path):
    with pytest.raises(ValueError, match="novatel is only read; allowed: csv, kfgins, npz, psins-imu, psins-mat"):
        save(made.recording(), tmp_path / "x.asc")
    assert format_of(tmp_path / "new.txt") == "kfgins"
    assert format_of(tmp_path / "new.mat") == "psins-mat"
