import os
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles import recorded as files

from sins_env import attitude
from sins_env.recordings import FORMATS, LAYOUTS, left_out, load, save, to_rfu


@pytest.fixture
def no_data(monkeypatch):
    monkeypatch.delenv("SINS_ENV_DATA", raising=False)


def test_counts_layout(tmp_path):
    recording = load(files.counts(tmp_path / "car.npz"))
    assert (recording.name, recording.rate_hz, recording.t0, recording.end) == ("car", 100.0, 0.0, 10.0)
    assert_allclose(recording.dtheta[7], 4.8e-7 * np.array([7, 107, 207]), rtol=1e-15)
    assert_allclose(recording.dvel[7], 1.2e-5 * np.array([3, 13, 7993]), rtol=1e-15)
    assert_allclose(recording.site.pos, [np.radians(34.2), np.radians(108.9), 380.0])
    assert recording.gnss is None
    assert recording.lever_arm is None
    t = recording.reference.t_s
    same = np.sum(recording.reference.q_nb * files.attitudes(t).as_quat(scalar_first=True), axis=-1)
    assert_allclose(np.abs(same), 1.0)
    assert recording.reference.vel is None
    assert recording.reference.pos is None


def test_increments_layout_is_turned_to_right_forward_up(tmp_path):
    path = files.increments(tmp_path / "drive.npz")
    raw, recording = np.load(path), load(path)
    assert (recording.rate_hz, recording.t0) == (200.0, -0.005)  # the increment at the first tag ends there
    x, y, z = raw["dtheta_rad"].T
    assert_array_equal(recording.dtheta, np.stack([y, -x, z], axis=-1))  # right, forward = -backward, up
    x, y, z = raw["dvel_mps"].T
    assert_array_equal(recording.dvel, np.stack([y, -x, z], axis=-1))
    assert_allclose(recording.lever_arm, [-0.528, -0.985, 2.021])
    C = attitude.to_dcm(recording.reference.q_nb)
    assert_allclose(C, files.attitudes(recording.reference.t_s).as_matrix(), atol=1e-14)
    # the same vector through either file or package ends up in the same place
    q = attitude.to_dcm(raw["ref_q_b2n_wxyz"])
    assert_allclose(C @ recording.dvel[:239, :, None], q @ raw["dvel_mps"][:239, :, None], atol=1e-15)
    assert_allclose(C @ recording.lever_arm, q @ raw["lever_arm_est_body_m"], atol=1e-14)


def test_fixes_and_reference_are_in_radians(tmp_path):
    recording = load(files.increments(tmp_path / "drive.npz"))
    assert_allclose(recording.gnss.t_s, 0.95 + np.arange(12)[: len(recording.gnss.t_s)])
    assert_allclose(recording.gnss.pos[0], [np.radians(34.0 + 0.95e-6), np.radians(108.8 - 0.95e-6), 400.95])
    assert_allclose(recording.gnss.vel[2], [2.95, -2.95, 0.0295])
    assert_allclose(recording.reference.pos[0], [np.radians(34.0 + 5e-8), np.radians(108.8 - 5e-8), 398.05])
    assert_allclose(recording.reference.vel[1], [0.1, -0.1, 0.01])
    assert_allclose(recording.site.pos, recording.gnss.pos[0])


@pytest.mark.parametrize(
    ("axes", "found"),
    [
        ("RFU", [1, 2, 3]),
        ("BRU", [2, -1, 3]),
        ("FRD", [2, 1, -3]),
        ("FLU", [-2, 1, 3]),
        ("DBL", [-3, -2, -1]),
    ],
)
def test_axes(axes, found):
    assert_array_equal(to_rfu(axes) @ [1.0, 2.0, 3.0], found)


def test_arrays_cannot_be_changed_and_are_read_once(tmp_path):
    path = files.counts(tmp_path / "car.npz")
    recording = load(path)
    assert load(path) is recording
    with pytest.raises(ValueError, match="read-only"):
        recording.dtheta[0] = 0.0
    files.counts(path, samples=500)
    os.utime(path, ns=(1, 1))
    assert len(load(path).dtheta) == 500  # a changed file is read again


