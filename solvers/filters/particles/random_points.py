"""Points of N(0, I) for particle filters: pseudo-random or randomised quasi-random, from a stream of each run's own.

A belief carries one integer key per run. What is drawn depends on that key, the epoch and the purpose alone (a
counter-based generator, Philox): the same belief draws the same points, and a run the same as in any batch.

Quasi-random sets are drawn once and moved afresh at every draw, which leaves each point uniform and each estimate unbiased:
Sobol points of scipy.stats.qmc (scrambled) by a digital shift, scrambled Halton points by a shift modulo one, and the
Halton sequence from a random start. # 000 section 5.3, algorithms 1 and 2 corrected (errata 55, 56)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import ndtri

from sins_env.arrays import Array
from sins_env.checks import refused, whole
from solvers.blocks.conditioning import inverse_lower
from solvers.blocks.square_root import cholesky
from solvers.filters.particles.importance import average

Keys = NDArray[np.int64]

MATCHING = ("pairs", "moments", "none")
EDGE = 1e-12  #: u is kept this far from 0 and 1
BITS = 53


def run_keys(rng: Any, batch: tuple[int, ...]) -> Keys:
    """One key per run, shape ``batch``, from one Generator (in order), or from a sequence with one per run.

    Raises:
        ValueError: anything else, None among it.
    """
    runs = int(np.prod(batch))
    generators = [rng] * runs if isinstance(rng, np.random.Generator) else rng
    right = isinstance(generators, Sequence) and len(generators) == runs
    if not (right and all(isinstance(g, np.random.Generator) for g in generators)):
        given = f"{len(rng)} objects" if isinstance(rng, Sequence) else repr(rng)
        raise ValueError(
            f"rng = {given}: a particle filter draws from numpy Generators; allowed: one, or a sequence with one for each"
            f" of the {runs} runs"
        )
    return np.array([g.integers(2**63 - 1) for g in generators], dtype=np.int64).reshape(batch)


def _streams(keys: Keys, epoch: int, stage: int) -> Iterator[np.random.Generator]:
    """The generator of each run in turn: one object, set to each run's place (0.8 us; a new one costs 20)."""
    bits = np.random.Philox(0)
    state: Any = bits.state
    state["state"]["counter"] = np.array([0, 0, stage, epoch], dtype=np.uint64)
    generator = np.random.Generator(bits)
    for key in keys.reshape(-1):
        state["state"]["key"] = np.array([key, 0], dtype=np.uint64)
        bits.state = state
        yield generator


def uniforms(keys: Keys, epoch: int, stage: int, count: int) -> Array:
    """(*batch, count), uniform on [0, 1), multiples of 2^-53."""
    drawn = [stream.random(count) for stream in _streams(keys, epoch, stage)]
    return np.array(drawn).reshape(*keys.shape, count)


def normals(points: str, keys: Keys, epoch: int, stage: int, count: int, n: int) -> Array:
    """(*batch, count, n) points of N(0, I); ``points`` is a key of ``POINTS``. x = phi^-1(u). # 000 (5.3.8-9)"""
    if points == "random":
        out = np.empty((keys.size, count, n))
        for stream, own in zip(_streams(keys, epoch, stage), out, strict=True):
            stream.standard_normal(out=own)
        return out.reshape(*keys.shape, count, n)
    u = POINTS[points](uniforms(keys, epoch, stage, n), count)
    return np.asarray(ndtri(np.clip(u, EDGE, 1.0 - EDGE, out=u), out=u))


def draw(
    matching: str, points: str, keys: Keys, epoch: int, stage: int, count: int, S: Array, mean: Array | None = None
) -> Array:
    """(*batch, count, n) points of N(mean, S S'), S (..., n, n), matched: with these very moments. #
    docs/mathematics/filters.md#gaussian-particles, erratum 58

    "moments" centres and whitens the points of ``normals``; "pairs" takes each with its mirror image besides, so that all
    odd moments about the mean vanish; "none" leaves them as they were drawn. x = mean + S phi^-1(u). # erratum 56
    """
    n = S.shape[-1]
    drawn = count // 2 if matching == "pairs" else count
    N = normals(points, keys, epoch, stage, drawn, n)
    A = S.mT
    if matching != "none":
        if matching == "moments":
            N -= average(N)
        A = inverse_lower(cholesky(N.mT @ N / drawn)[0]).mT @ A
    x = np.empty((*keys.shape, count, n))
    np.matmul(N, A, out=x[..., :drawn, :])
    if matching == "pairs":
        np.negative(x[..., :drawn, :], out=x[..., drawn:, :])
    if mean is not None:
        x += mean[..., None, :]
    return x


