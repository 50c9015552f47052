"""Kernels: what the decorator makes of a function, the cache, and what holds for every kernel of the project."""

import os
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from evaluation.short import SHORT
from places import ROOT

import solvers
from sins_env.evaluation import get_task
from sins_env.kernels import Kernel, compiling, helper, interpreted, kernel
from sins_env.kernels.compiling import FOLDER, KERNELS, OFF, cache_folder
from sins_env.kernels.trigonometry import sincos
from sins_env.kernels.warming import cold, import_kernels

FACTOR = 3.0


@helper
def scaled(x, k):
    return FACTOR * x * k


@kernel("(n),(n,m),()->(m),()", "ddqd?")
def weighted(w, a, k, out, positive):
    """Return k w' a and its sign."""
    positive[0] = True
    for j in range(a.shape[1]):
        out[j] = 0.0
        for i in range(len(w)):
            out[j] += scaled(w[i] * a[i, j], k)
        positive[0] = positive[0] and out[j] > 0.0


@kernel("(3)->(4)")
def longer(x, out):
    out[0] = 1.0
    for i in range(3):
        out[i + 1] = x[i]


@kernel("(n)->(n),(n)")
def both(x, s, c):
    for i in range(len(x)):
        s[i], c[i] = sincos(x[i])


@pytest.fixture(params=["compiled", "interpreted"])
def way(request):
    if request.param == "compiled":
        yield
    else:
        with interpreted():
            yield


@pytest.mark.usefixtures("way")
def test_batch_axes_are_broadcast():
    rng = np.random.default_rng(1)
    w, a = rng.standard_normal((5, 1, 4)), rng.standard_normal((6, 4, 3))
    out, positive = weighted(w, a, 2)
    np.testing.assert_allclose(out, 6.0 * np.einsum("bxi,cij->bcj", w, a), rtol=1e-13)
    assert positive.dtype == bool
    np.testing.assert_array_equal(positive, (out > 0).all(axis=-1))
    alone, _ = weighted(w[2, 0], a[3], 2)
    np.testing.assert_array_equal(out[2, 3], alone)
    assert longer([1, 2, 3]).tolist() == [1.0, 1.0, 2.0, 3.0]
    assert longer(np.zeros((0, 3))).shape == (0, 4)


@pytest.mark.usefixtures("way")
def test_shapes_that_do_not_fit():
    with pytest.raises(
        ValueError,
        match=r"weighted: Input operand 1 has a mismatch .*\(n,m\),\(\)->.* 3 is different from 4",
    ):
        weighted(np.ones(4), np.ones((3, 2)), 1)
    with pytest.raises(ValueError, match=r"longer: .*\(3\)->\(4\) \(size 4 is different from 3\)"):
        longer(np.ones(4))
    with pytest.raises(ValueError, match="broadcast"):
        weighted(np.ones((2, 4)), np.ones((3, 4, 2)), 1)


def test_a_kernel_is_found_by_its_name():
    assert pickle.loads(pickle.dumps(longer)) is longer
    assert repr(longer) == "<kernel test_kernels.longer (3)->(4)>"
    assert weighted.__doc__ == "Return k w' a and its sign."
    assert callable(weighted.py_func)


def test_names_that_the_compiler_cannot_follow():
    def unmarked(x):
        return x

    scope = {"unmarked": unmarked, "helper": helper, "os": os}
    for body, text in (
        ("unmarked(x[0])", "calls unmarked; allowed: functions marked"),
        ("os.sep", "uses module os; allowed"),
    ):
        exec(f"def k(x, out):\n    out[0] = {body}", scope)
        with pytest.raises(TypeError, match=text):
            Kernel(scope["k"], "(n)->(n)").folder  # noqa: B018
        KERNELS.pop()


def test_sine_and_cosine():
    """In every quadrant and at the borders; a large angle to its own digits."""
    rng = np.random.default_rng(2)
    borders = np.arange(-40, 41) * np.pi / 4
    x = np.concatenate(
        [
            rng.uniform(-7, 7, 4001),
            borders,
            borders + 1e-9,
            rng.uniform(-1e5, 1e5, 999),
            [0.0, 1e-300],
        ]
    )
    s, c = both(x)
    assert np.abs(s - np.sin(x)).max() < 2.3e-16
    assert np.abs(c - np.cos(x)).max() < 2.3e-16
    assert s[list(x).index(1e-300)] == 1e-300
    np.testing.assert_array_equal(both(x[:3])[0], s[:3])
    assert both([2e9])[0] == pytest.approx(np.sin(2e9), abs=1e-6)
    assert np.isnan(both([np.nan, 1e17, -1e300])).all()  # without a warning


def test_python_bodies_are_switched_by_an_environment_variable(monkeypatch):
    monkeypatch.setenv(OFF, "1")
    fresh = Kernel(longer.py_func, "(3)->(4)")
    KERNELS.pop()
    assert not isinstance(fresh.ufunc, np.ufunc)
    assert not fresh.cold
    monkeypatch.setenv(OFF, "0")
    with interpreted():
        assert not isinstance(longer.ufunc, np.ufunc)
    assert os.environ[OFF] == "0"
    assert isinstance(longer.ufunc, np.ufunc)


