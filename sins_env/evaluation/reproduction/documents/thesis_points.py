"""Figures 3.2 and 5.1 to 5.3 of 000: points of sigma rules, and quasi-random points beside pseudo-random ones."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from scipy import special

from sins_env.arrays import Array
from sins_env.evaluation.estimators import finding
from sins_env.evaluation.reproduction.pictures.points import Cloud, clouds
from sins_env.evaluation.reproduction.tables import Claim, Group, Table
from sins_env.evaluation.reproduction.verdicts import LARGER, SMALLER, Estimate, ratio

COUNT = 2048  #: number of points of figures 5.2 and 5.3
FEW, DIMENSIONS = 128, 15  #: number of points and of dimensions of figure 5.1
PAIRS = ((1, 2), (5, 6), (9, 10), (13, 14))  #: the dimensions that it shows, counted from 1
DRAWS, QUICK = 200, 10
SIZE = 256  #: number of points whose discrepancy is computed, for it costs their square
SEED = 20110607

Make = Callable[
    [np.random.Generator, int, int], Array
]  #: function from a generator, a count and n to points (count, n)


def _solver(name: str) -> Any:
    """Return an object of the solvers by name, because the evaluation imports none."""
    return finding.find(name)


def halton(rng: np.random.Generator, count: int, n: int) -> Array:
    """Return Halton's sequence from a random start: algorithm 1 of 000, with no. 55 of docs/mathematics/errata.md."""
    found: Array = _solver("solvers.filters.particles.random_points:started_halton")(rng.random(n), count)
    return found


def usual_halton(_: np.random.Generator, count: int, n: int) -> Array:
    """Return Halton's sequence from its usual start."""
    found: Array = _solver("solvers.filters.particles.random_points:started_halton")(np.zeros(n), count)
    return found


def sobol(_: np.random.Generator, count: int, n: int) -> Array:
    """Return Sobol's sequence as it is."""
    from scipy.stats import qmc  # slow to import

    found: Array = qmc.Sobol(n, scramble=False).random(count)
    return found


def pseudo(rng: np.random.Generator, count: int, n: int) -> Array:
    """Return pseudo-random points."""
    return rng.random((count, n))


def discrepancy(points: Array) -> float:
    """Return how far points (N, 2) are from uniform, the centred L2 discrepancy of Hickernell (1998)."""
    from scipy.stats import qmc  # slow to import

    return float(qmc.discrepancy(points))


def uniform(runs: int) -> list[Estimate]:
    """Return the discrepancy of randomised Halton points over that of pseudo-random points, RMS over draws."""
    rng = np.random.default_rng(SEED)
    found = np.array([[discrepancy(make(rng, SIZE, 2)) for make in (halton, pseudo)] for _ in range(runs)])
    return [ratio(*np.square(found).T)]


def worse(_: int) -> list[Estimate]:
    """Return the discrepancy of the last pair of dimensions of figure 5.1 over that of the first pair, without a draw."""
    found = []
    for make in (usual_halton, sobol):
        points = make(np.random.default_rng(SEED), FEW, DIMENSIONS)
        first, last = (discrepancy(points[:, [i - 1, j - 1]]) for i, j in (PAIRS[0], PAIRS[-1]))
        found.append(Estimate(last / first, last / first, last / first, 0))
    return found


def _rule(name: str, n: int = 2, **settings: float) -> tuple[Array, Array]:
    """Return points and weights of a sigma rule."""
    found = _solver(f"solvers.blocks.sigma_rules:{name}")(**settings).build(n)
    return found.xi, found.wm


def _drawn(make: Make, gaussian: bool = False) -> tuple[Array, None]:
    points = make(np.random.default_rng(SEED), COUNT, 2)
    return (special.ndtri(np.clip(points, 1e-12, 1 - 1e-12)) if gaussian else points), None


def _projected(make: Make, i: int, j: int) -> tuple[Array, None]:
    return make(np.random.default_rng(SEED), FEW, DIMENSIONS)[:, [i - 1, j - 1]], None


def _both(gaussian: bool) -> Sequence[Sequence[Cloud]]:
    sets = (("(a) Halton from a random start", halton), ("(b) pseudo-random", pseudo))
    return [[Cloud(title, partial(_drawn, make, gaussian)) for title, make in sets]]


SEQUENCES = (("Halton", usual_halton), ("Sobol", sobol), ("Halton, random start", halton), ("pseudo-random", pseudo))
TABLES = (
    Table(
        "5.points",
        "points of sigma rules, and quasi-random points",
        "000",
        f"Centred L2 discrepancy of points in the unit square, which is zero for none and small for uniform ones: {SIZE} points of "
        f"algorithm 1 against as many pseudo-random ones, and the projections of the first {FEW} points in {DIMENSIONS} "
        "dimensions. The print shows the points without numbers. Faure's sequence of figure 5.1 is in none of our filters or "
        "libraries, and is left out.",
        (
            Group(
                "discrepancy, randomised Halton over pseudo-random",
                "ratio",
                runs=DRAWS,
                quick=QUICK,
                claims=(Claim("algorithm 1 / pseudo-random, 2 dimensions", SMALLER),),
                compute=uniform,
            ),
            Group(
                f"discrepancy, dimensions {PAIRS[-1][0]} and {PAIRS[-1][1]} over dimensions 1 and 2",
                "ratio",
                runs=1,
                quick=1,
                claims=(Claim("Halton, the usual start", LARGER), Claim("Sobol", LARGER)),
                compute=worse,
            ),
        ),
        name="figures 3.2 and 5.1 to 5.3",
        pictures=(
            clouds(
                "figure-3-2",
                "Points of the UKF (kappa = 1) and of the CKF for a Gaussian in two dimensions, with their weights; after figure "
                "3.2. Circle: one standard deviation.",
                [
                    [
                        Cloud("UKF: 2 n + 1 points", partial(_rule, "Unscented", kappa=1.0)),
                        Cloud("CKF: 2 n points of one weight", partial(_rule, "Cubature")),
                    ]
                ],
                (-2.6, 2.6),
                (1.0,),
            ),
            clouds(
                "figure-5-1",
                f"Projections of the first {FEW} points in {DIMENSIONS} dimensions on two of them; after figure 5.1.",
                [
                    [Cloud(f"{name}, {i}-{j}", partial(_projected, make, i, j)) for name, make in SEQUENCES]
                    for i, j in PAIRS
                ],
                (0.0, 1.0),
            ),
            clouds(
                "figure-5-2",
                f"{COUNT} points of algorithm 1 and as many pseudo-random ones; after figure 5.2.",
                _both(gaussian=False),
                (0.0, 1.0),
            ),
            clouds(
                "figure-5-3",
                "The points of figure 5.2 as Gaussian ones, x = phi^-1(u); after figure 5.3. Circles: one to three standard "
                "deviations.",
                _both(gaussian=True),
                (-4.0, 4.0),
                (1.0, 2.0, 3.0),
            ),
        ),
    ),
)
