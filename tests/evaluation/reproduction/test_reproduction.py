"""Published tables beside ours: statistics, verdicts, and the command from the first run to the file."""

import dataclasses
import math
import sqlite3

import numpy as np
import pytest
from scipy import stats

from sins_env.cli.verbs import reproduce
from sins_env.evaluation import reproduction
from sins_env.evaluation.reproduction import get_table, names
from sins_env.evaluation.reproduction.documents import car_coarse
from sins_env.evaluation.reproduction.showing import estimate_text, markdown
from sins_env.evaluation.reproduction.tables import Group, Line, Table
from sins_env.evaluation.reproduction.verdicts import (
    IN_ORDER,
    LUCK,
    NOT,
    OPEN,
    PRELIMINARY,
    REPRODUCED,
    Estimate,
    Printed,
    PrintedMean,
    PrintedRatio,
    Said,
    band,
    capped_rms,
    mean,
    ratio,
    verdicts,
)
from sins_env.evaluation.score import exact
from sins_env.evaluation.score.losses import score
from sins_env.evaluation.score.verdicts import LEAST_VERDICT
from sins_env.evaluation.store import filling
from sins_env.evaluation.store.store import Store

PLUGIN = "evaluation.plugins:"


@pytest.mark.parametrize("about_mean", [False, True])
def test_a_capped_rms_is_that_of_the_scores(about_mean):
    """Beyond the cap an error counts as the cap, and so does a lost run."""
    x = np.append(3.0 + np.random.default_rng(0).standard_normal(60), [40.0, np.nan])
    away = np.where(np.isnan(x), np.inf, x - np.nanmean(x) if about_mean else x)
    losses = np.minimum(np.abs(away), 10.0) ** 2 * (62 / 61 if about_mean else 1.0)
    found = capped_rms(x, 10.0, about_mean)
    value, interval = score(losses, 10.0)
    assert (found.value, found.low, found.high) == pytest.approx((value, *interval), rel=1e-12)
    assert found.value == pytest.approx(np.sqrt(losses.mean()))
    assert (found.runs, found.lost) == (61, 1)


def test_a_ratio_is_that_of_sign_flips():
    rng = np.random.default_rng(1)
    a, b = np.square(rng.standard_normal((2, 40)))
    found = ratio(a, b, lost=2)
    assert (found.value, (found.low, found.high)) == exact.ratio_by_flips(a, b)
    assert (found.p, found.runs, found.lost) == (exact.sign_flips(a, b), 38, 2)
    assert math.isnan(ratio(a[:19], b[:19]).low)
    assert math.isnan(capped_rms(a[:19], 10.0).low)


def test_two_filters_need_many_runs_and_claims_are_corrected_together():
    """Of four claims p = 0.02 alone is not enough; of fewer than 200 runs none is."""

    def compared(p, runs=LEAST_VERDICT, lost=0):
        return Estimate(0.9, 0.85, 0.98, runs, lost, p=p)

    smaller, alike = Said("smaller", high=1.0), Said("alike", 0.8, 1.25)
    assert verdicts([smaller], [compared(0.02)]) == [REPRODUCED]
    assert verdicts([smaller], [compared(0.02, LEAST_VERDICT - 1)]) == [PRELIMINARY]
    assert verdicts([smaller], [compared(0.02, LEAST_VERDICT - 1, lost=1)]) == [REPRODUCED]
    assert verdicts([smaller] * 4, [compared(p) for p in (0.02, 0.001, 0.03, 0.04)]) == [OPEN, REPRODUCED, OPEN, OPEN]
    assert verdicts([smaller, alike], [compared(0.02), compared(0.9)]) == [REPRODUCED, REPRODUCED]


def test_too_few_runs_have_no_interval_and_no_verdict():
    one = capped_rms(np.array([1.0, np.nan]), 10.0)
    assert math.isnan(one.value)
    assert verdicts([Printed(1.0, 10)], [one]) == ["1 runs are too few"]


def test_one_run_that_decides_leaves_a_print_open():
    """No interval is beyond the cap, and a print that nothing but its width reaches is not reproduced."""
    one = capped_rms(np.append(np.full(39, 0.1), 1e9), 30.0)
    assert one.value == pytest.approx(30.0 / math.sqrt(40), rel=1e-3)
    assert one.low < 3.0
    assert one.high == 30.0
    assert verdicts([Printed(14.0, 1)], [one]) == [OPEN]
    assert verdicts([Printed(8.0, 1)], [one]) == [REPRODUCED]


