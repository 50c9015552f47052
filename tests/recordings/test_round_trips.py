"""What is written is read again: with its bits where the format has room for them, else to its printed digits."""

import subprocess
import sys

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from oracles import made
from places import TESTS

from sins_env.recordings import FORMATS, LAYOUTS, left_out, load, resample, save
from sins_env.recordings.formats import psins_imu
from sins_env.units import ARCSEC

WRITTEN = {name: one for name, one in FORMATS.items() if one.save}
ENDINGS = {name: one.ending for name, one in WRITTEN.items()}
GAPS = (slice(700, 710), slice(1500, 1501))
CASES = {
    "whole": {},
    "gaps": {"gaps": GAPS},
    "bare": {"gnss": False, "reference": False},
    "positions only": {"velocity": False},
    "no deviations": {"std": False},
    "parked": {"gnss": False, "velocity": False},
    "slow": {"rate": 12.5, "samples": 125, "t0": 0.0},
    "seconds of week": {"t0": 456_249.995},
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("name", WRITTEN)
def test_round_trip(tmp_path, name, case):
    first = made.recording(**CASES[case])
    path = tmp_path / f"x{ENDINGS[name]}"
    written = save(first, path)
    assert sorted(tmp_path.iterdir()) == sorted(written)
    again = load(path, bridge_s=0.0)
    assert again.rate_hz == first.rate_hz
    assert again.t0 == pytest.approx(first.t0, abs=1e-9)
    assert_array_equal(again.missing, first.missing)
    assert_allclose(again.site.pos, first.site.pos, rtol=1e-13 if name == "psins-imu" else 1e-15)
    if name == "psins-imu":
        lsb = psins_imu.GYRO_LSB_ARCSEC * ARCSEC
        sums = [np.nancumsum(one.dtheta, axis=0) for one in (first, again)]
        assert np.abs(sums[0] - sums[1]).max() <= 0.51 * lsb  # the remainder is carried on
        assert_allclose(again.dvel, first.dvel, atol=1e-7)
    else:
        assert_array_equal(again.dtheta, first.dtheta)
        assert_array_equal(again.dvel, first.dvel)
    _same_fixes(name, first, again)
    _same_reference(name, first, again)


def _same_fixes(name, first, again):
    if first.gnss is None or "fixes" in FORMATS[name].lacks:
        assert again.gnss is None
        return
    exact = name in ("npz", "csv")
    assert_allclose(again.lever_arm, first.lever_arm, rtol=1e-15)
    for field, one, other in zip(first.gnss._fields, first.gnss, again.gnss, strict=True):
        if one is None and field in ("pos_std", "vel_std") and name == "kfgins" and other is not None:
            assert_array_equal(other, np.full(other.shape, {"pos_std": 1.0, "vel_std": 0.1}[field]))
        elif "standard deviations of the fixes" in FORMATS[name].lacks and field.endswith("std"):
            assert other is None
            assert "standard deviations" in str(left_out(first, name)) or one is None
        elif one is None:
            assert other is None
        elif exact:
            assert_array_equal(other, one)
        else:
            assert_allclose(other, one, atol=6e-7, rtol=1e-13)


def _same_reference(name, first, again):
    ref, other = first.reference, again.reference
    if ref is None or "reference" in FORMATS[name].lacks:
        assert other is None
        return
    assert_allclose(other.t_s, ref.t_s, atol=1e-9)
    apart = np.abs(np.sum(other.q_nb * ref.q_nb, axis=-1))
    assert_allclose(apart, 1.0, atol=1e-14)
    if name in ("npz", "csv"):
        assert_array_equal(other.q_nb, ref.q_nb)
    if ref.vel is not None:
        assert_allclose(other.vel, ref.vel, rtol=1e-14)
        assert_allclose(other.pos, ref.pos, atol=6e-7)
    elif name == "kfgins":  # a truth file has columns for both: it stands still at its site
        assert not other.vel.any()
        assert_allclose(other.pos, np.broadcast_to(first.site.pos, other.pos.shape), atol=1e-6)
    else:
        assert other.vel is other.pos is None


@pytest.mark.parametrize("name", WRITTEN)
def test_a_second_round_changes_nothing(tmp_path, name):
    paths = [tmp_path / f"{stem}{ENDINGS[name]}" for stem in ("a", "b")]
    save(made.recording(gaps=GAPS), paths[0])
    save(load(paths[0]), paths[1])
    one, two = (load(path) for path in paths)
    assert_array_equal(one.dtheta, two.dtheta)
    assert_allclose(one.dvel, two.dvel, rtol=1e-15)
    if one.reference:
        assert_allclose(one.reference.q_nb, two.reference.q_nb, atol=1e-14)


def test_arrays_are_read_only(tmp_path):
    for name, ending in ENDINGS.items():
        save(made.recording(), tmp_path / f"{name}{ending}")
        with pytest.raises(ValueError, match="read-only"):
            load(tmp_path / f"{name}{ending}").dtheta[0] = 0.0


@pytest.mark.parametrize("recorded", ["rlg_parked_car.npz"], indirect=True)
def test_the_parked_car_through_its_own_format(tmp_path, recorded):
    """It came from a PSINS .imu of 0.1 arcsec and 125 ug s per count, of which the pulses written are a part."""
    first = load(recorded)
    save(first, tmp_path / "car.imu")
    again = load(tmp_path / "car.imu")
    assert_allclose(again.dtheta, first.dtheta, atol=1e-17)
    assert_allclose(again.dvel, first.dvel, atol=1e-15)
    assert (again.rate_hz, again.t0) == (first.rate_hz, first.t0)


def test_what_is_left_out_is_said():
    whole = made.recording()
    assert left_out(whole, "psins-imu") == ["fixes", "reference", "lever arm"]
    assert left_out(whole, "npz") == left_out(whole, "csv") == []


@pytest.mark.parametrize("name", WRITTEN)
def test_nothing_is_overwritten_unasked(tmp_path, name):
    path = tmp_path / f"x{ENDINGS[name]}"
    written = save(made.recording(), path)
    for file in written:
        for other in written:
            other.unlink(missing_ok=True)
        file.write_text("mine")
        with pytest.raises(FileExistsError, match="exists already"):
            save(made.recording(), path)
        assert file.read_text() == "mine"
        assert list(tmp_path.iterdir()) == [file]
        assert save(made.recording(), path, overwrite=True) == written
        load(path)


_FULL = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
from oracles import made
from sins_env.recordings import save
import scipy.io
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
try:
    save(made.recording(), sys.argv[1], overwrite=True)
except OSError as error:
    print(error)
"""


@pytest.mark.parametrize("name", WRITTEN)
def test_a_full_disk_changes_nothing(tmp_path, name):
    """A limit on the size of files is a disk that is full."""
    path = tmp_path / f"x{ENDINGS[name]}"
    path.write_text("before")
    out = subprocess.run(
        [sys.executable, "-c", _FULL, str(path)], capture_output=True, text=True, cwd=TESTS, check=True
    )
    assert "cannot be written: File too large" in out.stdout
    assert path.read_text() == "before"
    assert list(tmp_path.iterdir()) == [path]


def test_where_nothing_can_be_written(tmp_path):
    with pytest.raises(FileNotFoundError, match="the directory does not exist"):
        save(made.recording(), tmp_path / "no" / "x.npz")
    with pytest.raises(ValueError, match=r"no format has the ending '\.xyz'"):
        save(made.recording(), tmp_path / "x.xyz")
    with pytest.raises(ValueError, match="unknown format 'kfgin'; did you mean 'kfgins'"):
        save(made.recording(), tmp_path / "x.txt", format="kfgin")


def test_an_interrupt_leaves_nothing_behind(tmp_path, monkeypatch):
    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez", stop)
    with pytest.raises(KeyboardInterrupt):
        save(made.recording(), tmp_path / "x.npz")
    assert not list(tmp_path.iterdir())


def test_resampling_is_done_only_when_asked_for(tmp_path):
    first = made.recording(gaps=GAPS)
    for name, ending in ENDINGS.items():
        save(first, tmp_path / f"{name}{ending}")
        assert load(tmp_path / f"{name}{ending}").rate_hz == 200.0
        again = load(tmp_path / f"{name}{ending}", resample_hz=100.0, bridge_s=0.0)
        assert again.rate_hz == 100.0
        assert_allclose(again.dvel, resample(load(tmp_path / f"{name}{ending}", bridge_s=0.0), 100.0).dvel, atol=1e-13)


def test_foreign_layouts_can_be_turned(tmp_path):
    """Axes are a setting of every format."""
    assert LAYOUTS["increments"].axes == "BRU"
    first = made.recording(gnss=False, reference=False)
    for name in ("kfgins", "psins-imu", "psins-mat", "csv"):
        path = tmp_path / f"{name}{ENDINGS[name]}"
        save(first, path)
        usual, turned = load(path), load(path, axes="FLU")
        raw = usual.dvel if name != "kfgins" else usual.dvel @ made.SWAP.T
        x, y, z = raw.T
        assert_array_equal(turned.dvel, np.stack([-y, x, z], axis=-1))
    save(first, tmp_path / "own.npz")
    with pytest.raises(ValueError, match="allowed: RFU"):
        load(tmp_path / "own.npz", axes="FRD")
