"""KF-GINS text files, written here by hand as its README says, against scipy's rotations."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles import made
from scipy.spatial.transform import Rotation

from sins_env.recordings import load, save

N, RATE, T0 = 1000, 200.0, 456_300.0
RNG = np.random.default_rng(1)
SOW = T0 + np.arange(1, N + 1) / RATE
FRD = np.column_stack([SOW, 1e-4 * RNG.standard_normal((N, 3)), np.tile([0.002, -0.004, -9.79 / RATE], (N, 1))])
FIX_T = T0 + np.arange(1, 6)
FIXES = np.column_stack([FIX_T, np.full((5, 1), 30.44), np.full((5, 1), 114.47), 20.0 + np.arange(5)])
STD = np.tile([0.01, 0.02, 0.03], (5, 1))
NED = np.tile([1.0, 2.0, 3.0], (5, 1))
RPY = np.column_stack([np.linspace(-170, 170, 5), np.linspace(-80, 85, 5), np.linspace(1, 359, 5)])
TRUTH = np.column_stack([np.zeros(5), FIXES, NED, RPY])


def write(folder, gnss=None, truth=None, imu=FRD, delimiter=" ", **mapping):
    np.savetxt(folder / "imu.txt", imu, fmt="%.15g", delimiter=delimiter)
    for name, rows in (("gnss", gnss), ("truth", truth)):
        if rows is not None:
            np.savetxt(folder / f"{name}.txt", rows, fmt="%.15g")
            mapping["reference" if name == "truth" else name] = f"{name}.txt"
    (folder / "imu.json").write_text(json.dumps(mapping))
    return folder / "imu.txt"


def test_forward_right_down_becomes_right_forward_up(tmp_path):
    found = load(write(tmp_path, site=[30.0, 114.0, 20.0]))
    assert (found.rate_hz, found.t0) == (RATE, pytest.approx(T0, abs=1e-9))
    assert_allclose(found.dtheta, FRD[:, 1:4] @ made.SWAP.T, rtol=1e-12)
    assert_allclose(found.dvel, FRD[:, 4:] @ made.SWAP.T, rtol=1e-12)
    assert_allclose(found.site.pos, [np.radians(30), np.radians(114), 20.0])
    assert found.gnss is found.reference is found.lever_arm is None


@pytest.mark.parametrize("delimiter", [" ", "\t", ",", ", ", " , "])
def test_separators_of_its_loader(tmp_path, delimiter):
    found = load(write(tmp_path, site=[30.0, 114.0, 20.0], delimiter=delimiter))
    assert_allclose(found.dvel, FRD[:, 4:] @ made.SWAP.T, rtol=1e-12)


def test_rows_as_its_writer_prints_them(tmp_path):
    """src/fileio/filesaver.cc: "%-15.9lf " for each number; and the columns of its GNSS-RTK.txt."""
    path = write(tmp_path, np.hstack([FIXES, STD]))
    path.write_text("".join("".join(f"{x:<15.9f} " for x in row) + "\n" for row in FRD))
    line = "456302.000    30.4447858174   114.4718660799     21.102    0.010    0.009    0.019 \n"
    (tmp_path / "gnss.txt").write_text(line)
    found = load(path)
    assert_allclose(found.dtheta, FRD[:, 1:4] @ made.SWAP.T, atol=5.1e-10)
    assert_allclose(np.degrees(found.gnss.pos[0, :2]), [30.4447858174, 114.4718660799], rtol=1e-15)


def test_an_odometer_column_is_passed_over(tmp_path):
    found = load(write(tmp_path, imu=np.column_stack([FRD, np.ones(N)]), site=[30.0, 114.0, 20.0]))
    assert_allclose(found.dvel, FRD[:, 4:] @ made.SWAP.T, rtol=1e-12)


def test_fixes_with_and_without_velocity(tmp_path):
    found = load(write(tmp_path, np.hstack([FIXES, STD]), lever_arm_m=[0.136, -0.301, -0.184]))
    assert found.gnss.vel is found.gnss.vel_std is None
    assert_array_equal(found.gnss.pos_std[0], [0.02, 0.01, 0.03])  # East, North, Up of North, East, Down
    assert_allclose(found.gnss.pos[3], [np.radians(30.44), np.radians(114.47), 23.0])
    assert_allclose(found.lever_arm, [-0.301, 0.136, 0.184])
    assert_allclose(found.site.pos, found.gnss.pos[0])
    found = load(write(tmp_path, np.hstack([FIXES, NED, STD, 10 * STD])))
    assert_array_equal(found.gnss.vel, np.tile([2.0, 1.0, -3.0], (5, 1)))
    assert_array_equal(found.gnss.pos_std[0], [0.02, 0.01, 0.03])
    assert_allclose(found.gnss.vel_std[0], [0.2, 0.1, 0.3])


def test_truth_against_scipy(tmp_path):
    """C from Forward-Right-Down to North-East-Down turns yaw, pitch, roll about z, y, x; both ends are then swapped."""
    ref = load(write(tmp_path, truth=TRUTH)).reference
    C = Rotation.from_euler("ZYX", RPY[:, ::-1], degrees=True).as_matrix()
    expected = made.SWAP @ C @ made.SWAP.T
    assert_allclose(Rotation.from_quat(ref.q_nb, scalar_first=True).as_matrix(), expected, atol=1e-14)
    assert_array_equal(ref.vel[0], [2.0, 1.0, -3.0])
    assert_allclose(ref.pos[4], [np.radians(30.44), np.radians(114.47), 24.0])


def test_what_is_written_by_its_own_rules(tmp_path):
    """The files as KF-GINS would read them, against scipy."""
    first = made.recording(t0=1000.0)
    names = [path.name for path in save(first, tmp_path / "x.txt")]
    assert names == ["x.txt", "x_gnss.txt", "x_truth.txt", "x.json"]
    imu, gnss, truth = (np.loadtxt(tmp_path / name) for name in names[:3])
    assert_allclose(imu[:, 0], 1000.0 + np.arange(1, 2001) / 200, atol=1e-9)
    assert_array_equal(imu[:, 1:4] @ made.SWAP.T, first.dtheta)
    assert gnss.shape[1] == 13
    assert_array_equal(gnss[:, 4:7] @ made.SWAP.T, first.gnss.vel)
    assert (gnss[:, 7:] > 0).all()
    C = Rotation.from_euler("ZYX", truth[:, :7:-1], degrees=True).as_matrix()
    ours = Rotation.from_quat(first.reference.q_nb, scalar_first=True).as_matrix()
    assert_allclose(C, made.SWAP.T @ ours @ made.SWAP, atol=1e-13)
    assert np.all((truth[:, 10] >= 0) & (truth[:, 10] < 360))
    mapping = json.loads((tmp_path / "x.json").read_text())
    assert_allclose(mapping["lever_arm_m"], [-0.2, 0.3, -1.1])


def test_velocities_from_positions_are_made_when_asked_for(tmp_path):
    """A vehicle on a circle of 100 m: differences over 2 s see its speed to 0.02 %."""
    t = T0 + np.arange(1, 6)
    angle = 0.02 * (t - T0)
    north, east = 100 * np.sin(angle), 100 * np.cos(angle)
    metre = np.degrees(1 / 6_351_000.0), np.degrees(1 / (6_383_600.0 * np.cos(np.radians(30))))
    fixes = np.column_stack([t, 30 + north * metre[0], 114 + east * metre[1], np.full(5, 20.0), STD])
    path = write(tmp_path, fixes)
    assert load(path).gnss.vel is None
    vel = load(path, velocity_from_positions=True).gnss.vel
    expected = np.column_stack([-2 * np.sin(angle), 2 * np.cos(angle), 0 * t])
    assert_allclose(vel[1:-1], expected[1:-1], atol=3e-3)
    assert_allclose(vel[[0, -1]], expected[[0, -1]], atol=0.03)  # one-sided at the ends
    write(tmp_path, np.delete(fixes, 2, axis=0), velocity_from_positions=True)
    assert_allclose(load(path).gnss.t_s, np.delete(t, 2))  # nothing is differenced across the missing fix
    write(tmp_path, fixes[::2], velocity_from_positions=True)
    assert len(load(path).gnss.t_s) == 3
    write(tmp_path, fixes[:1], velocity_from_positions=True)
    with pytest.raises(ValueError, match="no two in a row"):
        load(path)


def changed(rows, row, column, value):
    rows = rows.astype(object)
    rows[row, column] = value
    return rows


def lines(path, *edits):
    """Replace lines (from 1) of a file."""
    text = path.read_text().splitlines()
    for number, line in edits:
        text[number - 1] = line
    path.write_text("\n".join(text) + "\n")
    return path


def bad(tmp_path, number, line, **more):
    return lines(write(tmp_path, np.hstack([FIXES, STD]), TRUTH, **more), (number, line))


@pytest.mark.parametrize(
    ("number", "line", "message"),
    [
        (17, "456300.085 0 0 0 0 0", r"line 17 has 6 columns; allowed: 7$"),
        (17, "456300.085 0 0 0 0 0 0 0", r"line 17 has 8 columns; allowed: 7$"),
        (1000, "456305.0 0 0 0 0", r"line 1000 has 5 columns; allowed: 7 \(the last line: a truncated file\?\)"),
        (1, "456300.005 0 0", r"line 1 has 3 columns; allowed: 7, 8 or 9"),
        (17, "456300.085 0 nan 0 0 0 0", r"line 17, column 3 is 'nan'; allowed: a finite number"),
        (17, "456300.085 0 0 0 inf 0 0", r"line 17, column 5 is 'inf'"),
        (17, "456300.085 0 0 0 1,5e 0", r"line 17, column 6 is '5e'"),
        (17, "sow wx wy wz vx vy vz", r"line 17, column 1 is 'sow'"),
        (17, "456300.070 0 0 0 0 0 0", r"time does not increase at line 17: 456300.07 s after 456300.08 s"),
    ],
)
def test_malformed_imu(tmp_path, number, line, message):
    with pytest.raises(ValueError, match=rf"imu\.txt: .*{message}|imu\.txt: {message}"):
        load(bad(tmp_path, number, line))


def test_lines_are_counted_with_comments_and_blanks(tmp_path):
    path = write(tmp_path, site=[30, 114, 20])
    path.write_text("# sow\n\n" + path.read_text())
    assert len(load(path).dtheta) == N
    with pytest.raises(ValueError, match="line 19, column 2 is 'x'"):
        load(lines(path, (19, "456300.085 x 0 0 0 0 0")))


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("gnss", lambda r: r[:, :6], "line 1 has 6 columns; allowed: 7, 8, 13 or 14"),
        (
            "gnss",
            lambda r: changed(r, 2, 1, 95.0),
            r"position is \[ *95.* at line 3; allowed: latitude within 89.9 deg",
        ),
        ("gnss", lambda r: changed(r, 2, 0, T0 + 2), "time does not increase at line 3: 1 repeated stamp, 456302 s"),
        ("gnss", lambda r: changed(r, 2, 3, "nan"), "line 3, column 4 is 'nan'"),
        ("truth", lambda r: r[:, :10], "line 1 has 10 columns; allowed: 11"),
        ("truth", lambda r: changed(r, 4, 1, T0), r"time does not increase at line 5: 456300 s after 456304 s"),
        ("truth", lambda r: changed(r, 3, 9, 95.0), r"roll, pitch, yaw are .* at line 4; allowed: within 180, 90 and"),
    ],
)
def test_malformed_companions(tmp_path, name, change, message):
    rows = {"gnss": np.hstack([FIXES, STD]), "truth": TRUTH}
    path = write(tmp_path, **rows)
    np.savetxt(tmp_path / f"{name}.txt", change(rows[name]), fmt="%s")
    with pytest.raises(ValueError, match=rf"{name}\.txt: {message}"):
        load(path)


def test_two_clocks(tmp_path):
    fixes = np.hstack([FIXES, STD])
    fixes[:, 0] -= T0
    with pytest.raises(ValueError, match=r"fixes from 1 to 5 s, the IMU from 456300 to 456305 s; allowed: one clock"):
        load(write(tmp_path, fixes))


def test_a_new_week(tmp_path):
    """Seconds of the week begin again inside the file: time goes on."""
    imu = FRD.copy()
    imu[:, 0] = (imu[:, 0] - T0 + 604_797.5) % 604_800
    found = load(write(tmp_path, imu=imu, site=[30, 114, 20]))
    assert (len(found.dtheta), found.t0) == (len(FRD), pytest.approx(604_797.5))


def test_no_place_and_no_companion(tmp_path):
    with pytest.raises(ValueError, match=r'no place on the earth; allowed: site, gnss or reference .*\{"site": \[lat'):
        load(write(tmp_path))
    with pytest.raises(FileNotFoundError, match=r"gone\.txt', which the mapping of imu\.txt names"):
        load(_names(tmp_path, gnss="gone.txt"))
    with pytest.raises(ValueError, match="the name of a file beside it"):
        load(_names(tmp_path, gnss={"file": "x"}))


def _names(tmp_path, **mapping):
    path = write(tmp_path)
    (tmp_path / "imu.json").write_text(json.dumps(mapping))
    return path


def test_a_changed_companion_is_read_again(tmp_path):
    path = write(tmp_path, np.hstack([FIXES, STD]))
    assert load(path) is load(path)
    before = load(path)
    np.savetxt(tmp_path / "gnss.txt", np.hstack([FIXES[:3], STD[:3]]), fmt="%.15g")
    assert len(load(path).gnss.t_s) == 3
    assert len(before.gnss.t_s) == 5


def test_dropped_duplicates(tmp_path):
    imu = np.insert(FRD, [10, 500], FRD[[9, 499]] * [1, 2, 2, 2, 2, 2, 2], axis=0)
    path = write(tmp_path, imu=imu, site=[30, 114, 20])
    with pytest.raises(ValueError, match=r"line 11: 2 repeated stamps, 456300.05 s, 456302.5 s; allowed: .*drop_dupl"):
        load(path)
    found = load(path, drop_duplicates=True)
    assert_allclose(found.dvel, FRD[:, 4:] @ made.SWAP.T, rtol=1e-12)  # the first of each is kept
