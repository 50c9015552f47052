"""Compiled kernels: a plain function over one run becomes a NumPy gufunc that takes any batch of runs.

    @kernel("(3),(3)->(3)")
    def cross(a: Array, b: Array, out: Array) -> None:
        out[0], out[1], out[2] = cross3((a[0], a[1], a[2]), (b[0], b[1], b[2]))

A kernel is called as ``cross(a, b)``; NumPy broadcasts the batch axes and checks the shapes. The Python function stays at
``cross.py_func``. Numba compiles it on the first call, or takes it from the cache, so that an import needs no compiler.
A function that kernels share is a :func:`helper`: an ordinary Python function that is inlined where a kernel calls it.
How to write, test and time one: docs/kernels.md.

The compiler may not fuse products, and it may reorder the sums of a :func:`reduction` alone. A run has the same bits alone and
in any batch.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
import tempfile
import time
import types
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, cached_property, update_wrapper
from pathlib import Path
from typing import IO, Any, TypeVar

import numpy as np

try:
    import fcntl
except ImportError:  # not on Windows, where processes that start together may compile the same kernel twice
    fcntl = None  # type: ignore[assignment]

F = TypeVar("F", bound=Callable[..., Any])

KERNELS: list[Kernel] = []  #: every kernel of the modules imported so far
OFF = "NUMBA_DISABLE_JIT"  #: with this environment variable set to 1, Python runs the bodies of the kernels
FOLDER = "NUMBA_CACHE_DIR"  #: environment variable with the folder of compiled code; the default is in the user's cache
_TOLD = "SINS_ENV_TOLD_CACHE"  # environment variable with the folder warned of, for processes started later
LONGEST_S = 60.0  #: s, longest wait for a process that compiles the same kernel; a slow one takes ten
POLL_S = 0.02  #: s, from one look to the next
_CODE = "*/guf-*.nbc"  # the code of a kernel, which Numba writes last
_COMPILED = "*/*.nb?"  # files of Numba in the folder of a kernel: indices and code
_helpers: dict[types.FunctionType, Any] = {}  #: every helper, with its compiled form as soon as there is one
_reordered: set[Any] = set()  #: the helpers with sums in any order
#: How helpers are compiled; numbers divide as in NumPy.
_OPTIONS: Any = {"nopython": True, "error_model": "numpy", "forceinline": True}
_DTYPES = {"d": "float64", "q": "int64", "?": "boolean"}


def helper(body: F) -> F:
    """Mark a function that kernels call; it is inlined into them, and stays an ordinary function for Python."""
    _helpers[body] = None  # type: ignore[index]
    return body


def reduction(body: F) -> F:
    """Mark a helper with a long sum over a run, whose order the compiler may choose: vector code needs several part sums.

    The order follows from the number of terms, so that the bits of a run are still the same in any batch.
    """
    _reordered.add(body)
    return helper(body)


def kernel(layout: str, dtypes: str = "") -> Callable[[Callable[..., None]], Kernel]:
    """Return the decorator that makes a kernel of a function.

    Args:
        layout: shapes of one run, such as ``"(n),(n,n)->(n)"``. A number is a fixed size.
        dtypes: type of each array: ``d`` float64, ``q`` int64, ``?`` bool. Empty: all are float64.
    """
    return lambda body: Kernel(body, layout, dtypes)


class Kernel:
    """A compiled function over one run, with the batch axes broadcast by NumPy.

    The function takes the arrays of ``layout``, outputs last, and fills the outputs. A call takes the inputs alone and returns
    the outputs. In a run an input with shape () is a number, and an output with shape () is an array of one element.

    Raises:
        ValueError: a call with arrays that do not have the shapes of the layout.
    """

    ufunc: Any  #: what NumPy calls; made on the first use

    def __init__(self, body: Callable[..., None], layout: str, dtypes: str = "") -> None:
        update_wrapper(self, body)
        self.py_func: Any = body
        self.layout = layout.replace(" ", "")
        self.inputs, self.outputs = (re.findall(r"\(([^)]*)\)", side) for side in self.layout.split("->"))
        self.dtypes = dtypes or "d" * len(self.inputs + self.outputs)
        KERNELS.append(self)

    def __call__(self, *arrays: Any) -> Any:
        return self.ufunc(*arrays)

    def __getattr__(self, name: str) -> Any:
        if name != "ufunc":
            raise AttributeError(f"kernel {self.__name__!r} has no attribute {name!r}")
        self.ufunc = _interpreted(self) if off() else self._compiled()
        return self.ufunc

    def __reduce__(self) -> str:
        return self.__qualname__

    def __repr__(self) -> str:
        return f"<kernel {self.__module__}.{self.__qualname__} {self.layout}>"

    @cached_property
    def folder(self) -> Path:
        """Folder of the compiled code. Its name has a hash of all that the code depends on, so it is never stale."""
        digest = hashlib.sha256(f"{sys.version_info[:2]} {self.layout} {self.dtypes}".encode())
        functions, constants = _closure(self.py_func)
        for file in sorted({function.__code__.co_filename for function in functions}):
            digest.update(_bytes(file))
        for name, value in sorted(constants.items()):
            digest.update(f"{name} {value.tobytes() if isinstance(value, np.ndarray) else value!r}".encode())
        return cache_folder() / f"{self.__module__}.{self.__qualname__}-{digest.hexdigest()[:16]}"

    @property
    def cold(self) -> bool:
        """Whether the first call will compile."""
        return "ufunc" not in vars(self) and not off() and not any(self.folder.glob(_CODE))

    def _compiled(self) -> Any:
        """Return the gufunc, from the cache if it is there. Processes that need the same kernel wait for the first."""
        import numba  # slow to import, needed by the first call of a kernel

        config: Any = numba.config
        kept = config.CACHE_DIR
        try:
            with _locked(self.folder) as place:
                config.CACHE_DIR = str(place or "")
                try:
                    return _build(self, place is not None)
                except OSError as error:  # a full disk: what was compiled cannot be kept
                    _warn(self.folder, error)
                    return _build(self, False)
        finally:
            config.CACHE_DIR = kept


def off() -> bool:
    """Return whether Python runs the bodies of the kernels."""
    return os.environ.get(OFF, "0") not in ("", "0")


@contextmanager
def interpreted() -> Iterator[None]:
    """Run the bodies of the kernels by Python within this context, for tests and for a debugger."""
    kept = os.environ.get(OFF)
    _forget()
    os.environ[OFF] = "1"
    try:
        yield
    finally:
        _forget()
        os.environ.pop(OFF)
        if kept is not None:
            os.environ[OFF] = kept


def cache_folder() -> Path:
    """Return the folder of compiled code: $NUMBA_CACHE_DIR, or sins_env/kernels in the user's cache."""
    if os.environ.get(FOLDER):
        return Path(os.environ[FOLDER])
    given = os.environ.get("XDG_CACHE_HOME", "")
    try:
        base = Path(given) if os.path.isabs(given) else Path.home() / ".cache"
    except RuntimeError:  # a user without a home
        base = Path(tempfile.gettempdir())
    return base / "sins_env" / "kernels"