def particle_count(name: str, given: Any, matching: str) -> int:
    """A whole number from 2 on, even where particles come in pairs."""
    pairs = matching == "pairs"
    allowed = f"{'an even' if pairs else 'a'} whole number >= 2 with matching = {matching!r}"
    value = whole(name, given, allowed, least=2)
    if pairs and value % 2:
        raise refused(name, given, allowed)
    return value


def check_enough(count: int, n: int, matching: str) -> None:
    """Raises ValueError for fewer particles than the moments of n states need."""
    needed = {"pairs": 2 * n + 2, "moments": n + 2, "none": 2}[matching]
    if count < needed:
        raise ValueError(f"particles = {count} for {n} states with matching = {matching!r}; allowed: at least {needed}")


def shifted_sobol(u: Array, count: int) -> Array:
    """(*batch, count, n): the scrambled Sobol points, shifted digitally by u (*batch, n)."""
    shift = (u * 2.0**BITS).astype(np.int64)
    return np.multiply(_sobol(count, u.shape[-1]) ^ shift[..., None, :], 2.0**-BITS, dtype=np.float64)


def shifted_halton(u: Array, count: int) -> Array:
    """(*batch, count, n): the scrambled Halton points, shifted modulo one by u (*batch, n)."""
    moved = _halton(count, u.shape[-1]) + u[..., None, :]
    moved -= moved >= 1.0
    return moved


def started_halton(u: Array, count: int) -> Array:
    """(*batch, count, n): Halton's sequence from the start u (*batch, n), u = 0 being its usual one.

    The von Neumann-Kakutani map u -> u + b_k of 000 algorithm 1 (corrected), point after point, is addition of one to
    the number whose digits, mirrored, u has. Here the leading s digits are looked up, p^s >= ``count``, and the map itself
    is taken at most once, for the carry into the digits behind them.
    """
    out = np.empty((*u.shape[:-1], count, u.shape[-1]))
    j = np.arange(count)
    for i, p in enumerate(_primes(u.shape[-1])):
        mirrored = _mirrored(p, count)
        size = len(mirrored)
        lead, behind = np.divmod(u[..., i] * size, 1.0)
        place = mirrored[lead.astype(np.int64)][..., None] + j
        carried = np.where(place < size, behind[..., None], _kakutani(behind, p)[..., None])
        out[..., i] = (mirrored[place % size] + carried) / size
    return out


def _kakutani(u: Array, p: int) -> Array:
    """The next of the sequence: k = floor(-ln(1 - u) / ln p) + 1, u + (p + 1 - p^k) / p^k. # 000 algorithm 1, erratum 55"""
    k = np.floor(-np.log1p(-u) / np.log(p)) + 1.0
    return np.clip(u + (p + 1.0) * p**-k - 1.0, 0.0, 1.0 - 2.0**-BITS)


@cache
def _sobol(count: int, n: int) -> NDArray[np.int64]:
    from scipy.stats import qmc  # slow to import, needed by quasi-random points only

    net = qmc.Sobol(n, bits=BITS, rng=np.random.default_rng(0)).random(1 << (count - 1).bit_length())
    return _shared((net[:count] * 2.0**BITS).astype(np.int64))


@cache
def _halton(count: int, n: int) -> Array:
    from scipy.stats import qmc  # as for Sobol's points

    return _shared(qmc.Halton(n, rng=np.random.default_rng(0)).random(count))


@cache
def _mirrored(p: int, count: int) -> NDArray[np.int64]:
    """The numbers below p^s with their s digits to base p in reverse order, p^s >= ``count``."""
    mirrored = np.zeros(1, dtype=np.int64)
    while len(mirrored) < count:
        mirrored = (p * mirrored + np.arange(p)[:, None]).ravel()
    return _shared(mirrored)


@cache
def _primes(n: int) -> tuple[int, ...]:
    found: list[int] = []
    candidate = 2
    while len(found) < n:
        if all(candidate % p for p in found):
            found.append(candidate)
        candidate += 1
    return tuple(found)


def _shared(array: Any) -> Any:
    array.setflags(write=False)
    return array


#: the quasi-random sets, by name; "random" stands for pseudo-random points
POINTS: dict[str, Callable[[Array, int], Array]] = {
    "sobol": shifted_sobol,
    "halton": shifted_halton,
    "halton_start": started_halton,
}