def delivered(task, epochs=4):
    """Return the public task, the observations of the first epochs of one run, the rewards and the errors."""
    env = task.make(1)
    obs, _ = task.reset(env, (0,))
    public, found, scores = env.unwrapped.task, [], []
    for _ in range(epochs):
        found.append(obs)
        obs, reward, _, _, info = env.step(np.ones(env.action_space.shape))
        scores.append([reward, *(info["errors"][name] for name in ("phi", "vel", "pos")[: 1 + 2 * public.navigate])])
    env.close()
    return public, found, scores


def actions(public, observations, name):
    """Actions of one run, (epochs, ...)."""
    solver = solvers.make(name)
    solver.reset(public, [np.random.default_rng(5)])
    if solver.batched:
        return np.array([solver.step(obs) for obs in observations])
    return np.array([solver.step({key: value[0] for key, value in obs.items()}) for obs in observations])


@pytest.mark.parametrize("task", [SHORT, get_task("flight-lu-gauss-v0")], ids=lambda task: task.name)
def test_the_zoo_on_the_bodies_of_its_kernels(task):
    """The compiler reorders nothing, so that little more than the last bits of library functions may differ."""
    told = [name for name in solvers.names() if name not in ("coarse_only", "two_pass", "fgo")]
    some = told if task is SHORT else ["ekf", "inekf", "ckf"]
    public, observations, _ = delivered(task)
    compiled = [actions(public, observations, name) for name in some]
    with interpreted():
        by_python = [actions(public, observations, name) for name in some]
    for name, one, other in zip(some, compiled, by_python, strict=True):
        np.testing.assert_allclose(other, one, rtol=1e-9, atol=1e-9, err_msg=name)


@pytest.mark.parametrize(
    "task",
    [
        replace(
            SHORT, kwargs={**SHORT.kwargs, "n_sub": 1, "gps": {"jump_mps": 1.0, "jump_s": 5.0}, "imu": "thesis-markov"}
        ),
        get_task("flight-sun2012-physical-v0"),
    ],
    ids=lambda task: task.name,
)
def test_worlds_on_the_bodies_of_their_kernels(task):
    _, observations, scores = delivered(task)
    with interpreted():
        _, by_python, scores_by_python = delivered(task)
    for one, other in zip(observations, by_python, strict=True):
        for name, value in one.items():
            np.testing.assert_allclose(other[name], value, rtol=1e-13, atol=1e-15, err_msg=name)
    for one, other in zip(scores, scores_by_python, strict=True):
        for value, by_body in zip(one, other, strict=True):
            np.testing.assert_allclose(by_body, value, rtol=1e-12, atol=1e-12)


def every_kernel():
    return [
        one
        for one in import_kernels(["sins_env", "solvers"])
        if one.__module__.split(".")[0] in ("sins_env", "solvers")
    ]


def test_every_kernel_is_found():
    found = {f"{one.__module__}.{one.__qualname__}" for one in every_kernel()}
    text = "".join(path.read_text() for folder in ("sins_env", "solvers") for path in (ROOT / folder).rglob("*.py"))
    assert len(found) == text.count("\n@kernel(")
    assert solvers.__name__ in {name.split(".")[0] for name in found}


SIZES = {"n": 10, "s": 30, "m": 10, "w": 3, "p": 21, "k": 3, "e": 15, "h": 2}


ALL = pytest.mark.parametrize("one", every_kernel(), ids=lambda one: f"{one.__module__}.{one.__qualname__}")


def drawn(one, runs):
    """Random inputs of a kernel; a square matrix is positive definite."""
    rng = np.random.default_rng(3)
    for i, shape in enumerate(one.inputs):
        sizes = [int(s) if s.isdigit() else SIZES.get(s, 4) for s in shape.split(",") if s]
        a = rng.standard_normal((runs, *sizes))
        if len(sizes) == 2 and sizes[0] == sizes[1]:
            a = a @ a.mT + np.eye(sizes[0])
        yield (a if one.dtypes[i] == "d" else np.zeros(a.shape)).astype(one.dtypes[i])


@ALL
def test_a_row_of_a_batch_is_the_run_alone(one):
    """Bit for bit, at every place of batches of two sizes."""
    inputs = list(drawn(one, 9))
    with np.errstate(all="ignore"):
        for runs in (9, 4):
            whole = as_tuple(one(*(a[:runs] for a in inputs)))
            for i in range(runs):
                for x, y in zip(whole, as_tuple(one(*(a[i] for a in inputs))), strict=True):
                    np.testing.assert_array_equal(x[i], y)


@ALL
def test_a_lost_run_does_not_warn(one):
    """One run is NaN beside a good one, which keeps its bits; no floating-point flag is raised for NaN."""
    inputs = list(drawn(one, 2))
    with np.errstate(all="ignore"):
        good = as_tuple(one(*(a[0] for a in inputs)))
    for a in inputs:
        if a.dtype == float:
            a[1] = np.nan
    with np.errstate(invalid="raise", divide="ignore"):
        for x, y in zip(as_tuple(one(*inputs)), good, strict=True):
            np.testing.assert_array_equal(x[0], y)


