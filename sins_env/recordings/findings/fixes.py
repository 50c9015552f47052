"""Checks of the fixes against themselves: places that are none, fixes that repeat, and positions against velocities."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env import earth
from sins_env.arrays import Array, Mask
from sins_env.recordings.axes import swap_ned
from sins_env.recordings.findings.finding import Finding
from sins_env.recordings.recording import Gnss, Recording, stated
from sins_env.units import DEG

NULL_RAD, LEAST_HEIGHT_M = 1e-6, -600.0  #: a fix nearer to latitude and longitude 0, or below any land, is no fix
MOVES_M = 1.0  #: displacement between fixes from which on the antenna moves
MOST_HELD = 0.2  #: largest share of fixes that repeat the one before while the antenna moves
LEG_M, LEG_S = 50.0, 20.0  #: least displacement, and time, over which positions and velocities are compared
NOISES = 15.0  #: the same displacement in standard deviations of the noise of the positions
MOST_MISFIT = 0.2  #: largest median difference of displacement and integrated velocity, as a share of the displacement
SURE_MISFIT = 0.04  #: the same if a known mistake explains the difference ``CLEARER`` times better
CLEARER = 3.0
KMH, KNOT = 3.6, 3600.0 / 1852.0


def null_fixes(recording: Recording) -> Iterator[Finding]:
    """Find fixes at latitude 0, longitude 0, or below all land: what receivers write while they have no fix."""
    gnss = recording.gnss
    if gnss is None:
        return
    bad = is_null(gnss)
    if bad.any():
        at = np.flatnonzero(bad)
        text = (
            f"{len(at)} of {len(bad)} fixes with latitude 0 and longitude 0, or a height below {LEAST_HEIGHT_M:g} m: the "
            'receiver had no fix; "drop_null_fixes": true in the mapping leaves them out'
        )
        yield Finding("null_fixes", len(at), 0, "fixes", _span(gnss, at), text)


def is_null(gnss: Gnss) -> Mask:
    """Return which fixes, (M,), are at no place that a receiver can be."""
    return (np.abs(gnss.pos[:, :2]) < NULL_RAD).all(axis=1) | (gnss.pos[:, 2] < LEAST_HEIGHT_M)


def held_fixes(recording: Recording) -> Iterator[Finding]:
    """Find fixes that repeat the one before while the antenna moves: a slow receiver, logged at a faster rate."""
    gnss = recording.gnss
    if gnss is None:
        return
    share = _held_while_moving(gnss)
    if share > MOST_HELD:
        at = np.flatnonzero(is_held(gnss))
        text = (
            f"{100 * share:.0f} % of the fixes repeat the place before them while others move: a receiver of "
            f'{1 / _own_step(gnss):.3g} Hz, logged faster; "drop_held_fixes": true in the mapping keeps each fix once'
        )
        yield Finding("held_fixes", share, MOST_HELD, "", _span(gnss, at), text)


def _changes(gnss: Gnss) -> tuple[NDArray[np.int64], Mask]:
    """Return the fixes at which the place changes, (C,), and whether each of these changes moves the antenna."""
    change = np.flatnonzero((np.diff(gnss.pos, axis=0) != 0).any(axis=1)) + 1
    before = np.concatenate([[0], change])[:-1]
    return change, np.linalg.norm(_displacements(gnss.pos[before], gnss.pos[change]), axis=1) > MOVES_M


def _held_while_moving(gnss: Gnss) -> float:
    """Return the share of the fixes that repeat a place, of those up to changes that move the antenna; 0 if it stands still."""
    change, moves = _changes(gnss)
    fixes = np.diff(change, prepend=0)[moves]  # from one change to the next, with the change itself
    return 1.0 - len(fixes) / fixes.sum() if len(fixes) else 0.0


def _own_step(gnss: Gnss) -> float:
    """Return the median time between changes of the place while the antenna moves, s; NaN with fewer than two changes."""
    change, moves = _changes(gnss)
    steps, moves = np.diff(gnss.t_s[change]), moves[1:]
    return float(np.median(steps[moves] if moves.any() else steps)) if len(steps) else np.nan


def is_held(gnss: Gnss) -> Mask:
    """Return which fixes, (M,), only repeat one of the receiver.

    A place that stays the same while the antenna stands still counts once for each interval of the receiver.
    """
    change = np.concatenate([[0], _changes(gnss)[0]])
    since = gnss.t_s - gnss.t_s[change[np.searchsorted(change, np.arange(len(gnss.t_s)), side="right") - 1]]
    number = np.floor(since / _own_step(gnss) + 1e-6)
    fresh = np.ones(len(number), dtype=bool)
    fresh[1:] = np.diff(number) != 0
    fresh[change] = True
    return ~fresh


_Legs = tuple[NDArray[np.int64], NDArray[np.int64]]  #: first and last fix of each leg


class _Mistake(NamedTuple):
    """A mistake that would explain positions and velocities that disagree."""

    text: str
    pos: Callable[[Array], Array] = lambda pos: pos
    vel: Callable[[Array], Array] = lambda vel: vel


def _swapped(pos: Array) -> Array:
    return pos[:, [1, 0, 2]]


def _degrees(pos: Array) -> Array:
    return pos / [DEG, DEG, 1.0]


_MISTAKES = (
    _Mistake("latitude and longitude are swapped", pos=_swapped),
    _Mistake("latitude and longitude are in rad and were read as degrees", pos=_degrees),
    _Mistake("velocities are East, North, Up where North, East, Down was read, or the other way round", vel=swap_ned),
    _Mistake("velocities are in km/h and were read as m/s", vel=lambda vel: vel / KMH),
    _Mistake("velocities are in knots and were read as m/s", vel=lambda vel: vel / KNOT),
    _Mistake("velocities have the wrong sign", vel=lambda vel: -vel),
)


def positions_and_velocities(recording: Recording) -> Iterator[Finding]:
    """Compare displacements of the positions with integrated velocities, over legs on which the antenna moves."""
    gnss = recording.gnss
    if gnss is None or gnss.vel is None or len(gnss.t_s) < 3:
        return
    good = ~is_null(gnss)
    gnss = Gnss(gnss.t_s[good], gnss.vel[good], gnss.pos[good])
    legs = _legs(gnss.t_s)
    misfit = _misfit(gnss, legs, _Mistake(""))
    if misfit is None or misfit <= SURE_MISFIT:
        return
    others = [(_misfit(gnss, legs, one), one.text) for one in _MISTAKES]
    best, text = min((value, text) for value, text in others if value is not None)
    known = CLEARER * best < misfit
    if not known and misfit <= MOST_MISFIT:
        return
    explained = text if known else "no usual mistake of columns or units explains it"
    share = f"positions move otherwise than velocities say, by {100 * misfit:.0f} % of the way (median)"
    yield Finding(
        "positions_and_velocities",
        misfit,
        SURE_MISFIT if known else MOST_MISFIT,
        "",
        (float(gnss.t_s[0]), float(gnss.t_s[-1])),
        f"{share}: {explained}",
    )


def _legs(t: Array) -> _Legs:
    """Return the fixes at which legs of about ``LEG_S`` begin and end, (legs,) each; none spans a missing fix."""
    step = np.median(np.diff(t))
    size = max(round(LEG_S / step), 1)
    first = np.arange(0, len(t) - size, size)
    last = first + size
    whole = t[last] - t[first] < (size + 0.5) * step
    return first[whole], last[whole]


def _misfit(gnss: Gnss, legs: _Legs, one: _Mistake) -> float | None:
    """Return the median over legs of |displacement - integrated velocity| / the longer of both; None if it never moves."""
    assert gnss.vel is not None
    pos, vel = one.pos(gnss.pos), one.vel(gnss.vel)
    if np.abs(pos[:, 0]).max(initial=0.0) > earth.MAX_LATITUDE:
        return None
    mean = 0.5 * (vel[1:] + vel[:-1]) * np.diff(gnss.t_s)[:, None]
    moved = np.concatenate([np.zeros((1, 3)), np.cumsum(mean, axis=0)])
    first, last = legs
    way = _displacements(pos[first], pos[last])
    told = moved[last] - moved[first]
    size = np.maximum(np.linalg.norm(way, axis=1), np.linalg.norm(told, axis=1))
    moves = size > max(LEG_M, NOISES * _noise(_displacements(pos[:-1], pos[1:]) - mean))
    if moves.sum() < 1:
        return None
    return float(np.median(np.linalg.norm(way - told, axis=1)[moves] / size[moves]))


def _noise(off: Array) -> float:
    """Return the noise of the positions, m, from their steps less those of the velocities, (n, 3).

    White noise of positions makes the steps' differences of variance 6; what both tell apart for long cancels in them.
    """
    spread = 1.4826 * np.median(np.abs(np.diff(off, axis=0)), axis=0) / np.sqrt(6.0)
    return float(np.linalg.norm(spread))


def _displacements(a: Array, b: Array) -> Array:
    """Return the displacements E, N, U, m, from places ``a`` to ``b``, (n, 3) each."""
    return earth.offset(earth.get("wgs84"), a, b)


def _span(gnss: Gnss, at: NDArray[np.int64]) -> tuple[float, float]:
    return float(gnss.t_s[at[0]]), float(gnss.t_s[at[-1]])


def receiver_std(recording: Recording) -> Iterator[Finding]:
    """Count the fixes whose standard deviation is zero in a file that has a place for it: the receiver states none."""
    gnss = recording.gnss
    if gnss is None:
        return
    for what, std in (("positions", gnss.pos_std), ("velocities", gnss.vel_std)):
        if std is not None and not (there := stated(std)).all():
            t, none = gnss.t_s[~there], int((~there).sum())
            text = (
                f"{none} of {len(there)} standard deviations of the {what} are zero, which is what receivers write that have "
                "none; the assumed ones stand in (--gps)"
            )
            yield Finding("receiver_std", none, 0.0, "", (float(t[0]), float(t[-1])), text, False)
