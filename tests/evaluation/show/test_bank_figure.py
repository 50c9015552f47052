"""The figure of a bank: slices by weight, and probabilities that are stacked to one."""

import numpy as np

import solvers
from sins_env.evaluation.show.bank_figure import LARGEST, bank_figure


def test_slices_models_and_regimes_over_time():
    solver = solvers.make("gsf_imm", fix_factors=[1.0, 10.0], imu_factors=[[1.0, 1.0], [30.0, 0.01]])
    models, regimes = solver.labels.values()
    assert models == ["gyros x 1, accelerometers x 1", "gyros x 30, accelerometers x 0.01", "offset of the fixes"]
    assert regimes == ["fixes x 1", "fixes x 10"]
    one = {
        "slice_weights": np.array([0.7, 0.3, 0.0]),
        "slice_headings_rad": np.array([0.5, -0.5, np.nan]),
        "model_probabilities": np.array([0.8, 0.1, 0.1]),
        "regime_probabilities": np.array([0.4, 0.6]),
    }
    figure = bank_figure([1.0, 2.0], [one, one], solver.labels, "a bank")
    top, middle, bottom = figure.axes
    dots = top.collections[0]
    np.testing.assert_allclose(dots.get_offsets()[:2], [[1.0, np.degrees(0.5)], [1.0, np.degrees(-0.5)]])
    np.testing.assert_allclose(dots.get_sizes()[:2], LARGEST * np.array([0.7, 0.3]))
    assert len(dots.get_offsets()) == 4
    for axes, labels in ((middle, models), (bottom, regimes)):
        assert [text.get_text() for text in axes.get_legend().get_texts()] == labels
        assert max(path.get_paths()[0].vertices[:, 1].max() for path in axes.collections) == 1.0
