"""The public interface, which docs/api/public.py names, and from which the API reference is made."""

import inspect
import sys

from places import ROOT

sys.path.append(str(ROOT / "docs" / "api"))

import public

NAMES = list(public.names())


def test_every_public_name_is_described():
    """A class and a function by a docstring, a constant by its comment, and the public methods of a class, too."""
    assert len(NAMES) > 150
    silent = [f"{found.module}.{found.name}" for found in NAMES if not found.words]
    for found in NAMES:
        for name, member in vars(found.thing).items() if inspect.isclass(found.thing) else ():
            method = inspect.isroutine(member) or isinstance(member, property)
            if method and not name.startswith("_") and not inspect.getdoc(getattr(found.thing, name)):
                silent.append(f"{found.home}.{name}")
    assert silent == []


def test_every_example_has_the_head_of_a_page():
    """A title with a line below it: the first line is what ``--help`` shows, and what the gallery lists."""
    for script in (ROOT / "examples").glob("*.py"):
        title, line = script.read_text("utf-8").removeprefix('"""').splitlines()[:2]
        assert line == "=" * len(title), script.name
