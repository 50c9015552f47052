"""The API reference: its pages are written from the table of docs/api/public.py, and docstrings are made reStructuredText."""

from __future__ import annotations

import inspect
import re
from pathlib import Path
from typing import Any

import public
from sphinx.application import Sphinx

API = Path(public.__file__).parent

CITED = re.compile(r"(?<![\w/])docs/([\w/]+)\.md(?:#[\w-]+)?")
SECTION = re.compile(r"(Args|Arguments|Attributes|Examples?|Raises|Returns|Yields):$")
ITEM = re.compile(r"([-*]|\d+\.|[a-z]\))\s")


def page(one: public.Page, everything: list[public.Name]) -> str:
    """Return a page of the reference: a table of the names, then each name in full."""
    text = [one.title, "=" * len(one.title), "", one.intro, ""]
    for module in one.modules:
        there = [found for found in everything if found.module == module]
        text += [module, "-" * len(module), ""] if len(one.modules) > 1 else []
        text += [".. list-table::", "   :class: names", ""]
        for found in there:
            words = found.words.replace("::", "").split("\n\n")[0].replace("\n", " ")
            first = re.split(r"(?<=[.;])\s", cited(words))[0].rstrip(";")
            text += [f"   * - :py:obj:`{found.name} <{found.home}>`", f"     - {first}"]
        text += ["", f".. py:module:: {module}", ""]
        text += [line for found in there if found.is_home for line in described(found)]
    return "\n".join(text)


def described(found: public.Name) -> list[str]:
    """Return the directive that describes a name."""
    if inspect.ismodule(found.thing):
        return []
    if inspect.isclass(found.thing):
        found.thing.__name__ = found.thing.__qualname__ = (
            found.name
        )  # the class behind sins_env.Results has a longer one
        return [f".. autoclass:: {found.home}", "   :members:", *inherited(found.thing), ""]
    if inspect.isroutine(found.thing) or hasattr(found.thing, "py_func"):
        return [f".. autofunction:: {found.home}", ""]
    return [f".. py:data:: {found.name}", "", f"   {cited(found.words)}", ""]


def inherited(thing: type) -> list[str]:
    """Return the option that shows what a class has from bases of this project, which have no place of their own."""
    own, others = [], []
    for base in thing.__mro__[1:]:
        (own if base.__module__.startswith("sins_env.evaluation") else others).append(base.__name__)
    return [f"   :inherited-members: {', '.join(dict.fromkeys(others))}"] if own else []


def write(app: Sphinx) -> None:
    """Write the pages; one that has not changed stays as it is, so that it is not read again."""
    everything = list(public.names())
    for name, one in public.PAGES.items():
        text, path = page(one, everything), API / f"{name}.rst"
        if not path.exists() or path.read_text("utf-8") != text:
            path.write_text(text, "utf-8")


def as_rst(app: Sphinx, what: str, name: str, thing: Any, options: Any, lines: list[str]) -> None:
    """Make indented lines of a docstring a literal block, and what it cites of docs/ a link."""
    text: list[str] = []
    literal = section = item = False
    for line in lines:
        bare, indented = line.strip(), line.startswith(" ")
        if bare and not indented:
            literal, section, item = False, bool(SECTION.match(bare)), bool(ITEM.match(bare))
        elif bare and not (literal or section or item) and (not text or not text[-1]):
            literal = True
            text += ["::", ""]
        text.append(line if literal else cited(line))
    lines[:] = text


def signed(app: Sphinx, what: str, name: str, thing: Any, *given: Any) -> tuple[str, None] | None:
    """Leave away what stands behind the name of a protocol, which nobody calls."""
    return ("", None) if what == "class" and getattr(thing, "_is_protocol", False) else None


def cited(line: str) -> str:
    """Make what a line cites of docs/ a link from a page of docs/api/."""
    return CITED.sub(lambda found: f"`{found[0][5:]} <../{found[1]}.html{found[0].partition('.md')[2]}>`__", line)


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect with Sphinx; napoleon reads the docstrings afterwards."""
    app.connect("builder-inited", write, priority=100)
    app.connect("autodoc-process-docstring", as_rst, priority=400)
    app.connect("autodoc-process-signature", signed)
    return {"parallel_read_safe": True}
