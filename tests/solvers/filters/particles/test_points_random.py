"""Random and quasi-random points: independent number theory, statistics with fixed seeds, streams per run."""

from fractions import Fraction

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from solvers.filters.particles import random_points as pr

KEYS = pr.run_keys(np.random.default_rng(5), (6,))
SETS = ["random", *pr.POINTS]


def radical_inverse(number, p):
    u, scale = Fraction(0), Fraction(1)
    while number:
        number, digit = divmod(number, p)
        scale /= p
        u += digit * scale
    return u


def test_halton_from_zero_is_halton():
    got = pr.started_halton(np.zeros((2, 12)), 300)
    expected = qmc.Halton(12, scramble=False).random(300)
    np.testing.assert_allclose(got, np.stack([expected] * 2), atol=1e-14)


@pytest.mark.parametrize("p_index", [0, 1, 4])
def test_halton_from_a_start_counts_on_from_it(p_index):
    """The start's mirrored digits are a whole number; the sequence goes on from that number, in exact arithmetic."""
    p = [2, 3, 5, 7, 11][p_index]
    number = p**11 * 3 // 7 + p**4 - 20  # a carry beyond the digits that are looked up comes soon
    u = np.full((1, 5), 0.3)
    u[0, p_index] = float(radical_inverse(number, p)) + 1e-13  # off the tie of the finite expansion
    got = pr.started_halton(u, 90)[0, :, p_index]
    expected = [float(radical_inverse(number + j, p)) for j in range(90)]
    np.testing.assert_allclose(got, expected, atol=1e-11)


def test_the_map_of_the_thesis():
    """u + (p + 1 - p^k) / p^k with floor: from 0.5 to base 2 comes 0.25, then 0.75, 0.125; the ceiling leaves [0, 1]."""
    sequence = [np.array(0.5)]
    for _ in range(5):
        sequence.append(pr.kakutani(sequence[-1] + 1e-12, 2))
    np.testing.assert_allclose(sequence, [0.5, 0.25, 0.75, 0.125, 0.625, 0.375], atol=1e-10)


def test_sobol_is_the_net_of_scipy_digitally_shifted():
    net = qmc.Sobol(4, bits=53, rng=np.random.default_rng(0)).random(64)
    np.testing.assert_array_equal(pr.shifted_sobol(np.zeros((1, 4)), 64)[0], net)
    moved = pr.shifted_sobol(np.random.default_rng(1).random((3, 4)), 64)
    for columns in moved.transpose(0, 2, 1).reshape(-1, 64):
        np.testing.assert_array_equal(np.sort((columns * 64).astype(int)), np.arange(64))  # one in each 64th


def test_halton_moves_modulo_one():
    base = qmc.Halton(3, rng=np.random.default_rng(0)).random(50)
    u = np.array([[0.0, 0.25, 0.999]])
    np.testing.assert_allclose(pr.shifted_halton(u, 50)[0], (base + u) % 1.0, atol=1e-15)


@pytest.mark.parametrize("points", SETS)
def test_points_are_standard_normal_and_each_is_fresh(points):
    """Over keys, any one point of the set is N(0, I): Kolmogorov-Smirnov, and no correlation."""
    keys = pr.run_keys(np.random.default_rng(3), (3000,))
    N = pr.normals(points, keys, 7, 0, 16, 3)
    for i in (0, 5, 15):
        for j in range(3):
            assert stats.kstest(N[:, i, j], "norm").pvalue > 1e-3
        assert np.abs(np.corrcoef(N[:, i].T) - np.eye(3)).max() < 4.5 / np.sqrt(3000)


@pytest.mark.parametrize("points", list(pr.POINTS))
def test_quasi_random_points_integrate_better(points):
    """Spread of E[cos(x1 + x2)] over keys: at least 4 times below that of pseudo-random points, and unbiased."""
    keys = pr.run_keys(np.random.default_rng(4), (200,))
    found = {}
    for name in ("random", points):
        N = pr.normals(name, keys, 0, 0, 256, 2)
        found[name] = np.cos(N.sum(axis=-1)).mean(axis=-1)
    truth, spread = np.exp(-1.0), found[points].std()
    assert spread < found["random"].std() / 4
    assert abs(found[points].mean() - truth) < 4.5 * spread / np.sqrt(200)


@pytest.mark.parametrize("points", SETS)
def test_a_run_draws_the_same_in_any_batch(points):
    whole = pr.normals(points, KEYS.reshape(2, 3), 11, 2, 20, 4)
    assert whole.shape == (2, 3, 20, 4)
    for i in np.ndindex(2, 3):
        np.testing.assert_array_equal(whole[i], pr.normals(points, KEYS.reshape(2, 3)[i], 11, 2, 20, 4))
    again = pr.normals(points, KEYS.reshape(2, 3), 11, 2, 20, 4)
    np.testing.assert_array_equal(again, whole)


@pytest.mark.parametrize("points", SETS)
def test_epoch_purpose_and_key_tell_draws_apart(points):
    one = pr.normals(points, KEYS, 3, 0, 8, 2)
    for other in (pr.normals(points, KEYS, 4, 0, 8, 2), pr.normals(points, KEYS, 3, 1, 8, 2)):
        assert (other != one).all()
    assert len(np.unique(one[:, 0, 0])) == len(KEYS)


@pytest.mark.parametrize("batch", [(), (3,), (2, 3)])
@pytest.mark.parametrize("points", SETS)
@pytest.mark.parametrize("matching", pr.MATCHING)
def test_matched_points_have_the_moments_they_stand_for(matching, points, batch):
    rng = np.random.default_rng(8)
    keys = pr.run_keys(rng, batch)
    S, mean = np.tril(rng.standard_normal((*batch, 4, 4))), rng.standard_normal((*batch, 4))
    x = pr.draw(matching, points, keys, 2, 1, 60, S, mean)
    error = np.abs(x.mean(axis=-2) - mean).max()
    apart = x - mean[..., None, :]
    off = np.abs(np.swapaxes(apart, -1, -2) @ apart / 60 - S @ np.swapaxes(S, -1, -2)).max()
    third = np.abs((apart**3).mean(axis=-2)).max()
    if matching == "none":
        assert 1e-6 < error < 4.0
        assert off > 1e-6
    else:
        assert max(error, off) < 1e-12
        assert (third < 1e-12) == (matching == "pairs")


def test_keys_come_in_order_from_one_generator_or_one_from_each():
    one = pr.run_keys(np.random.default_rng(0), (4,))
    alone = np.random.default_rng(0)
    assert [int(k) for k in one] == [int(alone.integers(2**63 - 1)) for _ in range(4)]
    many = np.random.default_rng(1).spawn(4)
    np.testing.assert_array_equal(
        pr.run_keys(many, (2, 2)).ravel(),
        [g.integers(2**63 - 1) for g in np.random.default_rng(1).spawn(4)],
    )


@pytest.mark.parametrize(
    ("rng", "given"),
    [
        (None, "rng = None"),
        (3, "rng = 3"),
        ([np.random.default_rng(0)] * 2, "rng = 2 objects"),
        ([None] * 3, "rng = 3"),
    ],
)
def test_a_wrong_source_of_randomness_is_one_clear_error(rng, given):
    with pytest.raises(ValueError, match=f"{given}.*one, or a sequence with one for each of the 3 runs"):
        pr.run_keys(rng, (3,))