@cache
def _bytes(file: str) -> bytes:
    return Path(file).read_bytes()


def _forget() -> None:
    for one in KERNELS:
        vars(one).pop("ufunc", None)


def _closure(body: Any) -> tuple[list[Any], dict[str, Any]]:
    """Return a function with the helpers that it reaches, and the values of the constants that they use.

    Raises:
        TypeError: a name that is neither a helper, a constant, nor a module of Python or NumPy.
    """
    functions, constants = [body], {}
    for function in functions:
        for name, value in _globals(function).items():
            if isinstance(value, types.FunctionType):
                if value not in _helpers:
                    raise TypeError(f"{function.__qualname__} calls {name}; allowed: functions marked with @helper")
                functions += [] if value in functions else [value]
            elif isinstance(value, types.ModuleType) and value.__name__ not in ("math", "numpy"):
                raise TypeError(
                    f"{function.__qualname__} uses module {name}; allowed: math, numpy, and names imported from others"
                )
            elif isinstance(value, int | float | tuple | str | slice | np.ndarray):
                constants[f"{function.__qualname__} {name}"] = value
    return functions, constants


def _globals(function: Any) -> dict[str, Any]:
    """Return the global names of a function, with their values."""
    known = function.__globals__
    return {name: known[name] for name in function.__code__.co_names if name in known}


def _for_numba(function: Any, file: str | None = None) -> Any:
    """Return the function with compiled helpers among its globals, as if it stood in another ``file``."""
    found = {name: value for name, value in _globals(function).items() if isinstance(value, types.FunctionType)}
    scope = {**function.__globals__, **{name: _inlined(value) for name, value in found.items()}}
    code = function.__code__.replace(co_filename=file) if file else function.__code__
    copy = types.FunctionType(code, scope, function.__name__, function.__defaults__)
    return update_wrapper(copy, function, updated=())


def _inlined(function: Any) -> Any:
    """Return the compiled form of a helper."""
    import numba  # slow to import, needed by the first call of a kernel

    if _helpers[function] is None:
        order: Any = {"fastmath": {"reassoc"}} if function in _reordered else {}
        _helpers[function] = numba.jit(**_OPTIONS, **order)(_for_numba(function))
    return _helpers[function]


class _Shapes(list[tuple[str, ...]]):
    """Shapes of the inputs, which also name the sizes that outputs alone have; Numba would ask for an input with them."""

    def __init__(self, inputs: list[tuple[str, ...]], outputs: list[tuple[str, ...]]) -> None:
        super().__init__(inputs)
        self._all = inputs + outputs

    def __iter__(self) -> Iterator[Any]:
        return iter(self._all)


