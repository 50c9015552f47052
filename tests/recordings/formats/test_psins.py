"""PSINS files: .imu text and .mat, made here by the rules of its own sources, which are named at each."""

import numpy as np
import pytest
import scipy.io
from numpy.testing import assert_allclose, assert_array_equal
from oracles import made

from sins_env.recordings import load, save

HEAD = """% PSINS-format SIMU log file. (DO NOT EDIT!)
% 2014-03-21 17:31:51  by Yan Gongmin

0.000000 0.000000 -90.600000 0.000000 0.000000 0.000000{end}
34.24604800 108.90966400 380.000 5.00000000 10.00000000 9.780327{end}
0.100000 0.200000 0.300000 125.000 125.000 250.000{end}

"""
COUNTS = np.column_stack([np.arange(300) % 7, -np.arange(300) % 5, np.ones(300), np.zeros((300, 2)), np.full(300, 40)])


def write(path, counts=COUNTS, head=HEAD):
    with path.open("w") as stream:
        stream.write(head.format(end=" 0" * (counts.shape[1] - 6)))
        np.savetxt(stream, counts, fmt="%d")
    return path


def test_imu_as_imufile_m_reads_it(tmp_path):
    """base/io/imufile.m: counts by arcsec and by ug s of the file's own g; sample k ends at t0 + k ts."""
    found = load(write(tmp_path / "x.imu"))
    assert (found.rate_hz, found.t0, found.end) == (100.0, 5.0, 8.0)
    sec, ug = np.pi / 180 / 3600, 1e-6 * 9.780327
    assert_allclose(found.dtheta, COUNTS[:, :3] * [0.1 * sec, 0.2 * sec, 0.3 * sec], rtol=1e-14)
    assert_allclose(found.dvel, COUNTS[:, 3:] * [125 * ug, 125 * ug, 250 * ug], rtol=1e-14)
    assert_allclose(found.site.pos, [np.radians(34.246048), np.radians(108.909664), 380.0])
    assert found.gnss is found.reference is None


def test_steps_of_time_in_microseconds(tmp_path):
    """imufile.m: the seventh column, times 1e-6, is what a step exceeds the interval by; five samples are missing."""
    extra = np.zeros((300, 1))
    extra[100], extra[200], extra[201] = 50_000, 900, -900
    found = load(write(tmp_path / "x.imu", np.hstack([COUNTS, extra])))
    assert [(gap.start, gap.end, gap.samples) for gap in found.bridged] == [
        (pytest.approx(6.0), pytest.approx(6.05), 5)
    ]
    assert len(found.dtheta) == 305
    assert_allclose(found.dvel[105, 2], 40 * 250e-6 * 9.780327)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("SIMU", "IMU", "line 1 does not say PSINS and SIMU"),
        ("34.24604800", "94.0", r"latitude, longitude, height is .* at line 5; allowed: latitude within 89.9"),
        ("10.00000000", "0.0", "sampling interval is 0 in line 5; allowed: 1e-06 to 10"),
        ("9.780327", "1.0", "g is 1 in line 5; allowed: 9 to 10"),
        ("0.200000", "-0.2", "scale factors are .* in line 6; allowed: positive"),
        ("\n0 0 1 0 0 40\n", "\n0 0 1 0 0\n", "line 8 has 5 columns; allowed: 6"),
        ("\n0 0 1 0 0 40\n", "\n0 0 1 0 x 40\n", "line 8, column 5 is 'x'; allowed: a finite number"),
        ("\n0 0 1 0 0 40\n", "\n0 0 nan 0 0 40\n", "line 8, column 3 is 'nan'"),
        ("250.000", "250000.0", r"specific force is 9780 m/s\^2 .* Looks like g given as mg|mg given as g"),
        ("0.100000", "1e8", r"turns by up to .* Degrees given as radians"),
    ],
)
def test_malformed_imu(tmp_path, old, new, message):
    path = write(tmp_path / "x.imu")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ValueError, match=rf"x\.imu: {message}"):
        load(path)


def test_truncated_imu(tmp_path):
    path = write(tmp_path / "x.imu")
    content = path.read_bytes()
    for length, message in (
        (0, "does not say"),
        (60, "no rows"),
        (170, "2 rows|columns"),
        (len(content) - 4, "truncated"),
    ):
        path.write_bytes(content[:length])
        with pytest.raises(ValueError, match=message):
            load(path)


def a2mat(att):
    """base/base0/a2mat.m."""
    (si, sj, sk), (ci, cj, ck) = np.sin(att), np.cos(att)
    return np.array(
        [
            [cj * ck - si * sj * sk, -ci * sk, sj * ck + si * cj * sk],
            [cj * sk + si * sj * ck, ci * ck, sj * sk - si * cj * ck],
            [-ci * sj, si, ci * cj],
        ]
    )


RNG = np.random.default_rng(2)
T = 50.0 + 0.01 * np.arange(1, 501)
IMU = np.column_stack([1e-4 * RNG.standard_normal((500, 3)), np.tile([0.001, 0.002, 0.098], (500, 1)), T])
ATT = np.column_stack([np.linspace(-1.5, 1.5, 50), np.linspace(-3, 3, 50), np.linspace(-3.1, 3.1, 50)])
POS = np.column_stack([np.full(50, 0.6), np.full(50, 1.9), np.arange(50.0)])
AVP = np.column_stack([ATT, RNG.standard_normal((50, 3)), POS, 50.0 + 0.1 * np.arange(1, 51)])
GPS = AVP[9::10, 3:]


