"""What a factory says of itself: its own words, not those of its type or of what it makes."""

from dataclasses import dataclass
from functools import partial

from evaluation import plugins

from sins_env.evaluation.estimators import finding
from sins_env.evaluation.estimators.about import about


class Inherits(plugins.DeadReckoning):
    pass


@dataclass
class Undescribed:
    gain: float = 1.0


@dataclass
class InheritsAndIsData(plugins.DeadReckoning):
    gain: float = 1.0


def function(gain: float = 2.0):
    """Make it.

    More of it.
    """
    return plugins.Told()


def silent():
    return plugins.Told()


class Callable:
    """A kind of factory."""

    def __call__(self):
        return plugins.Told()


PARTIAL = partial(function, gain=3.0)
NAMED = partial(function)
NAMED.__doc__ = "Words of its own."
OF_A_CLASS = partial(plugins.At, epoch=7)


def test_the_objects_own_docstring():
    assert about(plugins.DeadReckoning).text == "The told attitude, carried on by the gyros."
    assert about(Inherits).text == "The told attitude, carried on by the gyros."
    assert about(InheritsAndIsData).text == "The told attitude, carried on by the gyros."
    assert about(function) == ("Make it.", {"gain": "2.0"})
    assert about(PARTIAL) == ("Make it.", {"gain": "3.0"})
    assert about(NAMED).text == "Words of its own."
    assert about(OF_A_CLASS).text == plugins.At.__doc__
    assert about(OF_A_CLASS).settings["epoch"] == "7"


def test_nothing_is_said_where_the_object_says_nothing():
    """Neither the signature of a dataclass, nor the words of what is made, nor those of a type."""
    assert [about(one).text for one in (Undescribed, silent, partial(silent), Callable())] == [""] * 4


def test_describe_by_path(cli):
    here = f"{__name__}:"
    assert finding.describe(here + "PARTIAL").text == "Make it."
    code, out, _ = cli("describe", here + "Inherits")
    assert code == 0
    assert "The told attitude, carried on by the gyros." in out
    assert "no description" in cli("describe", here + "silent")[1]
    assert "The cubature Kalman filter." in cli("describe", "solvers.zoo:ckf")[1]
