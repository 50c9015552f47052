"""Points of N(0, I) for particle filters: pseudo-random or randomised quasi-random, with a random stream for each run.

A belief carries one integer key per run. A draw depends only on this key, the epoch and the purpose, by the counter-based
generator Philox. Normal numbers come from SFC64, whose state is three words of Philox, because it is faster. The same belief
thus draws the same points, and a run draws the same points in every batch.

Quasi-random sets are made once and moved afresh at every draw, which keeps each point uniform and each estimate unbiased. There
are three: scrambled Sobol points, moved by a digital shift; scrambled Halton points, moved by a shift modulo one; and Halton's
sequence from a random start. The last is algorithm 1 of 000 section 5.3, with nos. 55 and 56 of docs/mathematics/errata.md.
Equations: docs/mathematics/filters.md#gaussian-particles.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sins_env.arrays import Array
from sins_env.checks import refused, whole
from sins_env.kernels import kernel
from solvers.blocks.conditioning import inverse_lower
from solvers.blocks.square_root import cholesky
from solvers.filters.particles.planes import (
    LANES,
    add_product,
    affine,
    cloud_moments,
    load,
    second_moments,
    store,
)

Keys = NDArray[np.int64]

MATCHING = ("pairs", "moments", "none")
EDGE = 1e-12  #: least distance of a uniform number u from 0 and 1
BITS = 53  #: number of binary digits of a uniform number
UNIT = 2.0**-BITS  #: the last of them


def run_keys(rng: Any, batch: tuple[int, ...]) -> Keys:
    """Return one key per run, shape ``batch``, from one Generator in order, or from a sequence with one per run.

    Raises:
        ValueError: ``rng`` is anything else, such as None.
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


class _Tools(threading.local):
    """The generators of a thread, which are set to the stream of one run after the other, because a new one takes 20 us."""

    def __init__(self) -> None:
        self.counted, self.fast = (np.random.Generator(bits(0)) for bits in (np.random.Philox, np.random.SFC64))
        self.counted_state: Any = self.counted.bit_generator.state
        self.fast_state: Any = self.fast.bit_generator.state


_tools = _Tools()


def _streams(keys: Keys, epoch: int, stage: int) -> Iterator[np.random.Generator]:
    """Yield the generator of each run in turn: one object, set to the run's stream."""
    generator, state = _tools.counted, _tools.counted_state
    state["state"]["counter"] = np.array([0, 0, stage, epoch], dtype=np.uint64)
    for key in keys.reshape(-1):
        state["state"]["key"] = np.array([key, 0], dtype=np.uint64)
        generator.bit_generator.state = state
        yield generator


def _fast_streams(keys: Keys, epoch: int, stage: int) -> Iterator[np.random.Generator]:
    """Yield a generator that starts from each run's stream: SFC64 is a quarter faster than Philox, but has no counter."""
    generator, state = _tools.fast, _tools.fast_state
    for stream in _streams(keys, epoch, stage):
        words: Any = stream.bit_generator
        state["state"]["state"] = np.array([*words.random_raw(3), 1], dtype=np.uint64)
        generator.bit_generator.state = state
        yield generator


def uniforms(keys: Keys, epoch: int, stage: int, count: int) -> Array:
    """Draw numbers (*batch, count), uniform on [0, 1), which are multiples of 2^-53."""
    drawn = [stream.random(count) for stream in _streams(keys, epoch, stage)]
    return np.array(drawn).reshape(*keys.shape, count)


def normals(points: str, keys: Keys, epoch: int, stage: int, count: int, n: int) -> Array:
    """Draw points (*batch, count, n) of N(0, I), x = phi^-1(u): 000 (5.3.8-9).

    ``points`` is "random" or a key of ``POINTS``.
    """
    if points == "random":
        out = np.empty((keys.size, count, n))
        for stream, own in zip(_fast_streams(keys, epoch, stage), out, strict=True):
            stream.standard_normal(out=own)
        return out.reshape(*keys.shape, count, n)
    from scipy.special import ndtri  # slow to import, needed by quasi-random points only

    u = POINTS[points](uniforms(keys, epoch, stage, n), count)
    return np.asarray(ndtri(np.clip(u, EDGE, 1.0 - EDGE, out=u), out=u))