@pytest.mark.parametrize(("records", "about_mean"), [(10, True), (1, False), (40, False)])
def test_the_band_holds_so_many_prints_of_the_same_law(records, about_mean):
    """95 % of prints, of single records 92.5 %; 0.5 % is a standard error of 2,000 draws."""
    rng = np.random.default_rng(5)
    inside = 0
    for _ in range(2000):
        ours = rng.standard_normal(50)
        spread = 1.96 / math.sqrt(2 * 50)  # of ln of an RMS of normal errors
        value = math.sqrt(np.mean(ours**2))
        estimate = Estimate(value, value * math.exp(-spread), value * math.exp(spread), 50)
        drawn = rng.standard_normal(records)
        size = drawn.std(ddof=1) if about_mean else math.sqrt(np.mean(drawn**2))
        low, high = band(Printed(size, records, about_mean), estimate)
        inside += low <= size <= high
    expected = 0.95 if records > 1 else 0.975 - LUCK
    assert abs(inside / 2000 - expected) < 0.02


def test_verdicts():
    """Ours 1 +- 10 % and 10 +- 10 %; ten records are within 0.54 and 1.46 of the truth."""
    ours = [Estimate(1.0, 0.9, 1.1, 100), Estimate(10.0, 9.0, 11.0, 100)]

    def verdict(*values):
        return verdicts([None if v is None else Printed(v, 10) for v in values], ours)

    assert verdict(0.8, 13.0) == [REPRODUCED, REPRODUCED]
    assert verdict(-0.8, 30.0) == [REPRODUCED, IN_ORDER]  # of a signed error the size counts
    assert verdict(0.3, 30.0) == [IN_ORDER, IN_ORDER]
    assert verdict(20.0, 3.0) == [NOT, NOT]  # the other way round
    assert verdict(3.0, 3.3) == [NOT, NOT]  # the print does not tell them apart
    assert verdict(None, 30.0) == ["", NOT]  # nothing to compare the order with
    assert verdict(1.0, None) == [REPRODUCED, ""]
    ours.append(Estimate(100.0, 90.0, 110.0, 100))
    assert verdict(1.0, 300.0, 100.0) == [
        REPRODUCED,
        NOT,
        REPRODUCED,
    ]  # above the first as ours, but above the last, too


@pytest.mark.parametrize(
    ("printed", "found"),
    [
        (PrintedMean(1.5, 1.0, 50), REPRODUCED),  # +- 0.28, ours +- 0.2
        (PrintedMean(1.6, 1.0, 50), NOT),
        (PrintedMean(1.03, 0.1, 50), NOT),
        (PrintedRatio(1.3), REPRODUCED),
        (PrintedRatio(1.5), IN_ORDER),
        (PrintedRatio(0.97), NOT),
        (Said("above 1", low=1.0), REPRODUCED),
        (Said("above 1.3", low=1.3), OPEN),
        (Said("below 1", high=1.0), NOT),
        (Said("below 1.05", high=1.05), NOT),
    ],
)
def test_verdicts_of_other_prints(printed, found):
    """Ours 1.2 within 1.05 and 1.4."""
    assert verdicts([printed], [Estimate(1.2, 1.05, 1.4, 40)]) == [found]


def test_a_ratio_that_may_be_one():
    assert PrintedRatio(0.97).verdict(Estimate(0.99, 0.95, 1.02, 40)) == OPEN
    assert PrintedRatio(0.80).verdict(Estimate(0.99, 0.95, 1.02, 40)) == NOT


def test_what_is_the_same_is_not_smaller():
    """As the CGPF, which is the CKF bit for bit where measurements are linear."""
    assert Said("smaller", high=1.0).verdict(Estimate(1.0, 1.0, 1.0, 40)) == NOT
    assert Said("smaller", high=1.0).verdict(Estimate(0.9, 0.8, 1.0, 40)) == OPEN