def mat(path, **variables):
    scipy.io.savemat(path, {name: value for name, value in {"imu": IMU, **variables}.items() if value is not None})
    return path


def test_mat(tmp_path):
    found = load(mat(tmp_path / "x.mat", avp=AVP, gps=GPS, lever=[[1.0], [2.0], [3.0]]))
    assert (found.rate_hz, found.t0) == (100.0, pytest.approx(50.0))
    assert_array_equal(found.dtheta, IMU[:, :3])
    assert_array_equal(found.dvel, IMU[:, 3:6])
    assert_array_equal(found.gnss.vel, GPS[:, :3])
    assert_array_equal(found.gnss.pos, GPS[:, 3:6])
    assert_array_equal(found.site.pos, GPS[0, 3:6])
    assert_array_equal(found.lever_arm, [1, 2, 3])
    C = [a2mat(att) for att in ATT]
    from sins_env.attitude import to_dcm

    assert_allclose(to_dcm(found.reference.q_nb), C, atol=1e-14)
    assert_array_equal(found.reference.vel, AVP[:, 3:6])


def test_written_attitude_is_psins(tmp_path):
    first = made.recording()
    save(first, tmp_path / "x.mat")
    avp = scipy.io.loadmat(tmp_path / "x.mat")["avp"]
    from sins_env.attitude import to_dcm

    assert_allclose([a2mat(row[:3]) for row in avp], to_dcm(first.reference.q_nb), atol=1e-14)
    assert_array_equal(avp[:, 9], first.reference.t_s)


def test_a_trajectory_struct_and_a_start(tmp_path):
    """base/io/trjfile.m: trj.imu, trj.avp, trj.avp0, trj.ts."""
    trj = {"imu": IMU, "avp": AVP, "avp0": AVP[0, :9, None], "ts": 0.01}
    found = load(mat(tmp_path / "x.mat", imu=None, trj=trj))
    assert_array_equal(found.dvel, IMU[:, 3:6])
    assert_allclose(found.site.pos, AVP[0, 6:9], rtol=1e-15)
    assert len(found.reference.t_s) == 50
    found = load(mat(tmp_path / "y.mat", gps=GPS[:, 3:], pos0=POS[:1]))
    assert found.gnss.vel is None
    assert load(tmp_path / "y.mat", velocity_from_positions=True).gnss.vel.shape == (5, 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"imu": None}, "no variable 'imu'; variables there: pos0"),
        ({"imu": IMU[:, :6]}, r"imu is float64 of shape \(500, 6\); allowed: numbers, \(n, 7\)"),
        ({"imu": "text"}, r"imu is <U4 of shape \(1,\)"),
        ({"imu": np.where(np.arange(7) == 2, np.nan, IMU)}, "imu is not finite at row 1, column 3"),
        ({"imu": IMU[::-1]}, r"imu\(:,7\) does not increase at row 2 of imu: 54.99 s after 55 s"),
        (
            {"imu": np.repeat(IMU, 2, axis=0)},
            r"imu\(:,7\) does not increase at row 2 of imu: 500 repeated stamps, 50.01 s, 50.02 s,",
        ),
        ({"imu": IMU * [1, 1, 1, 100, 100, 100, 1]}, r"specific force is 980.3 m/s\^2 .* Looks like rates"),
        (
            {"imu": IMU * [1, 1, 1, 0.1, 0.1, 0.1, 1]},
            r"specific force is 0.9803 m/s\^2 .* Looks like g given as m/s\^2",
        ),
        ({"imu": IMU * [1e5, 1, 1, 1, 1, 1, 1]}, "turns by up to .* in one sample"),
        ({"avp": AVP[:, :9]}, r"avp is float64 of shape \(50, 9\); allowed: numbers, \(n, 10\)"),
        ({"avp": AVP[::-1]}, "avp time does not increase at row 2 of avp"),
        ({"gps": np.degrees(GPS)}, "gps is .* at row 1 of gps; allowed: latitude within 89.9 deg"),
        ({"ts": 0.0}, "ts = 0; allowed: a positive step in s|ts = 0.0"),
        ({"pos0": None}, "no place on the earth"),
    ],
)
def test_malformed_mat(tmp_path, change, message):
    with pytest.raises(ValueError, match=rf"x\.mat: {message}"):
        load(mat(tmp_path / "x.mat", **{"pos0": POS[:1], **change}))


@pytest.mark.parametrize("share", [0.0, 0.005, 0.3, 0.99])
def test_truncated_mat(tmp_path, share):
    path = mat(tmp_path / "x.mat", pos0=POS[:1])
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ValueError, match=r"x\.mat: not a readable \.mat file"):
        load(path)


def test_damaged_mat(tmp_path):
    """Compressed variables, which MATLAB and this package write, have checksums: whatever is wrong is one ValueError."""
    path = tmp_path / "x.mat"
    save(made.recording(), path)
    content = path.read_bytes()
    assert content[128:132] == b"\x0f\x00\x00\x00"  # a compressed element
    rng = np.random.default_rng(0)
    for place in rng.integers(136, 50_000, 3):
        damaged = bytearray(content)
        damaged[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(damaged)
        with pytest.raises(ValueError, match=r"x\.mat: not a readable \.mat file"):
            load(path)


def test_hdf5_mat(tmp_path):
    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    (tmp_path / "x.mat").write_bytes(head + bytes(1000))
    with pytest.raises(ValueError, match=r"MATLAB 7\.3 \(HDF5\); allowed: save\(\.\.\., '-v7'\)"):
        load(tmp_path / "x.mat")
