"""The factor graph around the INS: the invariant filter without iterations, other starts, and what is refused."""

import numpy as np
import pytest
from evaluation.short import SHORT

import solvers
from sins_env.evaluation import evaluate


def test_without_iterations_it_is_the_invariant_filter():
    """Around the INS, with feedback at each fix; with iterations it is another estimate."""

    def final(name, **settings):
        return evaluate(SHORT, name, 3, 5, settings=settings, workers=1, cost=False).records.final

    np.testing.assert_allclose(final("fgo", iterations=0), final("inekf"), rtol=1e-9, atol=1e-12)
    again = final("fgo", window_s=2.0, relinearise_s=5.0)
    assert np.isfinite(again).all()
    assert np.abs(again - final("inekf")).max() > 1e-9


def test_settings_and_starts_that_are_refused():
    assert repr(solvers.make("fgo", window_s=30.0)) == "FGO(window_s=30.0)"
    with pytest.raises(ValueError, match="window_s = 0"):
        solvers.make("fgo", window_s=0.0)
    with pytest.raises(ValueError, match="iterations"):
        solvers.make("fgo", iterations=1.5)
