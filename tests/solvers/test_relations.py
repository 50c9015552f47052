"""Filters that must agree, and filters that must not, as their files say: solvers/filters/relations.py."""

import sys

import numpy as np
import pytest
from oracles.problems import look, spd, swing
from oracles.zoo import as_kalman, draws, generators, made, relations

from solvers.filters import FILTERS, make_filter
from solvers.types import Gaussian, Linear, Measurement, Transition

A = np.array([[0.9, 0.1, 0.0, 0.0], [-0.2, 0.9, 0.1, 0.0], [0.0, 0.1, 0.95, 0.0], [0.1, 0.0, 0.0, 0.98]])
H = np.array([[1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.0, 0.5]])

#: problem -> (f, h); swing and look are smooth and far from linear over one standard deviation
PROBLEMS = {
    "nonlinear": (swing, look),
    "nonlinear f": (swing, Linear(H)),
    "linear": (lambda x: x @ A.T, lambda x: x @ H.T),
}

SAME, UNLIKE = relations("SAME_AS"), relations("UNLIKE")
EQUAL = {(name, relation.other) for name, relation in SAME if not (relation.settings or relation.of_other)}
EQUAL |= {(name, name) for name in FILTERS}


def unconditional():
    """What each relation says without its condition, on nonlinear problems: without them SAME_AS would prove nothing."""
    for name, relation in SAME:
        if relation.on != "nonlinear":
            yield name, relation
        elif relation.settings and relation.settings != relation.of_other and (name, relation.other) not in EQUAL:
            yield name, relation._replace(settings={})


def label(name, relation):
    words = [name, *map(str, relation.settings.values()), relation.other, *map(str, relation.of_other.values())]
    return "-".join(words)


def each(pairs):
    return [pytest.param(name, relation, id=label(name, relation)) for name, relation in pairs]


def play(which, problem, runs=3, steps=40):
    """Means (steps, runs, 4) and covariances; filters of one run are looped over."""
    name, settings = which
    flt = make_filter(name, **settings)
    f, h = PROBLEMS[problem]
    rng = np.random.default_rng(42)
    x, P = rng.standard_normal((runs, 4)), spd(rng, runs, 4)
    z = 0.5 * rng.standard_normal((steps, runs, 2))
    Q, R = 0.05 * np.eye(4), 0.5 * np.eye(2)
    if flt.batched:
        return _run(flt, x, P, f, h, Q, R, z)
    each = [_run(flt, x[i], P[i], f, h, Q, R, z[:, i]) for i in range(runs)]
    means, covs = zip(*each, strict=True)
    return np.stack(means, axis=1), np.stack(covs, axis=1)


def _run(flt, x, P, f, h, Q, R, z):
    b = flt.init(Gaussian(x, P), generators(x.shape[:-1]))
    out = []
    for k, z_k in enumerate(z):
        b, _ = flt.step(b, Transition(f, Q), None if k % 5 == 3 else Measurement(z_k, h, R))
        out.append(flt.estimate(b))
    assert not b.health.frozen
    return np.array([e.mean for e in out]), np.array([e.cov for e in out])


def distance(a, b):
    """Largest difference of means and covariances, relative to the largest element."""
    return max(np.abs(u - v).max() / np.abs(v).max() for u, v in zip(a, b, strict=True))


@pytest.mark.parametrize(("name", "relation"), each(SAME))
def test_same(name, relation):
    mine, other = (name, relation.settings), (relation.other, relation.of_other)
    assert distance(play(mine, relation.on), play(other, relation.on)) < relation.within


@pytest.mark.parametrize(("name", "relation"), each([*unconditional(), *UNLIKE]))
def test_different(name, relation):
    mine, other = (name, relation.settings), (relation.other, relation.of_other)
    assert distance(play(mine, "nonlinear"), play(other, "nonlinear")) > 1e-4


@pytest.mark.parametrize("name", FILTERS)
def test_every_filter_says_what_it_equals(name):
    """Its file ends with ``SAME_AS``: solvers/filters/relations.py."""
    file = sys.modules[FILTERS[name].__module__]
    assert name in file.SAME_AS, (
        f"{file.__file__}: SAME_AS[{name!r}] = (Relation(...), ...), or () where it equals no other"
    )
    for constant in ("SAME_AS", "UNLIKE", "VARIANTS"):
        assert set(getattr(file, constant, {})) <= {n for n in FILTERS if FILTERS[n].__module__ == file.__name__}


def test_most_filters_are_kalman_filters_on_linear_problems():
    """The others draw particles, or have no prior covariance: whoever is added here has other oracles of its own."""
    others = {name for name in FILTERS if as_kalman(name) is None}
    assert others == {name for name in FILTERS if draws(name)} | {"mpf"}


@pytest.mark.parametrize("name", [n for n in FILTERS if FILTERS[n].batched])
def test_batch_is_its_runs(name):
    """Row i of a batch is run i alone, through nonlinear functions, to the last bits."""
    flt = made(name)
    rng = np.random.default_rng(1)
    x, P, z = rng.standard_normal((6, 4)), spd(rng, 6, 4), rng.standard_normal((6, 2))
    tr, R = Transition(swing, 0.05 * np.eye(4)), 0.5 * np.eye(2)
    batch, _ = flt.step(flt.init(Gaussian(x, P), generators((6,))), tr, Measurement(z, look, R))
    for i, own in enumerate(generators((6,))):
        one, _ = flt.step(flt.init(Gaussian(x[i], P[i]), own), tr, Measurement(z[i], look, R))
        for whole, alone in zip(flt.estimate(batch), flt.estimate(one), strict=True):
            np.testing.assert_allclose(whole[i], alone, rtol=1e-13, atol=1e-14)
