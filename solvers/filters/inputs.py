"""What a step is given: its shapes are checked, and fixes are brought into the form that the filters take.

``checked_transition`` and ``checked_measurement`` refuse what does not fit and convert what fits in one way only. Afterwards
arrays are arrays, each function is checked at each call, and ``present`` is None or marks the components that are there.
``picked`` leaves the other components out. ``unwound`` brings angles near the fix, so that no rule sees a jump of a full turn.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from sins_env.arrays import Array, Mask
from sins_env.kernels import helper, kernel
from solvers.blocks.square_root import some
from solvers.types import MISSING, Chart, Function, Linear, Measurement, Transition

TURN = 2.0 * math.pi  #: rad, a full turn
BEYOND = 1e-6  #: excess of a covariance over what its variances allow, relative, from which it is refused

Shape = tuple[int, ...]


class _Sound:
    """The bytes of the matrices (n, n) that were last found sound. Models often tell the same at each step, which saves the search.

    An array is compared by its numbers, because its owner may have changed them.
    """

    Q = b""  #: a covariance
    R = b""  #: a covariance without missing components


def checked_transition(tr: Transition, batch: Shape, n: int) -> Transition:
    """Return the transition of ``n`` states with Q as an array and a function that is checked at each call.

    Raises:
        ValueError: a shape that does not fit, a Q that is no covariance, or a negative dt.
    """
    f, Q, G, dt = tr
    if type(Q) is not np.ndarray or Q.tobytes() != _Sound.Q or Q.shape != (n, n) or Q.dtype.char != "d":
        Q = covariance("Q", Q, batch, n)
        _Sound.Q = Q.tobytes() if Q.ndim == 2 else b""
    if dt is not None and not dt >= 0.0:
        raise ValueError(f"dt = {dt!r}: needed the seconds of the epoch, >= 0, or None")
    if G is not None and (np.ndim(G) != 2 or np.shape(G)[0] != n):
        raise ValueError(f"G of shape {np.shape(G)}: needed ({n}, p), a column for each of the p driven directions")
    g = _linear("f", f, batch, n, n) if type(f) is Linear else Checked("f", f, n)
    return tr if g is f and Q is tr.Q else Transition(g, Q, G, dt)


def checked_measurement(me: Measurement, batch: Shape, n: int) -> Measurement:
    """Return the measurement with z (..., m) and R as arrays, and ``present`` (..., m) if any component is missing.

    A component is missing if ``present`` says so, if its z is NaN, or if its variance in R is ``MISSING`` or more.

    Raises:
        ValueError: a shape that does not fit, an R that is no covariance, or a law that is none.
    """
    z, h, R, law, told, turns, chart = me
    if chart is not None:
        z, h = _in_tangent(z, h, chart, batch, n)
    if type(z) is not np.ndarray or not z.ndim or z.dtype != np.float64:
        z = np.atleast_1d(numbers("z", z))
    if type(h) is Linear:
        h = _linear("h", h, batch, None, n)
        m = h.matrix.shape[-2]
    else:
        m = z.shape[-1]
        h = Checked("h", h, m)
    if z.shape != (*batch, m):
        z = _vector("z", z, batch, m)
    if law is not None and not (0.0 <= law.share <= 1.0 and law.factor > 0.0 and law.dof >= 0.0):
        raise ValueError(f"law = {law!r}: needed a share from 0 to 1, a factor > 0 and a dof >= 0")
    if told is not None:
        z = np.where(_vector("present", told, batch, m, bool), z, np.nan)
    if turns is not None:
        turns = _vector("turns", turns, (), m, bool)
    there = None if m else np.ones(z.shape, dtype=bool)  # a fix without components is none
    known = type(R) is np.ndarray and R.tobytes() == _Sound.R and R.shape == (m, m) and R.dtype.char == "d"
    if not known or not math.isfinite(np.vdot(z, z)):
        R = square("R", R, batch, m)
        found = _found(z, R)
        if not np.count_nonzero(found):
            _Sound.R = R.tobytes() if R.ndim == 2 else b""
        elif np.count_nonzero(found == IMPROPER):
            _refuse_covariance("R", R)
        else:
            there = found != MISSES
    same = chart is None and z is me.z and h is me.h and R is me.R and there is told and turns is me.turns
    return me if same else Measurement(z, h, R, law, there, turns)


MISSES, IMPROPER = 1, 2  #: what ``_found`` tells of a component: it is missing, or R is no covariance


@helper
def _improper(P: Array, i: int) -> bool:
    """Return whether row i of P, up to its diagonal, belongs to no covariance; NaN belongs to any."""
    if P[i, i] != P[i, i]:
        return False
    if P[i, i] < 0.0:
        return True
    for j in range(i):
        a, b, c = P[i, i], P[j, j], P[i, j]
        if b != b or c != c or P[j, i] != P[j, i]:  # else the comparisons below would raise a flag
            continue
        t = a if a > b else b
        if c * c > (1.0 + BEYOND) * a * b + 1e-12 * t * t or abs(c - P[j, i]) > BEYOND * t:
            return True
    return False


@kernel("(n,n)->()", "d?")
def improper(P: Array, out: Mask) -> None:
    """Return whether P (..., n, n) is no covariance: a negative variance, a correlation beyond 1, or not symmetric."""
    out[0] = False
    for i in range(len(P)):
        if _improper(P, i):
            out[0] = True


@kernel("(m),(m,m)->(m)", "ddq")
def _found(z: Array, R: Array, out: Any) -> None:
    """Fill in what is wrong with each component of a fix: nothing is 0."""
    for i in range(len(z)):
        out[i] = 0
        if _improper(R, i):
            out[i] = IMPROPER
        elif z[i] != z[i] or R[i, i] >= MISSING:
            out[i] = MISSES


def numbers(name: str, given: Any, dtype: type = float) -> Any:
    """Return numbers as an array; those that a mask hides are NaN.

    Raises:
        ValueError: complex numbers.
    """
    a: Any = np.ma.filled(given.astype(float), np.nan) if isinstance(given, np.ma.MaskedArray) else np.asarray(given)
    if a.dtype.kind == "c":
        raise ValueError(f"{name} is complex: needed real numbers")
    return np.asarray(a, dtype=dtype)


def square(name: str, given: Any, batch: Shape, n: int) -> Array:
    """Return a matrix (n, n) for all runs, or (*batch, n, n), as an array; for n = 1 a single number is one.

    Raises:
        ValueError: another shape.
    """
    if type(given) is np.ndarray and given.shape == (n, n) and given.dtype == np.float64:
        return given
    a = numbers(name, given)
    if n == 1 and a.size == 1 and a.ndim < 2:
        a = a.reshape(1, 1)
    if a.shape not in ((n, n), (*batch, n, n)):
        hint = f"; variances alone are np.diag({name})" if a.shape == (n,) else ""
        raise ValueError(f"{name} of shape {a.shape}: needed {_either((n, n), batch)}{hint}")
    return a


def _either(shape: tuple[Any, ...], batch: Shape) -> str:
    """Return the shapes that are allowed: one for all runs, or one for each."""
    one = f"({', '.join(map(str, shape))}{',' if len(shape) == 1 else ''})"
    return f"{one} for all runs, or ({', '.join(map(str, (*batch, *shape)))}) with one for each" if batch else one


def covariance(name: str, given: Any, batch: Shape, n: int) -> Array:
    """Return what ``square`` does.

    Raises:
        ValueError: another shape, or no covariance.
    """
    P = square(name, given, batch, n)
    if some(improper(P)):
        _refuse_covariance(name, P)
    return P


def _vector(name: str, given: Any, batch: Shape, m: int, dtype: type = float) -> Any:
    a = numbers(name, given, dtype)
    if a.shape not in ((m,), (*batch, m)):
        raise ValueError(f"{name} of shape {np.shape(given)}: needed {_either((m,), batch)}")
    return np.broadcast_to(a, (*batch, m))


def _refuse_covariance(name: str, P: Array) -> None:
    run = tuple(np.argwhere(improper(P))[0].tolist())
    where = f" of run {run}" if run else ""
    raise ValueError(
        f"{name}{where} is no covariance: {P[run].tolist()}; allowed: symmetric, with variances >= 0 and no correlation"
        " beyond 1"
    )


def _linear(name: str, g: Linear, batch: Shape, m: int | None, n: int) -> Linear:
    """Return a linear map (..., n) -> (..., m) with a matrix and an offset that fit; m = None: any m."""
    M, c = g
    if type(M) is not np.ndarray or M.dtype.char != "d":
        M = numbers(f"matrix of {name}", M)
    rows = M.shape[-2] if m is None and M.ndim > 1 else m
    if M.shape != (rows, n) and M.shape != (*batch, rows, n):
        raise ValueError(f"matrix of {name} of shape {M.shape}: needed {_either((m or 'm', n), batch)}")
    if c is not None and (
        type(c) is not np.ndarray or c.shape[-1:] != M.shape[-2:-1] or c.shape[:-1] not in ((), batch)
    ):
        c = _vector(f"offset of {name}", c, batch, M.shape[-2])
    return g if M is g.matrix and c is g.offset else Linear(M, c)


#: What ``Checked._refuse_one_run`` has compared, by code and shape; how far aside of x it looks, and how much is another result.
_COMPARED: set[Any] = set()
GOLDEN, ASIDE, DIFFERS = 0.6180339887498949, 0.05, 1e-5


def _code(g: Any) -> Any:
    """Return what a function shares with those that the same lines of code make anew at each step."""
    while isinstance(g, partial):
        g = g.func
    code = getattr(g, "__code__", None)
    if code is None:
        return type(g)
    held = []
    for cell in g.__closure__ or ():
        with suppress(ValueError):  # a cell that is still empty
            held.append(getattr(cell.cell_contents, "__code__", None))
    return code, *held


class Checked:
    """A function (..., n) -> (..., size) whose results are checked, and which cannot change its argument.

    Raises:
        ValueError: at a call, a result of another shape.
    """

    __slots__ = ("_both", "_g", "_name", "_size", "_slope")

    def __init__(self, name: str, g: Function, size: int) -> None:
        if not callable(g):
            raise ValueError(f"{name} is of type {type(g).__name__}: needed a function, or Linear(matrix) for a matrix")
        self._name, self._g, self._size = name, g, size
        self._slope: Any = getattr(g, "jacobian", None)
        self._both: Any = getattr(g, "value_and_jacobian", None)

    @property
    def jacobian(self) -> Any:
        """The Jacobian of the function, checked; None if it has none."""
        return None if self._slope is None else self._checked_slope

    @property
    def value_and_jacobian(self) -> Any:
        """The function for both, checked; None if it has none."""
        return None if self._both is None else self._checked_both

    def _checked_slope(self, x: Array) -> Array:
        return self._fitting_slope(x, self._slope(x))

    def _checked_both(self, x: Array) -> tuple[Array, Array]:
        y, J = self._both(x)
        return self._fitting(x, y), self._fitting_slope(x, J)

    def _fitting_slope(self, x: Array, J: Any) -> Array:
        """Return the Jacobian at x (..., n) as an array (..., size, n), or (size, n) for all."""
        needed = self._size, x.shape[-1]
        if type(J) is not np.ndarray or J.dtype.char != "d":
            J = numbers(f"Jacobian of {self._name}", J)
        if J.shape[-2:] != needed or J.ndim > x.ndim + 1:
            whole = (*x.shape[:-1], *needed)
            or_one = "" if whole == needed else f", or {needed} for all runs and points"
            raise ValueError(f"Jacobian of {self._name} at x {x.shape} has the shape {J.shape}: needed {whole}{or_one}")
        return J

    def __call__(self, x: Array) -> Array:
        if x.ndim > 1 and x.shape[-1] in x.shape[:-1]:
            self._refuse_one_run(x)
        seen = x.view()
        seen.setflags(write=False)
        try:
            y = self._g(seen)
        except ValueError:  # a function that works in place gets an array of its own; another one fails again
            y = self._g(x.copy())
        y = self._fitting(x, y)
        return x.copy() if y is seen else y

    def __getattr__(self, name: str) -> Any:
        """Return what else the function has."""
        if name in Checked.__slots__:
            raise AttributeError(name)
        return getattr(self._g, name)

    def _fitting(self, x: Array, y: Any) -> Array:
        """Return the values at x (..., n) as an array (..., size)."""
        needed = *x.shape[:-1], self._size
        if type(y) is not np.ndarray or y.dtype.char != "d":
            y = numbers(self._name, y)
        if y.shape == needed:
            return y
        raise ValueError(
            f"{self._name} of x {x.shape} has the shape {y.shape}: needed {needed}. A function acts on the last axis, x[..., i],"
            " for all points and runs at once, and its result has a last axis too"
        )

    def _refuse_one_run(self, x: Array) -> None:
        """Refuse a function of one run, x[i] for x[..., i], whose result has the right shape because there are n runs or points.

        Functions are compared once for each code and shape, which takes three more calls.
        """
        seen = _code(self._g), x.shape
        if seen in _COMPARED:
            return
        if self._alone_differs(x):
            raise ValueError(
                f"{self._name} of x {x.shape} gives the first row another result than alone, as a function of one run does."
                " A function acts on the last axis, x[..., i], for all points and runs at once"
            )
        _COMPARED.add(seen)

    def _alone_differs(self, x: Array) -> bool:
        """Return whether the first row alone has another result, at states near x without symmetry.

        It is False for a function that one row does not fit, such as one bound to its batch, or that varies from call to call.
        """
        first = (0,) * (x.ndim - 1)
        aside = np.modf(GOLDEN * np.arange(1.0, x.size + 1.0))[0].reshape(x.shape)
        near = x + ASIDE * (1.0 + np.abs(x)) * (1.0 + aside)
        try:
            together, again, alone = (np.array(self._g(a.copy()), dtype=float) for a in (near, near, near[first]))
        except Exception:  # whatever a function raises that takes no single row
            return False
        if together.shape != (*x.shape[:-1], self._size) or alone.shape != (self._size,) or (together != again).any():
            return False
        size = max(np.abs(together[first]).max(initial=0.0), np.abs(alone).max(initial=0.0))
        return bool(np.abs(together[first] - alone).max(initial=0.0) > DIFFERS * size)


def checked_function(name: str, g: Function, batch: Shape, m: int, n: int) -> Function:
    """Return a function (..., n) -> (..., m) that takes runs and points, and whose results are checked.

    Raises:
        ValueError: a shape that does not fit, here or at a call.
    """
    return _AtPoints(_linear(name, g, batch, m, n), len(batch)) if isinstance(g, Linear) else Checked(name, g, m)


def _in_tangent(z: Any, h: Function, chart: Chart, batch: Shape, n: int) -> tuple[Array, Function]:
    """Return a fix that is a point as the origin of the tangent there, and what shows a state in it.

    A component that is NaN there is missing.
    """
    z = np.atleast_1d(numbers("z", z))
    z = _vector("z", z, batch, z.shape[-1])
    return 0.0 * chart.minus(z, z), _InTangent(checked_function("h", h, batch, z.shape[-1], n), z, chart)


class _InTangent:
    """A function whose values, points (..., p), are shown in the tangent at the point z (..., p)."""

    def __init__(self, h: Function, z: Array, chart: Chart) -> None:
        self._h, self._z, self._chart = h, z, chart

    def __call__(self, x: Array) -> Array:
        y = self._h(x)
        return self._chart.minus(y, self._z if y.ndim == self._z.ndim else self._z[..., None, :])


class _AtPoints:
    """A checked linear function as one of runs (*batch, n) and of points (*batch, points, n)."""

    def __init__(self, g: Linear, axes: int) -> None:
        self._g, self._axes = g, axes  #: number of batch axes

    def __call__(self, x: Array) -> Array:
        M, c = self._g
        if x.ndim == self._axes + 1:
            return self._g(x)
        y = x @ M.mT
        return y if c is None else y + (c if c.ndim == 1 else c[..., None, :])


class _Picked:
    """Some components of a function."""

    def __init__(self, g: Function, rows: Any) -> None:
        self._g, self._rows = g, rows
        jacobian, both = getattr(g, "jacobian", None), getattr(g, "value_and_jacobian", None)
        self.jacobian = None if jacobian is None else lambda x: jacobian(x)[..., rows, :]
        self.value_and_jacobian = None if both is None else self._both

    def _both(self, x: Array) -> tuple[Array, Array]:
        y, J = self._g.value_and_jacobian(x)  # type: ignore[attr-defined]
        return y[..., self._rows], J[..., self._rows, :]

    def __call__(self, x: Array) -> Array:
        return self._g(x)[..., self._rows]


def picked(me: Measurement, rows: Mask) -> Measurement:
    """Return a checked measurement of the components in the mask (m,) alone."""
    at = np.flatnonzero(rows)
    h: Function = _Picked(me.h, at)
    if isinstance(me.h, Linear):
        h = Linear(me.h.matrix[..., at, :], None if me.h.offset is None else me.h.offset[..., at])
    turns = None if me.turns is None else me.turns[at]
    return me._replace(z=me.z[..., at], h=h, R=me.R[..., at[:, None], at], present=None, turns=turns)


def patterns(there: Mask) -> Iterator[tuple[Mask, Mask]]:
    """Yield the components (m,) that some runs have, with the mask (...) of these runs; ``there`` is (..., m).

    Runs without any component are left out.
    """
    if not there.shape[-1]:
        return
    for rows in np.unique(there.reshape(-1, there.shape[-1]), axis=0):
        if rows.any():
            yield rows, np.asarray((there == rows).all(axis=-1))


def wrapped(residual: Array, turns: Mask | None) -> Array:
    """Return residuals (..., m) with the angles among them, ``turns`` (m,), within half a turn."""
    return residual if turns is None else residual - turns * TURN * np.round(residual / TURN)


class Unwound:
    """A function whose angles do not jump between the points of a call, with the first point within half a turn of z."""

    def __init__(self, g: Function, z: Array, turns: Mask) -> None:
        self.g, self.z, self.turns = g, z, turns
        if isinstance(g, Linear):
            self._values: Function = _AtPoints(g, z.ndim - 1)
            self.jacobian: Any = lambda x: g.matrix
        else:
            self._values, self.jacobian = g, getattr(g, "jacobian", None)

    def __call__(self, x: Array) -> Array:
        y = self._values(x)
        if x.ndim == self.z.ndim:  # runs, not points
            return self.z - wrapped(self.z - y, self.turns)
        z, first = self.z[..., None, :], y[..., :1, :]
        return z - wrapped(z - first, self.turns) + wrapped(y - first, self.turns)


def unwound(me: Measurement, x: Array | None) -> Measurement:
    """Return the measurement with a function whose angles lie near z.

    ``x`` (..., n) is the mean of a belief with one mean: a ``Linear`` h then stays one. Otherwise it is None.
    """
    if me.turns is None or not me.turns.any():
        return me
    if x is None or not isinstance(me.h, Linear):
        return me._replace(h=Unwound(me.h, me.z, me.turns))
    y = me.h(x)
    near = me.z - wrapped(me.z - y, me.turns)
    offset = near - y if me.h.offset is None else near - y + me.h.offset
    return me._replace(h=Linear(me.h.matrix, offset))