def test_never_is_later_than_any_time():
    never = Estimate(math.inf, math.inf, math.inf, 40)
    assert Said("not in 360", low=360.0).verdict(never) == REPRODUCED
    assert Said("by 320", high=320.0).verdict(never) == NOT
    assert Said("by 320", high=320.0).verdict(Estimate(300.0, 250.0, math.inf, 40)) == OPEN


def test_mean_and_its_interval():
    x = 3.0 + np.random.default_rng(0).standard_normal(30)
    found = mean(np.append(x, np.nan))
    value, (low, high) = exact.mean(x)
    assert found[:5] == (value, low, high, 30, 1)
    expected = stats.ttest_1samp(x, 0.0).confidence_interval()
    assert (low, high) == pytest.approx((expected.low, expected.high), abs=0.05)


def test_a_mean_print_is_a_draw():
    """95 % of prints of 50 records of the same law lie where the verdict wants them; 100 draws, 4 standard errors."""
    rng = np.random.default_rng(7)
    fits = 0
    for _ in range(100):
        theirs = rng.standard_normal(50)
        printed = PrintedMean(float(theirs.mean()), float(theirs.std(ddof=1)), 50)
        fits += printed.verdict(mean(rng.standard_normal(80))) == REPRODUCED
    assert abs(fits / 100 - 0.95) < 4 * math.sqrt(0.05 * 0.95 / 100)


PRINTED_HEADINGS = {
    "6.1": "149.331297 149.368763 149.524905 149.310612 149.352535 149.499154 149.524972 149.483077 149.526320 149.466523",
    "6.2": "28.9356705 28.8113695 28.5946552 28.9697771 28.9584939 28.9490545 28.8616337 28.7983574 28.3434953 28.8553011",
    "6.3": "26.3768094 26.5524438 26.3613203 26.1797361 26.3422044 26.4691438 26.1181718 26.3830417 26.3842662 26.2776165",
}


@pytest.mark.parametrize("number", PRINTED_HEADINGS)
def test_printed_figures_are_those_of_the_printed_headings(number):
    """000 tables 6.1 to 6.3, the first column: what it calls RMS is the deviation from the mean, with n - 1."""
    headings = np.array(PRINTED_HEADINGS[number].split(), dtype=float)
    printed = get_table(number).groups[0].lines[0].printed
    assert printed.value == pytest.approx(headings.std(ddof=1), rel=1e-6)
    assert (printed.records, printed.dof) == (10, 9)


def test_every_table_is_whole():
    for number in names():
        table = get_table(number)
        assert table.number == number
        assert any(line.printed for group in table.groups for line in group.shown) or table.source != "000"
        for group in table.groups:
            assert group.quick == 0 or group.compute or 1 < group.quick <= group.runs
            # a cost takes as long as many runs
            assert not (group.quick and any(line.timed for line in group.lines))
            assert len({line.label for line in group.shown}) == len(group.shown)
    with pytest.raises(ValueError, match=r"unknown table '6\.11'; did you mean '6\.1'\?"):
        get_table("6.11")


@pytest.fixture
def small(short, monkeypatch):
    """A table of two solvers on the short task, and a recording that is not there."""

    def east(results):
        return capped_rms(np.degrees(results.records.final[:, 0]), 180.0)

    def azimuth(results):
        return capped_rms(np.degrees(results.records.final[:, 2]), 180.0)

    absent = dataclasses.replace(car_coarse.RECORDING, kwargs={**car_coarse.RECORDING.kwargs, "recording": "no.npz"})
    reckoning, told = PLUGIN + "DeadReckoning", PLUGIN + "Told"
    lines = (
        Line("reckoning, azimuth", short, reckoning, azimuth, printed=Printed(15.0, 10)),
        Line("reckoning, east", short, reckoning, east, printed=Printed(100.0, 10)),
        Line("told [for ever], azimuth", short, told, azimuth),
    )
    table = Table(
        "9.9",
        "small",
        "000",
        "What it is.",
        (
            Group("short task", "deg", lines, runs=6, quick=3, why="Because."),
            Group("fewer of them", "deg", lines[:1], runs=4, quick=2),
            Group("recorded", "deg", (Line("x", absent, reckoning, azimuth, printed=Printed(1.0, 10)),)),
            Group("all of them", "deg", lines[:1], runs=6, quick=0),
        ),
    )
    monkeypatch.setattr(reproduction, "TABLES", {"9.9": table})
    monkeypatch.setattr(reproduce, "paper", lambda made, *_: f"# Published results\n{markdown(*made[0][:2])}")
    return table