def as_tuple(out):
    return out if isinstance(out, tuple) else (out,)


MODULE = """
from sins_env.kernels import kernel
from {name}_helpers import twice

@kernel("(n)->(n)")
def double(x, out):
    for i in range(len(x)):
        out[i] = twice(x[i])
"""
HELPERS = """
from sins_env.kernels import helper

@helper
def twice(x):
    return {factor} * x
"""


def in_fresh_process(folder, code, **environment):
    environment = {**os.environ, "PYTHONPATH": f"{folder}{os.pathsep}{ROOT}", **environment}
    return subprocess.Popen(
        [sys.executable, "-c", code],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
        cwd=folder,
    )


CALL = "import own; print(own.double.cold, own.double([1.0])[0])"


@pytest.fixture
def own(tmp_path):
    (tmp_path / "own.py").write_text(MODULE.format(name="own"))
    (tmp_path / "own_helpers.py").write_text(HELPERS.format(factor=2.0))
    return tmp_path


def said(process):
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return out, err


def test_cold_processes_compile_once_and_an_edit_of_a_helper_renews(own):
    cache = own / "cache"
    both = [in_fresh_process(own, CALL, **{FOLDER: str(cache)}) for _ in range(2)]
    for process in both:
        assert said(process)[0].split()[1] == "2.0"
    assert len(list(cache.rglob("guf-*.nbc"))) == 1
    assert said(in_fresh_process(own, CALL, **{FOLDER: str(cache)}))[0] == "False 2.0\n"
    assert not list(own.rglob("__pycache__/*.nb?"))
    (own / "own_helpers.py").write_text(HELPERS.format(factor=5.0))
    assert said(in_fresh_process(own, CALL, **{FOLDER: str(cache)}))[0] == "True 5.0\n"


def test_nobody_waits_for_a_process_that_keeps_the_lock(tmp_path, monkeypatch):
    """Code that is there is read without a lock, and a stopped process that compiles is not waited for for ever."""
    fcntl = pytest.importorskip("fcntl")
    monkeypatch.setenv(FOLDER, str(tmp_path))
    monkeypatch.setattr(compiling, "LONGEST_S", 0.1)
    folder = tmp_path / "one"
    folder.mkdir()
    with open(folder / "lock", "a") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        with compiling._locked(folder) as place:
            assert place == folder
        (folder / "x").mkdir()
        (folder / "x" / "guf-x.nbc").write_bytes(b"")
        monkeypatch.setattr(compiling, "LONGEST_S", 1e9)
        with compiling._locked(folder) as place:
            assert place == folder


def test_a_cache_that_cannot_be_written(own):
    (own / "file").write_text("")
    out, err = said(in_fresh_process(own, CALL, **{FOLDER: str(own / "file" / "cache")}))
    assert out == "True 2.0\n"
    assert "cannot be written" in err


def test_a_warm_cache_that_cannot_be_written_is_read(own):
    """Without a word, and without compiling, after which Numba would save.

    The lock is a folder, which even root cannot open as a file.
    """
    cache = own / "cache"
    said(in_fresh_process(own, CALL, **{FOLDER: str(cache)}))
    for lock in cache.rglob("lock"):
        lock.unlink()
        lock.mkdir()
    before = sorted(cache.rglob("*"))
    saves = "import numba.core.caching as c\ndef no(*a): raise SystemExit('compiles')\nc.IndexDataCacheFile.save = no\n"
    assert said(in_fresh_process(own, saves + CALL, **{FOLDER: str(cache)})) == ("False 2.0\n", "")
    assert sorted(cache.rglob("*")) == before


def test_processes_that_one_starts_do_not_warn_again(own):
    (own / "file").write_text("")
    twice = f"{CALL}; import subprocess, sys; subprocess.run([sys.executable, '-c', {CALL!r}], check=True)"
    _, err = said(in_fresh_process(own, twice, **{FOLDER: str(own / "file" / "cache")}))
    assert err.count("cannot be written") == 1


@pytest.mark.skipif(sys.platform == "win32", reason="no limit of the size of files")
def test_a_cache_on_a_full_disk(own):
    """Files may have 1,000 bytes, which is too few for any kernel."""
    limit = "import resource\nresource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))\n"
    out, err = said(in_fresh_process(own, limit + CALL, **{FOLDER: str(own / "cache")}))
    assert out == "True 2.0\n"
    assert "cannot be written: File too large" in err
    assert f"set {FOLDER} to a folder that can" in err


def test_the_folder_of_the_cache(monkeypatch, tmp_path):
    monkeypatch.setenv(FOLDER, str(tmp_path))
    assert cache_folder() == tmp_path
    monkeypatch.delenv(FOLDER)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "sins_env" / "kernels"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    assert cache_folder() == Path.home() / ".cache" / "sins_env" / "kernels"


def test_warm(cli):
    code, out, _ = cli("warm")
    assert code == 0
    assert str(cache_folder()) in out.replace("\n", "")
    assert [one for one in cold() if one in every_kernel()] == []
