"""Checks of settings: what is allowed passes as a plain Python value, all else is one error that says what is."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from sins_env.checks import choice, flag, keep, number, numbers, shown, unknown, whole


@pytest.mark.parametrize(
    ("limits", "given", "allowed"),
    [
        ({}, math.inf, "a finite number"),
        ({"above": 0.0}, 0.0, "a finite number > 0"),
        ({"least": 0.5}, 0.4, "a finite number >= 0.5"),
        ({"least": 0.0, "below": 1.0}, 1.0, "a number >= 0 and < 1"),
        ({"above": 0.0, "most": 1.0}, 1.1, "a number > 0 and <= 1"),
        ({"above": 0.0, "infinite": True}, -math.inf, "a number > 0, or inf"),
        ({"infinite": True}, math.nan, "a number, or inf"),
    ],
)
def test_what_is_beyond_a_limit_is_told_the_limits(limits, given, allowed):
    with pytest.raises(ValueError, match=f"^gate = {given!r}; allowed: {allowed}$"):
        number("gate", given, **limits)


@pytest.mark.parametrize(
    ("limits", "given"),
    [
        ({"above": 0.0}, 5e-324),
        ({"least": 0.5}, 0.5),
        ({"below": 1.0}, math.nextafter(1.0, 0.0)),
        ({"most": 1.0}, 1),
        ({"infinite": True, "least": 1.0}, math.inf),
        ({}, np.float32(0.5)),
        ({}, np.int64(-3)),
    ],
)
def test_what_is_on_a_limit_passes_as_a_float(limits, given):
    value = number("gate", given, **limits)
    assert value == given
    assert type(value) is float


@pytest.mark.parametrize("given", [True, "1", None, [1.0], {}, b"1", 1j, np.array(1.0), np.True_])
def test_what_is_no_number_is_refused(given):
    with pytest.raises(ValueError, match="gate = "):
        number("gate", given)


def test_whole_numbers():
    assert [whole("k0", given, least=0) for given in (0, 3.0, np.int32(4))] == [0, 3, 4]
    for given in (-1, 2.5, math.inf, True, "3"):
        with pytest.raises(ValueError, match=r"k0 = .*; allowed: a whole number >= 0"):
            whole("k0", given, least=0)


def test_lists_of_numbers():
    assert numbers("x", [1, 2.5], None, "numbers") == numbers("x", np.array([1.0, 2.5]), 2, "numbers") == (1.0, 2.5)
    for given, count in (([], None), ([1.0], 2), ("12", None), ({}, None), ([1.0, "2"], 2), ([0.0], None)):
        with pytest.raises(ValueError, match=r"x = .*; allowed: numbers"):
            numbers("x", given, count, "numbers", above=0.0)


@dataclass(frozen=True)
class Settings:
    gate: float = 1
    kind: str = "a"
    on: bool = True

    def __post_init__(self):
        keep(self, "gate", number, above=0.0)
        keep(self, "kind", choice, ("a", "b"))
        keep(self, "on", flag)


def test_a_setting_is_kept_as_checked():
    assert type(Settings().gate) is float
    assert Settings(gate=np.float64(2.0)) == Settings(gate=2)
    assert hash(Settings(on=np.True_)) == hash(Settings())
    for wrong, message in (
        ({"gate": 0}, "gate = 0; allowed"),
        ({"kind": ["a"]}, "unknown kind"),
        ({"on": 1}, "on = 1"),
    ):
        with pytest.raises(ValueError, match=message):
            Settings(**wrong)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"b": 1, "a": [2.5, None]}, "{'b': 1, 'a': [2.5, None]}"),  # as repr writes it
        (10**5000, "a whole number of about 5000 digits"),
        (type("T", (), {"__repr__": lambda self: 1 / 0})(), "<T instance at "),
        (np.ones((2, 2)), "array([[1., 1.], [1., 1.]])"),
    ],
    ids=["dict", "digits", "raises", "array"],
)
def test_what_was_given_is_shown_in_one_line(given, text):
    assert shown(given).startswith(text)
    assert len(shown(given)) < len(text) + 20


@pytest.mark.parametrize(
    "given", ["x" * 10**6, [0.0] * 10**6, {i: [i] * 99 for i in range(10**4)}, [[[[[[[["x" * 999]]]]]]]]]
)
def test_what_was_given_is_shown_in_part(given):
    assert len(shown(given)) <= 200
    assert len(str(unknown("name", given, ["y" * 10**4] * 10**4))) < 10_000


def test_numbers_beyond_all_measure_are_refused_whatever_the_limits():
    assert number("gate", -1e100) == -1e100
    for given in (1e101, -1e101, 10**400):
        with pytest.raises(ValueError, match=r"gate = .*allowed: a finite number"):
            number("gate", given)
    with pytest.raises(ValueError, match="a whole number >= 1"):
        whole("count", 10**16, least=1)
    with pytest.raises(ValueError, match=r"factors = .*allowed: numbers"):
        numbers("factors", [1.0] * 10_001, None, "numbers")
