"""Whether a solution is consistent with itself, judged without a reference: by its innovations and by withheld fixes.

The innovation of a fix, divided by its own covariance, is white and has a variance of one if the solver is told the truth.
Three things are measured once the solver knows the heading:

* the mean normalised square (NIS) of velocity and of position in windows of 30 s and at least 30 fixes, in its chi-square band;
* the correlation of neighbouring innovations;
* residuals to fixes that were withheld, over their sigma.

The chance that a true model leaves any chi-square band is 0.1 %. A band is never narrower than a factor that matters, because
real fixes are neither exactly Gaussian nor exactly white. See docs/recordings.md#the-solution-judged-without-a-reference.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array, Mask
from sins_env.evaluation.replay.replaying import Replay
from sins_env.evaluation.replay.told import DOUBT
from sins_env.evaluation.score.consistency import chi2_quantile
from sins_env.recordings import seconds
from sins_env.states import FIX, NAVIGATION

WINDOW_S, LEAST_FIXES = 30.0, 30  #: length of a window, and the least number of its fixes
CHANCE = 1e-3  #: probability that a true model leaves any of the chi-square bands
LEAST_FACTOR = (0.4, 1.6)  #: a mean NIS, over its expectation, within these limits is never told
LEAST_CORRELATION = 0.3  #: a correlation below this is never told
CORRELATION_SIGMAS = 4.0  #: limit of a correlation in its own standard deviations
WITHHELD_SIGMAS = 2.5  #: limit of the RMS of residuals to withheld fixes over their sigma
MOST_DOUBT = 0.5  #: limit of the share of epochs in which the solver doubts the told noise
KNOWN_DEG = 5.0  #: sigma of the heading, deg, below which innovations are judged
_BLOCKS = {"dv": "velocity", "dp": "position"}
_HIGH = (
    "larger than told: fixes or IMU noisier than told (--gps, --imu), axes, units, a clock offset, a wrong lever arm, or a "
    "coarse phase while moving"
)
_LOW = "smaller than told: the fixes are better than told (--gps), and the sigmas too large"
_WANDER = (
    "neighbouring innovations are alike: errors of the fixes wander, as receivers' do, a clock offset, a wrong lever arm, or "
    "gyros worse than told; the sigmas are too small"
)
_FOLLOWS = "neighbouring innovations are alike, as they are when fixes are told noisier than they are: tell better ones (--gps)"


class Warning(NamedTuple):
    """A band that the solution has left."""

    name: str
    value: float
    limit: float
    span_s: tuple[float, float]  #: first and last time that it concerns, s on the recording's clock
    text: str  #: what was found, and what would explain it

    def __str__(self) -> str:
        """Return the warning in one line."""
        span = f"{seconds(round(self.span_s[0], 3))} to {seconds(round(self.span_s[1], 3))} s"
        return f"{self.name}: {self.text} ({self.value:.3g}, limit {self.limit:.3g}; {span})"


class Means(NamedTuple):
    """Mean NIS over the number of components, in windows of fixes; 1 is expected."""

    begin: Array  #: (N,) s in the window of the replay
    end: Array  #: (N,)
    value: Array  #: (N,)
    low: Array  #: (N,) band of the mean
    high: Array  #: (N,)

    @property
    def outside(self) -> Mask:
        """Windows that have left the band, (N,)."""
        return np.asarray((self.value < self.low) | (self.value > self.high))


@dataclass(frozen=True, eq=False, repr=False)
class Consistency:
    """What one window of a replay says against itself."""

    warnings: tuple[Warning, ...]
    t: Array  #: (F,) times of the fixes that were judged, s in the window
    normalised: dict[str, Array]  #: (F, 3) innovations of "velocity" and "position" over their sigma; NaN where missing
    means: dict[str, Means]  #: mean NIS of "velocity" and "position"
    correlation: dict[str, float]  #: correlation of neighbouring innovations
    withheld: tuple[
        tuple[float, float], ...
    ]  #: RMS residual to withheld fixes of each outage, horizontal and vertical, m
    inside: Mask  #: (K,) whether an epoch lies in no span with a warning

    @property
    def consistent(self) -> bool:
        """Whether no band was left."""
        return not self.warnings

    def __repr__(self) -> str:
        return f"<Consistency: {'; '.join(map(str, self.warnings)) or self.summary}>"

    @property
    def summary(self) -> str:
        """The measured values in one line."""
        parts = [f"mean NIS of {name} {one.value.mean():.2f}" for name, one in self.means.items() if len(one.value)]
        parts += [f"correlation {value:+.2f} ({name})" for name, value in self.correlation.items()]
        parts += [f"withheld fixes {hor:.2f} m horizontal, {vert:.2f} m vertical" for hor, vert in self.withheld]
        return "; ".join(parts) or "no innovations are told"


def judge(one: Replay, window: int = 0) -> Consistency:
    """Judge a window of a replay, which keeps what is found."""
    if window not in one.judged:
        one.judged[window] = _judge(one, window)
    found: Consistency = one.judged[window]
    return found


def _judge(one: Replay, window: int) -> Consistency:
    assert one.told is not None
    start = float(one.starts[window])
    k, blocks = _judged(one, window)
    t, inside = one.t[k], np.ones(len(one.t), dtype=bool)
    warnings: list[Warning] = []
    means: dict[str, Means] = {}
    correlation: dict[str, float] = {}
    for name, white in blocks.items():
        means[name] = _means(t, white, len(blocks))
        if one.zero_velocity:  # what stands still may be quieter than told
            means[name] = means[name]._replace(low=np.zeros_like(means[name].low))
        if (found := _nis_warning(name, means[name], start)) is not None:
            warnings.append(found)
            for begin, end in zip(
                means[name].begin[means[name].outside], means[name].end[means[name].outside], strict=True
            ):
                inside &= ~((one.t > begin - 1e-9) & (one.t <= end + 1e-9))
        quiet = bool((means[name].value < means[name].low).any())
        found = _correlation_warning(name, t, white, correlation, start, _FOLLOWS if quiet else _WANDER)
        if found is not None and not one.zero_velocity:  # how a base sways is not white
            warnings.append(found)
            inside &= one.t < t[0]
    withheld = []
    for found_, rms, span in _withheld(one, window):
        withheld.append(rms)
        if found_ is not None:
            warnings.append(found_)
            inside &= ~((one.t > span[0] - 1e-9) & (one.t <= span[1] + 1e-9))
    doubt = one.told.value(DOUBT, window)[-1]
    if doubt > MOST_DOUBT and not one.zero_velocity:
        text = "the solver doubts the told noise in most epochs: --imu or --gps are wrong"
        warnings.append(Warning(DOUBT, float(doubt), MOST_DOUBT, (start, start + float(one.t[-1])), text))
    return Consistency(tuple(warnings), t, blocks, means, correlation, tuple(withheld), inside)


def _judged(one: Replay, window: int) -> tuple[NDArray[np.int64], dict[str, Array]]:
    """Return the epochs (F,) of the fixes that are judged, and their whitened innovations (F, 3) by name."""
    assert one.told is not None
    layout = FIX if one.track is not None else FIX.only("dv")
    nu, S = one.told.innovations(window, layout.size)
    if nu.shape[-1] != layout.size:  # an alignment may be held by the horizontal velocity alone
        layout_parts = {"velocity": slice(0, nu.shape[-1])}
    else:
        layout_parts = {_BLOCKS[name]: layout[name] for name in layout.names}
    sigma = np.degrees(np.sqrt(one.told.cov[window][:, NAVIGATION["phi"], NAVIGATION["phi"]][:, 2, 2]))
    before = np.concatenate([[np.nan], sigma[:-1]])
    k = np.flatnonzero(np.isfinite(nu).any(axis=-1) & (before < KNOWN_DEG))
    found = {name: _whitened(nu[k][:, here], S[k][:, here, here]) for name, here in layout_parts.items()}
    return k, {name: white for name, white in found.items() if np.isfinite(white).any()}


def _whitened(nu: Array, S: Array) -> Array:
    """Return innovations (F, m) with the covariance I; those with a missing component are NaN."""
    there = np.asarray(np.isfinite(nu).all(axis=-1) & np.isfinite(S).all(axis=(-2, -1)))
    unit = np.where(there[:, None, None], S, np.eye(nu.shape[-1]))
    scale = np.sqrt(np.abs(np.diagonal(unit, axis1=-2, axis2=-1)))
    scale = np.where(scale > 0, scale, 1.0)
    values, vectors = np.linalg.eigh(unit / (scale[:, :, None] * scale[:, None, :]))
    along = np.matmul((nu / scale)[:, None, :], vectors)[:, 0]
    white = np.matmul(vectors, (along / np.sqrt(np.maximum(values, 1e-12)))[..., None])[..., 0]
    return np.where(there[:, None], white, np.nan)


def _means(t: Array, white: Array, blocks: int) -> Means:
    """Return the mean NIS in windows of at least WINDOW_S and LEAST_FIXES, with the band at the chance of the whole."""
    here = np.flatnonzero(np.isfinite(white).all(axis=-1))
    nis, at = np.square(white[here]).sum(axis=-1), t[here]
    edges = [0]
    for i in range(len(at)):
        if i + 1 - edges[-1] >= LEAST_FIXES and at[i] - at[edges[-1]] >= WINDOW_S - 1e-6:
            edges.append(i + 1)
    if len(edges) > 1:
        edges[-1] = len(at)  # what is left belongs to the last one
    elif len(at):
        edges.append(len(at))
    m, first, last = white.shape[-1], np.array(edges[:-1], dtype=int), np.array(edges[1:], dtype=int)
    if not len(first):
        return Means(*np.empty((5, 0)))
    dof = m * (last - first)
    tail = CHANCE / (2 * blocks * len(first))
    band = np.array([chi2_quantile(np.array([tail, 1 - tail]), n) / n for n in dof])
    value = np.add.reduceat(nis, first) / dof
    low, high = np.minimum(band[:, 0], LEAST_FACTOR[0]), np.maximum(band[:, 1], LEAST_FACTOR[1])
    return Means(at[first], at[last - 1], value, low, high)


def _nis_warning(name: str, means: Means, start: float) -> Warning | None:
    out = means.outside
    if not out.any():
        return None
    apart = np.where(out, np.abs(np.log(np.maximum(means.value, 1e-300))), -1.0)
    worst = int(apart.argmax())
    high = bool(means.value[worst] > means.high[worst])
    limit = float((means.high if high else means.low)[worst])
    count = f"in {out.sum()} of {len(out)} windows " if len(out) > 1 else ""
    count += f"innovations are up to {math.sqrt(means.value[worst]):.2g} times as large as their sigma, "
    span = (start + float(means.begin[out][0]), start + float(means.end[out][-1]))
    return Warning(f"nis_{name}", float(means.value[worst]), limit, span, f"{count}{_HIGH if high else _LOW}")


def _correlation_warning(
    name: str, t: Array, white: Array, told: dict[str, float], start: float, text: str
) -> Warning | None:
    """Note the correlation of neighbouring innovations, and return the warning if it is too large."""
    there = np.asarray(np.isfinite(white).all(axis=-1))
    pair = there[1:] & there[:-1]
    total = np.square(white[there]).sum()
    count = int(pair.sum()) * white.shape[-1]
    if count < LEAST_FIXES or not total:
        return None
    value = float((white[1:] * white[:-1])[pair].sum() / total * (there.sum() / pair.sum()))
    told[name] = value
    limit = max(CORRELATION_SIGMAS / math.sqrt(count), LEAST_CORRELATION)
    if value <= limit:
        return None
    return Warning(f"whiteness_{name}", value, limit, (start + float(t[0]), start + float(t[-1])), text)


def _withheld(one: Replay, window: int) -> Iterator[tuple[Warning | None, tuple[float, float], tuple[float, float]]]:
    """Yield a warning or None, the RMS residual in m, and the span in s of the window, for each outage with fixes."""
    if one.track is None or one.told is None:
        return
    held, start = one.track.withheld(window), float(one.starts[window])
    for number in np.unique(held.outage):
        here = held.outage == number
        r, k = held.residual[here], held.epoch[here]
        P = one.told.cov[window, k][:, NAVIGATION["dp"], NAVIGATION["dp"]]
        sigma = np.sqrt(np.abs(np.diagonal(P, axis1=-2, axis2=-1)) + np.square(one.track.gps.pos_std))
        value = float(np.sqrt(np.mean(np.square(r / sigma))))
        east, north, up = np.square(r).mean(axis=0)
        span = (float(held.t[here][0]), float(held.t[here][-1]))
        text = "withheld fixes are further off than the sigmas say: IMU noisier than told (--imu), or a wrong start"
        told = (start + span[0], start + span[1])
        found = Warning("withheld_fixes", value, WITHHELD_SIGMAS, told, text) if value > WITHHELD_SIGMAS else None
        yield found, (math.sqrt(east + north), math.sqrt(up)), span


def lines(one: Replay) -> Sequence[str]:
    """Return the warnings of all windows of a replay, a line each; a replay without diagnostics has none."""
    if one.told is None:
        return []
    several = len(one.starts) > 1
    return [
        f"{f'window from {seconds(one.starts[i])} s: ' if several else ''}{found}"
        for i in range(len(one.starts))
        for found in judge(one, i).warnings
    ]
