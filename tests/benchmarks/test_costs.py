"""benchmarks/costs.py as users run it, on a few filters and for a moment."""

import runpy

import pytest
from places import ROOT

COSTS = ROOT / "benchmarks" / "costs.py"


@pytest.fixture(scope="module")
def costs():
    return runpy.run_path(str(COSTS))


def test_the_table_has_every_filter_at_every_size(costs, capsys):
    costs["main"](["kf", "ckf", "filterpy_kf", "--runs", "1", "3", "--seconds", "0.01"])
    shown = capsys.readouterr().out
    for name in ("kf", "ckf", "filterpy_kf"):
        assert sum(line.split("│")[1].strip() == name for line in shown.splitlines() if line.startswith("│")) == 1
    assert "one run only" in shown
    assert "3 runs" in shown


def test_a_filter_that_fails_is_shown_and_the_others_go_on(costs, capsys, monkeypatch):
    from solvers.filters.kalman.ekf import EKF

    def broken(self, b, tr):
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr(EKF, "predict", broken)
    costs["main"](["ekf", "kf", "--runs", "1", "--seconds", "0.01"])
    shown = capsys.readouterr().out
    assert "ZeroDivisionError: on purpose" in shown
    assert "│ kf " in shown


def test_a_slow_filter_is_timed_for_one_pair_of_blocks(costs, monkeypatch):
    import time

    from solvers.filters.kalman.kf import KF

    recorded = costs["record"]("sway-white-v0", 1)
    assert recorded.prior.mean.shape == (10,)
    predict = KF.predict

    def slow(self, b, tr):
        until = time.process_time() + 0.05
        while time.process_time() < until:
            pass
        return predict(self, b, tr)

    monkeypatch.setattr(KF, "predict", slow)
    found = costs["cost"]("kf", recorded, 0.0)
    assert found.pairs == 1
    assert found.step_us == pytest.approx(50e3, rel=0.2)
    assert found.ratio > 20.0


def test_an_unknown_filter_is_refused(costs, capsys):
    with pytest.raises(SystemExit):
        costs["main"](["kcf"])
    assert "unknown filter 'kcf'; did you mean" in capsys.readouterr().err
