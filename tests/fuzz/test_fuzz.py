"""A slice of every kind; ``FUZZ=10 pytest tests/fuzz`` tries ten times as many. ``make fuzz`` tries all that there is time for."""

import os

import pytest
from hypothesis import HealthCheck, given, settings

from fuzz import kind
from fuzz.kinds import KINDS

SCALE = float(os.environ.get("FUZZ", "1"))  #: the environment variable that scales the number of examples


@pytest.mark.parametrize("name", list(KINDS))
def test_inputs_are_refused_in_one_line_or_work(name, tmp_path_factory, monkeypatch):
    one = KINDS[name]
    if not kind.FOLDER[0].is_dir() or kind.FOLDER[0].samefile("."):
        kind.FOLDER[0] = tmp_path_factory.mktemp("fuzz")
    monkeypatch.chdir(kind.FOLDER[0])

    @settings(
        max_examples=max(round(SCALE * one.slice), 1),
        derandomize=SCALE <= 1,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
    )
    @given(one.examples)
    def try_it(example):
        one.go(example)

    try_it()