def _build(one: Kernel, cache: bool) -> Any:
    """Compile a kernel, or load it. Sizes that are numbers are known to NumPy, and are symbols for Numba."""
    import numba  # slow to import, needed by the first call of a kernel
    from numba.np.ufunc.ufuncbuilder import GUFuncBuilder  # as above

    shapes = [tuple(f"size{s}" for s in shape.split(",") if s) for shape in one.inputs + one.outputs]
    inputs, outputs = shapes[: len(one.inputs)], shapes[len(one.inputs) :]
    types_ = [getattr(numba.types, _DTYPES[code]) for code in one.dtypes]
    arrays = [
        numba.types.Array(kind, max(len(shape), 1), "A" if i < len(inputs) else "C")
        if shape or i >= len(inputs)
        else kind
        for i, (kind, shape) in enumerate(zip(types_, shapes, strict=True))
    ]
    _closure(one.py_func)
    cache &= one.py_func.__module__ in sys.modules  # compiled code finds its module by that name
    body = _for_numba(one.py_func, str(_source(one)) if cache else None)
    builder = GUFuncBuilder(body, "()->()", cache=cache, targetoptions={"nopython": True})
    builder.signature, builder.sin, builder.sout = one.layout, _Shapes(inputs, outputs), outputs
    builder.add(numba.types.none(*arrays))
    return builder.build_ufunc()


def _source(one: Kernel) -> Path:
    """Return the copy of a kernel's file beside its compiled code.

    Numba knows code by the path of its file. This one is the same for every checkout, so equal ones share the code.
    """
    file = one.folder / "source.py"
    if not file.exists():
        file.write_bytes(_bytes(one.py_func.__code__.co_filename))
    return file


@contextmanager
def _locked(folder: Path) -> Iterator[Path | None]:
    """Hold the lock of a cache folder, which is made, while its code is compiled, and yield it. The lock ends with its process.

    Code that is there needs no lock, for Numba's files appear whole. A process that holds the lock too long may have been
    stopped; nobody waits for it. A folder that cannot be written is read: yield a copy of its compiled code, or None if it has
    none. Numba wants to write.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = open(folder / "lock", "a")  # noqa: SIM115 - closed below, when the lock is no longer needed
    except OSError as error:
        compiled = list(folder.glob(_COMPILED))
        if not compiled:
            _warn(folder, error)
            yield None
            return
        with tempfile.TemporaryDirectory() as copy:
            for code in compiled:
                (place := Path(copy) / code.parent.name).mkdir(exist_ok=True)
                (place / code.name).write_bytes(code.read_bytes())
            yield Path(copy)
            if len(list(Path(copy).glob(_COMPILED))) > len(compiled):  # what was there is another machine's
                _warn(folder, error)
        return
    with file:
        end = time.monotonic() + LONGEST_S
        while not any(folder.glob(_CODE)) and not _lock(file) and time.monotonic() < end:
            time.sleep(POLL_S)
        yield folder


def _lock(file: IO[str]) -> bool:
    """Lock a file for this process, if no other one has locked it; return whether it is locked. Without locks it counts so."""
    if fcntl is None:
        return True
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _warn(folder: Path, error: OSError) -> None:
    """Warn that a cache folder cannot be written, once for this process and all that it starts."""
    if os.environ.get(_TOLD) == str(folder.parent):
        return
    os.environ[_TOLD] = str(folder.parent)
    text = f"kernels are compiled in every process anew, because {folder.parent} cannot be written: {error.strerror}"
    warnings.warn(f"{text}; set {FOLDER} to a folder that can", RuntimeWarning, stacklevel=3)


def _interpreted(one: Kernel) -> Callable[..., Any]:
    """Return what runs the body of a kernel in Python, run after run, with the shapes and errors of a gufunc."""
    shapes = [shape.split(",") if shape else [] for shape in one.inputs + one.outputs]
    operands = list(zip(shapes, map(np.dtype, one.dtypes), strict=True))
    inputs, outputs = operands[: len(one.inputs)], operands[len(one.inputs) :]

    def call(*arrays: Any) -> Any:
        given = [np.asarray(a, dtype) for a, (_, dtype) in zip(arrays, inputs, strict=True)]
        sizes = {size: int(size) for shape in shapes for size in shape if size.isdigit()}
        for i, (a, (shape, _)) in enumerate(zip(given, inputs, strict=True)):
            for size, found in zip(shape, a.shape[a.ndim - len(shape) :], strict=True):
                if sizes.setdefault(size, found) != found:
                    text = (
                        f"{one.__name__}: Input operand {i} has a mismatch in its core dimension, with gufunc signature"
                    )
                    raise ValueError(f"{text} {one.layout} (size {found} is different from {sizes[size]})")
        batch = np.broadcast_shapes(*(a.shape[: a.ndim - len(s)] for a, (s, _) in zip(given, inputs, strict=True)))
        given = [
            np.broadcast_to(a, (*batch, *a.shape[a.ndim - len(s) :])) for a, (s, _) in zip(given, inputs, strict=True)
        ]
        made = [np.empty((*batch, *(sizes[size] for size in shape)), dtype) for shape, dtype in outputs]
        filled = [out if shape else out[..., None] for out, (shape, _) in zip(made, outputs, strict=True)]
        for run in np.ndindex(batch):
            one.py_func(*(a[run] for a in given), *(out[run] for out in filled))
        return made[0] if len(made) == 1 else tuple(made)

    return call