def test_search(tmp_path, monkeypatch):
    files.counts(tmp_path / "car.npz")
    monkeypatch.setenv("SINS_ENV_DATA", str(tmp_path))
    assert load("car.npz").name == "car"
    (tmp_path / "here").mkdir()
    files.counts(tmp_path / "here" / "car.npz", samples=500)
    monkeypatch.chdir(tmp_path / "here")
    assert len(load("car.npz").dtheta) == 500  # as given comes first


def test_missing_file_says_where_and_offers_the_nearest(tmp_path, monkeypatch):
    files.counts(tmp_path / "rlg_parked_car.npz")
    monkeypatch.setenv("SINS_ENV_DATA", str(tmp_path))
    with pytest.raises(FileNotFoundError) as error:
        load("rlg_parked_kar.npz")
    assert str(tmp_path / "rlg_parked_kar.npz") in str(error.value)
    assert "did you mean 'rlg_parked_car.npz'?" in str(error.value)
    with pytest.raises(FileNotFoundError, match=r"recordings there: rlg_parked_car\.npz"):
        load("zzz")
    with pytest.raises(FileNotFoundError, match="no recording"):
        load(tmp_path)  # a folder


def test_a_distant_name_is_not_offered(tmp_path, monkeypatch):
    files.counts(tmp_path / "e.npz")
    monkeypatch.setenv("SINS_ENV_DATA", str(tmp_path))
    with pytest.raises(FileNotFoundError, match=r"; recordings there: e\.npz$"):
        load("rlg_parked_car.npz")


@pytest.mark.parametrize(("folder", "places"), [("", 1), (".", 1), ("data", 2)])
def test_each_place_is_named_once(tmp_path, monkeypatch, folder, places):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("SINS_ENV_DATA", folder)
    with pytest.raises(FileNotFoundError) as error:
        load("nowhere.npz")
    sought = str(error.value).partition("sought at ")[2].partition(";")[0]
    assert sought.count("nowhere.npz") == places
    assert ("is not set" in sought) == (not folder)


def test_missing_file_without_a_data_folder(no_data, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileNotFoundError, match=r"\$SINS_ENV_DATA is not set.*recordings there: none"):
        load("nothing.npz")


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.99])
def test_truncated(tmp_path, share):
    path = tmp_path / "cut.npz"
    content = Path(files.counts(path)).read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ValueError, match=r"cut\.npz: not a readable NPZ archive, or a truncated one"):
        load(path)


def test_damaged_inside(tmp_path):
    path = tmp_path / "bad.npz"
    content = bytearray(Path(files.counts(path)).read_bytes())
    content[2000:2040] = bytes(40)  # the archive's checksum no longer fits
    path.write_bytes(content)
    with pytest.raises(ValueError, match=r"bad\.npz: not a readable NPZ archive"):
        load(path)


@pytest.mark.parametrize("content", ["text", "npy", "pickle"])
def test_not_an_archive(tmp_path, content):
    path = tmp_path / "other.npz"
    if content == "text":
        path.write_text("t, x\n1, 2\n")
    elif content == "npy":
        np.save(path.with_suffix(".npy"), np.ones(3))
        path.with_suffix(".npy").rename(path)
    else:
        files.counts(path, gyro_counts=np.array([{}, None], dtype=object))
    with pytest.raises(ValueError, match=r"other\.npz: not a readable NPZ archive"):
        load(path)


def test_unknown_layout_names_the_keys_that_are_missing(tmp_path):
    path = files.counts(tmp_path / "car.npz", gyro_lsb_rad=None)
    with pytest.raises(ValueError, match=r"nearest is 'counts', but keys are missing: gyro_lsb_rad$"):
        load(path)
    path = files.increments(tmp_path / "drive.npz", imu_t_s=None, dvel_mps=None)
    with pytest.raises(ValueError, match=r"nearest is 'increments', but keys are missing: dvel_mps, imu_t_s$"):
        load(path)
    np.savez(tmp_path / "empty.npz")
    with pytest.raises(ValueError, match="not a known layout"):
        load(tmp_path / "empty.npz")


