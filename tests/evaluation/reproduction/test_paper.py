"""REPRODUCTION.md around the tables: every line that its words ask for is there, and nothing else is said than was run."""

import re

import pytest

from sins_env.evaluation import reproduction
from sins_env.evaluation.reproduction.claims import CLAIMS
from sins_env.evaluation.reproduction.paper import Found, Papers, paper
from sins_env.evaluation.reproduction.running import Made, first_look
from sins_env.evaluation.reproduction.tables import Outcome
from sins_env.evaluation.reproduction.verdicts import IN_ORDER, NOT, OPEN, REPRODUCED, Estimate, verdicts
from sins_env.evaluation.store.store import Store


def outcome(group, value=0.8, missing=""):
    if missing:
        return Outcome(group, (), (), missing)
    ours = tuple(Estimate(value, 0.8 * value, 1.1 * value, 40, bound=0.5) for _ in group.shown)
    return Outcome(group, ours, tuple(verdicts([line.printed for line in group.shown], ours)))


def made(**how):
    tables = [reproduction.get_table(number) for number in reproduction.printed()]
    return [Made(table, tuple(outcome(group, **how) for group in table.groups), ()) for table in tables]


@pytest.fixture
def store(tmp_path, short):
    """A file with a run, for who made it and where."""
    from sins_env.evaluation.store.filling import Evaluation, fill

    with Store(tmp_path / "runs.sqlite") as store:
        store.add_task(short)
        fill(store, [Evaluation.of(short, "evaluation.plugins:Told", {}, range(2), None)], workers=1)
        yield store


def anchors(text):
    """Of the sections, as GitHub makes them."""
    titles = [line.removeprefix("## ").lower() for line in text.splitlines() if line.startswith("## ")]
    return [re.sub(r"[^a-z0-9 -]", "", title).replace(" ", "-") for title in titles]


@pytest.mark.parametrize("quick", [True, False])
def test_the_paper_has_every_table_and_claim(store, quick):
    text = paper(made(), store, quick)
    for number in reproduction.printed():
        assert f"### {reproduction.get_table(number).heading}: " in text
    for claim in CLAIMS:
        assert re.search(
            rf"\| {claim.document} \| {re.escape(claim.text)} \| [^|]+ \| 0\.800 \[0\.640, 0\.880\] \| ", text
        )
    assert ("quick look" in text) == quick
    assert "{{" not in text
    assert "{%" not in text
    for target in re.findall(r"\]\(#([^)]*)\)", text):
        titles = [
            re.sub(r"[^a-z0-9 -]", "", line.lstrip("# ").lower()).replace(" ", "-")
            for line in text.splitlines()
            if line.startswith("## ")
        ]
        assert target in titles


def test_a_quick_look_says_nothing_of_what_it_leaves_out(store):
    tables = [first_look(reproduction.get_table(number)) for number in reproduction.printed()]
    quick = [
        Made(table, tuple(outcome(group, missing="" if group.quick else "left out") for group in table.groups), ())
        for table in tables
    ]
    text = paper(quick, store, True)
    assert "a step of DDF2 takes longer" not in text
    assert "RQMC-GPF beats GPF" not in text
    assert "GPF beats the UKF" in text
    assert "(table 5.2)" not in text
    assert "GPF / UKF, azimuth, quotient (table 5.1)" in text
    assert "| MCC-HCKF, sigma 3 |" in text
    assert "| MCC-HCKF, sigma 4 |" not in text
    assert "figures/table-3-1.svg" not in text
    with pytest.raises(ValueError, match="0 groups"):
        paper(quick, store, False)


def test_every_figure_of_the_paper_is_drawn(store):
    drawn = {picture.name for number in reproduction.printed() for picture in reproduction.get_table(number).pictures}
    shown = re.findall(r"\(figures/([^)]*)\.svg\)", paper(made(), store, False))
    assert set(shown) == drawn


def test_without_the_recordings_the_paper_says_so(store):
    tables = made()
    tables = [
        one._replace(
            outcomes=tuple(
                outcome(o.group, missing="no recording") if "real recording" in o.group.title else o
                for o in one.outcomes
            )
        )
        for one in tables
    ]
    assert "The real recording is not here" in paper(tables, store, False)


def test_verdicts_are_counted():
    papers = Papers(made(value=0.9))
    counted = {(one.heading, one.title): one.counts for one in papers.tallies()}
    # those that are said to be smaller, and the one that is said to be larger and so is not reproduced
    assert counted["003, experiment 2, figure 5", "quotients, as said"] == (7, 0, 0, 1, 0)


def test_an_unknown_line_is_one_clear_error():
    papers = Papers(made())
    with pytest.raises(ValueError, match=r"unknown line of table 3\.1 'UKF, azimuths'"):
        papers.line("3.1", "matched prior", "UKF, azimuths")
    with pytest.raises(ValueError, match="0 groups"):
        papers.line("3.1", "another prior", "UKF, azimuth")
    with pytest.raises(ValueError, match=r"unknown table '3\.9'"):
        papers.line("3.9", "matched prior", "UKF, azimuth")


def test_each_claim_has_a_line_of_its_own():
    places = [(claim.table, claim.group, claim.line) for claim in CLAIMS]
    assert len(set(places)) == len(places)


def test_what_is_not_reproduced_does_not_hold():
    """Neither what is in order only, nor what cannot be told."""
    found = [Found("1", Estimate(1.0, 0.9, 1.1, 40), verdict) for verdict in (REPRODUCED, IN_ORDER, NOT, OPEN)]
    assert [one.holds for one in found] == [True, False, False, False]