def stored_runs():
    with sqlite3.connect("out/results.sqlite") as db:
        return sorted(db.execute("SELECT solver, count(*), max(session) FROM runs GROUP BY solver"))


def test_the_command(cli, small, tmp_path, monkeypatch):
    """Runs are made once and shared between lines; what is there is kept; the file holds every table so far."""
    monkeypatch.chdir(tmp_path)
    given = ("reproduce", "--out", "out", "--workers", 1)
    code, out, err = cli(*given, "--quick")
    assert code == 0
    assert err == ["tables: out/REPRODUCTION.md"]
    assert "000, table 9.9  small" in out
    assert "short task (deg; 3 runs)" in out
    assert "fewer of them (deg; 2 runs)" in out
    assert "Not run: " in out
    assert "no.npz" in out
    assert "Not run: left out of a quick look (--quick)." in out
    first = stored_runs()
    assert [runs for _, runs, _ in first] == [3, 3]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(filling, "runner", None)  # nothing is run again
        assert cli(*given, "9.9", "--quick")[1] == out
    assert stored_runs() == first
    assert cli(*given, "9.9")[0] == 0
    assert [runs for _, runs, _ in stored_runs()] == [6, 6]

    (tmp_path / "out" / "tables" / "9.8.md").write_text("not a table any more")
    code, out, _ = cli(*given, "9.9", "--runs", 20)
    assert "20 runs" in out
    text = (tmp_path / "out" / "REPRODUCTION.md").read_text()
    assert text.startswith("# Published results")
    assert "not a table any more" not in text
    row = next(line for line in text.splitlines() if line.startswith("| reckoning, azimuth"))
    _, printed, ours, verdict = (cell.strip() for cell in row.strip("|").split("|"))
    assert (printed, verdict) == ("15.0", REPRODUCED)
    value, low, high = (float(part) for part in ours.replace("[", "").replace("]", "").replace(",", "").split())
    assert low < value < high
    assert "| reckoning, east | 100 | " in text
    assert "Because." in text  # the east error of 1 deg is not 100 deg
    assert "| told [for ever], azimuth | - | " in text


def test_wrong_use_of_the_command(cli, small, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for given, text in (
        (("9.8",), "unknown table '9.8'; did you mean '9.9'?"),
        (("--out", "no/where"), "the directory above it does not exist"),
        (("--runs", 0), "allowed: a whole number, at least 1"),
    ):
        code, _, err = cli("reproduce", *given)
        assert code == 2
        assert text in err[0]
    assert not list(tmp_path.iterdir())


def test_an_interrupted_command_goes_on(cli, small, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    given = ("reproduce", "--out", "out", "--workers", 1)
    whole = cli("reproduce", "--out", "whole", "--workers", 1)[1]

    def interrupted(store, key, records):
        if key.solver.endswith("Told"):
            raise KeyboardInterrupt
        add(store, key, records)

    add = Store.add
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Store, "add", interrupted)
        code, out, err = cli(*given)
    assert (code, out) == (130, "")
    assert err == ["sins-env: interrupted: 6 of 12 runs are in out/results.sqlite; the same command continues"]
    assert cli(*given)[1] == whole


def test_near_one_a_quotient_has_three_decimals():
    assert estimate_text(Estimate(0.99999, 0.99996, 1.00001, 40)) == "1.000 [1.000, 1.000]"
    assert estimate_text(Estimate(1.0041, 0.9962, 1.012, 40)) == "1.004 [0.996, 1.012]"
    assert estimate_text(Estimate(1.26, 1.19, 1.334, 40, lost=2)) == "1.26 [1.19, 1.33], 2 lost"
    assert estimate_text(Estimate(1.49, 1.49, 1.49, 0)) == "1.49"
    assert estimate_text(Estimate(1.0, 1.0, 1.0, 40)) == "1.000"
    assert estimate_text(Estimate(math.nan, math.nan, math.nan, 0)) == "-"
    assert estimate_text(Estimate(math.inf, math.inf, math.inf, 40)) == "never"
    assert verdicts([Said("longer", low=1.0)], [Estimate(math.nan, math.nan, math.nan, 0)]) == ["not measured"]