def draw(
    matching: str, points: str, keys: Keys, epoch: int, stage: int, count: int, S: Array, mean: Array | None = None
) -> Array:
    """Draw points (*batch, count, n) of N(mean, S S') with S (..., n, n), x = mean + S phi^-1(u).

    ``matching`` says which of their moments are exact (docs/mathematics/errata.md nos. 56 and 58):

    - "moments": mean and covariance, because the points of ``normals`` are centred and whitened;
    - "pairs": all odd moments about the mean too, because each point has its mirror image;
    - "none": nothing, the points stay as they were drawn.
    """
    n = S.shape[-1]
    if mean is None:
        mean = np.zeros(n)
    if matching == "pairs":
        N = normals(points, keys, epoch, stage, count // 2, n)
        pairs = _pairs(N, S @ inverse_lower(cholesky(second_moments(N))[0]), mean)
        return np.asarray(pairs.reshape(*keys.shape, count, n))
    N = normals(points, keys, epoch, stage, count, n)
    if matching == "none":
        return np.asarray(affine(N, np.zeros(n), S, mean))
    own = cloud_moments(N)
    return np.asarray(affine(N, own.mean, S @ inverse_lower(cholesky(own.cov)[0]), mean))


@kernel("(p,n),(n,n),(n)->(2,p,n)")
def _pairs(N: Array, A: Array, mean: Array, out: Array) -> None:
    """Fill in the points mean + A N and their mirror images."""
    points, n = N.shape
    X, Y, origin = np.empty((n, LANES)), np.empty((n, LANES)), np.zeros(n)
    for start in range(0, points, LANES):
        count = load(N, start, origin, X)
        Y[:] = 0.0
        add_product(A, X, Y)
        for i in range(n):
            for j in range(LANES):
                X[i, j] = mean[i] + Y[i, j]
                Y[i, j] = mean[i] - Y[i, j]
        store(X, start, count, out[0])
        store(Y, start, count, out[1])


MOST_PARTICLES = 1_000_000  #: largest number of particles of a run


def particle_count(name: str, given: Any, matching: str) -> int:
    """Check a number of particles: a whole number >= 2, which is even if particles come in pairs.

    Raises:
        ValueError: any other value.
    """
    pairs = matching == "pairs"
    allowed = f"{'an even' if pairs else 'a'} whole number >= 2 with matching = {matching!r}, at most {MOST_PARTICLES}"
    value = whole(name, given, allowed, least=2, most=MOST_PARTICLES)
    if pairs and value % 2:
        raise refused(name, given, allowed)
    return value


def check_enough(count: int, n: int, matching: str) -> None:
    """Check that there are enough particles for the moments of n states.

    Raises:
        ValueError: there are too few.
    """
    needed = {"pairs": 2 * n + 2, "moments": n + 2, "none": 2}[matching]
    if count < needed:
        raise ValueError(f"particles = {count} for {n} states with matching = {matching!r}; allowed: at least {needed}")


def shifted_sobol(u: Array, count: int) -> Array:
    """Return scrambled Sobol points (*batch, count, n), shifted digitally by u (*batch, n)."""
    shift = (u * 2.0**BITS).astype(np.int64)
    return np.asarray(_digital_shift(_sobol(count, u.shape[-1]), shift))


@kernel("(p,n),(n)->(p,n)", "qqd")
def _digital_shift(net: NDArray[np.int64], shift: NDArray[np.int64], out: Array) -> None:
    """Fill in the points of a net after the exclusive or of their digits with those of the shift."""
    for j in range(len(net)):
        for i in range(len(shift)):
            out[j, i] = float(net[j, i] ^ shift[i]) * UNIT


def shifted_halton(u: Array, count: int) -> Array:
    """Return scrambled Halton points (*batch, count, n), shifted modulo one by u (*batch, n)."""
    moved = _halton(count, u.shape[-1]) + u[..., None, :]
    moved -= moved >= 1.0
    return moved


def started_halton(u: Array, count: int) -> Array:
    """Return Halton's sequence (*batch, count, n) from the start u (*batch, n); u = 0 is the usual start.

    From point to point, the von Neumann-Kakutani map u -> u + b_k of 000 algorithm 1 (docs/mathematics/errata.md no. 55) adds one
    to the number with the mirrored digits of u. Here the leading s digits, p^s >= ``count``, are looked up. The map
    itself is taken at most once, for the carry into the digits behind them.
    """
    out = np.empty((*u.shape[:-1], count, u.shape[-1]))
    j = np.arange(count)
    for i, p in enumerate(_primes(u.shape[-1])):
        mirrored = _mirrored(p, count)
        size = len(mirrored)
        lead, behind = np.divmod(u[..., i] * size, 1.0)
        place = mirrored[lead.astype(np.int64)][..., None] + j
        carried = np.where(place < size, behind[..., None], kakutani(behind, p)[..., None])
        out[..., i] = (mirrored[place % size] + carried) / size
    return out


def kakutani(u: Array, p: int) -> Array:
    """Return the next point of the sequence, u + (p + 1 - p^k) / p^k with k = floor(-ln(1 - u) / ln p) + 1."""
    k = np.floor(-np.log1p(-u) / np.log(p)) + 1.0
    return np.clip(u + (p + 1.0) * p**-k - 1.0, 0.0, 1.0 - 2.0**-BITS)


@cache
def _sobol(count: int, n: int) -> NDArray[np.int64]:
    from scipy.stats import qmc  # slow to import, as above

    net = qmc.Sobol(n, bits=BITS, rng=np.random.default_rng(0)).random(1 << (count - 1).bit_length())
    return _shared((net[:count] * 2.0**BITS).astype(np.int64))


@cache
def _halton(count: int, n: int) -> Array:
    from scipy.stats import qmc  # slow to import, as above

    return _shared(qmc.Halton(n, rng=np.random.default_rng(0)).random(count))


@cache
def _mirrored(p: int, count: int) -> NDArray[np.int64]:
    """Return the numbers below p^s >= ``count`` with their s digits to base p in reverse order."""
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


#: The quasi-random sets by name; "random" in their place means pseudo-random points.
POINTS: dict[str, Callable[[Array, int], Array]] = {
    "sobol": shifted_sobol,
    "halton": shifted_halton,
    "halton_start": started_halton,
}