NAN_COUNTS = np.where(np.arange(3000).reshape(1000, 3) == 1001, np.nan, 1.0)  # sample 333


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"gyro_counts": np.zeros((0, 3), np.int16)},
            r"gyro_counts has shape \(0, 3\); allowed: \(any length, 3\)",
        ),
        ({"gyro_counts": np.ones((1000, 2))}, r"gyro_counts has shape \(1000, 2\)"),
        ({"gyro_counts": np.ones(1000)}, r"gyro_counts has shape \(1000,\)"),
        ({"accel_counts": np.ones((999, 3))}, r"accel_counts has shape \(999, 3\); allowed: \(1000, 3\)"),
        ({"gyro_counts": NAN_COUNTS}, "gyro_counts is not finite at sample 333"),
        ({"accel_counts": np.inf * NAN_COUNTS}, "accel_counts is not finite at sample 0"),
        ({"gyro_counts": np.full((1000, 3), "a")}, "gyro_counts holds <U1; allowed: numbers"),
        ({"fs_hz": 0.0}, "fs_hz = 0; allowed: positive"),
        ({"fs_hz": np.nan}, "fs_hz is not finite"),
        ({"fs_hz": np.ones(2)}, r"fs_hz has shape \(2,\)"),
        ({"gyro_lsb_rad": -1e-7}, "gyro_lsb_rad = -1e-07; allowed: positive"),
        ({"lat_deg": 89.95}, "lat_deg, lon_deg, h_m is .* allowed: latitude within 89.9 deg"),
        ({"ref_t_s": 0.1 * np.arange(99)}, r"ref_q_b2n_wxyz has shape \(100, 4\); allowed: \(99, 4\)"),
        ({"ref_t_s": np.zeros(100)}, "ref_t_s does not increase at sample 1"),
        ({"ref_q_b2n_wxyz": np.ones((100, 4))}, "ref_q_b2n_wxyz is not a unit quaternion at sample 0"),
    ],
)
def test_bad_counts(tmp_path, change, message):
    with pytest.raises(ValueError, match=rf"bad\.npz: {message}"):
        load(files.counts(tmp_path / "bad.npz", **change))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"dtheta_rad": np.zeros((2000, 3))}, r"dtheta_rad has shape \(2000, 3\); allowed: \(2400, 3\)"),
        ({"imu_t_s": 0.004 * np.arange(2400)}, "imu_t_s does not increase by one sample of 200 Hz at sample"),
        ({"imu_t_s": -0.005 * np.arange(2400)}, "imu_t_s does not increase by one sample"),
        ({"imu_t_s": 1.0 * np.arange(2400)}, "imu_t_s spans 479801 samples of 200 Hz; only 2400 are there"),
        ({"imu_t_s": np.full(2400, np.nan)}, "imu_t_s is not finite at sample 0"),
        ({"gnss_vel_enu_mps": np.ones((3, 3))}, r"gnss_vel_enu_mps has shape \(3, 3\); allowed: \(12, 3\)"),
        ({"gnss_llh_deg_m": np.full((12, 3), 95.0)}, "gnss_llh_deg_m is .* at sample 0; allowed: latitude"),
        ({"lever_arm_est_body_m": np.ones(2)}, r"lever_arm_est_body_m has shape \(2,\); allowed: \(3\)"),
    ],
)
def test_bad_increments(tmp_path, change, message):
    with pytest.raises(ValueError, match=rf"bad\.npz: {message}"):
        load(files.increments(tmp_path / "bad.npz", **change))


def test_jitter_of_a_tag_is_not_a_gap(tmp_path):
    tags = 0.005 * np.arange(2400)
    tags[[700, 1500]] += 0.003  # steps of 8 and 2 ms
    recording = load(files.increments(tmp_path / "drive.npz", imu_t_s=tags))
    assert np.isfinite(recording.dtheta).all()
    assert_array_equal(recording.dtheta, load(files.increments(tmp_path / "plain.npz")).dtheta)


def test_gaps_keep_the_clock(tmp_path):
    tags = 0.005 * np.arange(2400)
    tags[1000:] += 0.05  # ten samples are missing
    path = files.increments(tmp_path / "drive.npz", imu_t_s=tags)
    recording = load(path, bridge_s=0.0)
    missing = np.isnan(recording.dtheta).any(axis=1)
    assert_array_equal(np.flatnonzero(missing), np.arange(1000, 1010))
    x, y, z = np.load(path)["dvel_mps"][1000]
    assert_array_equal(recording.dvel[1010], [y, -x, z])


def test_without_a_reference(tmp_path):
    assert load(files.counts(tmp_path / "car.npz", ref_q_b2n_wxyz=None)).reference is None


@pytest.mark.parametrize("recorded", ["rlg_parked_car.npz"], indirect=True)
def test_the_parked_car(recorded):
    """../shared/data/README.md, measured on the file."""
    recording = load(recorded)
    assert (recording.rate_hz, recording.dtheta.shape, recording.end) == (100.0, (123000, 3), 1230.0)
    assert np.linalg.norm(recording.dvel.mean(axis=0)) * 100 == pytest.approx(9.7955, abs=2e-4)
    quiet = recording.dtheta[60000:98000].mean(axis=0) * 100
    assert np.degrees(np.linalg.norm(quiet)) * 3600 == pytest.approx(14.99, abs=0.05)
    heading = np.degrees(attitude.to_euler(attitude.to_dcm(recording.reference.q_nb))[0])
    assert np.abs(heading[[0, -1]] - [90.5848, 90.6019]).max() < 1e-3


@pytest.mark.parametrize("recorded", ["navgrade_car_gps.npz"], indirect=True)
def test_the_driven_car(recorded):
    """The vehicle moves forward, gravity is up, and heading is 90 deg less than that of the file's y axis."""
    recording = load(recorded)
    assert recording.dtheta.shape == (27280, 3)
    assert np.isfinite(recording.dtheta).all()  # the 8 and 2 ms tag pairs are no gaps
    assert np.linalg.norm(recording.dvel[:10000].mean(axis=0)) * 200 == pytest.approx(9.7958, abs=2e-4)
    ref = recording.reference
    C = attitude.to_dcm(ref.q_nb)
    driving = np.linalg.norm(ref.vel, axis=1) > 4
    body = np.mean((np.swapaxes(C, -1, -2) @ ref.vel[..., None])[driving, :, 0], axis=0)
    assert body[1] > 5
    assert np.abs(body[[0, 2]]).max() < 0.1
    hpr = np.load(os.path.join(os.environ["SINS_ENV_DATA"], recorded))["ref_hpr_deg"]
    heading = np.degrees(attitude.to_euler(C)[0])
    level = np.abs(hpr[:, 1:]).max(axis=1) < 1.0
    assert np.abs(attitude.wrap(np.radians(hpr[:, 0] - 90 - heading))[level]).max() < np.radians(0.03)
    assert_allclose(recording.lever_arm, [-0.528, -0.985, 2.021], atol=1e-3)
    assert set(LAYOUTS) == {"counts", "increments"}


def test_displacements(tmp_path):
    moved = {
        "tdcp_t_imu_s": np.array([1.95, 2.95, 3.95, 4.95]),
        "tdcp_disp_enu_m": np.arange(12.0).reshape(4, 3),
        "tdcp_nsat": np.array([7, 5, 6, 6]),
        "tdcp_res_rms_m": np.array([0.01, 0.01, 0.03, 0.029]),
    }
    recording = load(files.increments(tmp_path / "drive.npz", **moved))
    found = recording.displacements
    assert_array_equal(found.enu, moved["tdcp_disp_enu_m"])
    assert (found.span_s, found.usable.tolist()) == (1.0, [True, False, False, True])
    assert load(files.increments(tmp_path / "plain.npz")).displacements is None
    save(recording, tmp_path / "own.npz")
    for one, other in zip(found, load(tmp_path / "own.npz").displacements, strict=True):
        assert_array_equal(one, other)
    assert [("displacements" in left_out(recording, name)) for name in FORMATS] == [name != "npz" for name in FORMATS]
    with pytest.raises(ValueError, match=r"tdcp_nsat has shape \(3,\); allowed: \(4\)"):
        load(files.increments(tmp_path / "bad.npz", **{**moved, "tdcp_nsat": np.array([7, 5, 6])}))
