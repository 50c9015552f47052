"""Idea and source of every solver, taken from the docstrings for a table."""

from __future__ import annotations

import inspect
import re

import solvers
from solvers.registry import FILTERS

LONGEST = 158  #: largest number of characters of an idea; a longer one is cut down to the solver's title

AFTER = ("Shapes:", "Departures:", "One run at a time")  #: what follows the sources in a docstring
#: What a table leaves out of the sources: titles, remarks, and pages of this repository.
UNSHOWN = (
    r', "[^"]{15,}"',
    r", (?:which|with) [^;]*",
    r"(?:[,;]| as reconstructed in)? ?docs/\S+\.md#[\w-]+(?: \([^)]*\))?",
    r"; (?:E\.\d|errata)[^;]*",
    r"equations in ",
)


def names() -> list[str]:
    """Return every solver: the filters family by family, then the complete estimators."""
    known = solvers.names()
    return [*FILTERS, *(name for name in known if name not in FILTERS)]


def idea(name: str) -> str:
    """Return the first sentence of the solver, and the idea of its module if both are short and not the same."""
    title = re.sub(r"^The (\w)", lambda found: found[1].upper(), _sentences(solvers.describe(name))[0].rstrip("."))
    clause = _clause(_module(name))
    said = not clause or " ".join(clause.split()[-4:]) in title
    return title if said or len(f"{title}: {clause}") > LONGEST else f"{title}: {clause}"


def source(name: str) -> str:
    """Return papers, linked by their DOI, and sections of the source documents."""
    doc = _module(name)
    if not doc:  # a complete estimator says it in its own sentences
        told = _sentences(solvers.describe(name))
        named = re.search(r"\(([^()]* \d{4})\)", told[0])
        return named[1] if named else " ".join(told[1:]).rstrip(".")
    told = re.search(rf"^Source: (.*?)(?=\s*(?:{'|'.join(AFTER)}|\n\n|\Z))", doc, re.S | re.M)
    plain = _line(told[1]).rstrip(".") if told else ""
    for away in UNSHOWN:
        plain = re.sub(away, "", plain)
    plain = "; ".join(part for part in plain.split("; ") if re.search(r"\d", part))
    return re.sub(r"([^;]+?), (?:doi:|(?=arXiv:))([^\s;,()]+(?:\([^\s)]*\)[^\s;,()]*)*)", _link, plain)


def _link(found: re.Match[str]) -> str:
    words, target = found[1].strip(), found[2]
    base = "https://arxiv.org/abs/" if target.startswith("arXiv:") else "https://doi.org/"
    quoted = target.removeprefix("arXiv:").replace("(", "%28").replace(")", "%29")
    return f"{found[1][: len(found[1]) - len(found[1].lstrip())]}[{words}]({base}{quoted})"


def _module(name: str) -> str:
    """Return the docstring of a filter's module; a complete estimator has none about it alone."""
    cls = FILTERS.get(name)
    return (inspect.getdoc(inspect.getmodule(cls)) or "") if cls else ""


def _clause(doc: str) -> str:
    """Return what follows the colon of a module's first sentence, unless it lists filters; else the idea's first clause."""
    head = _sentences(doc)[0].partition(": ")[2].rstrip(".")
    told = re.search(r"^Idea: (.*?)(?:\n\n|\Z)", doc, re.S | re.M)
    if head and ", and " not in head:
        return head
    text = re.split(r"[.:;](?=\s|$)", _line(told[1]))[0] if told else ""
    clause = re.split(r", \S+ = ", text)[0]
    return "" if " = " in clause else clause


def _sentences(doc: str) -> list[str]:
    return re.split(r"(?<=\.)(?<!al\.)\s+", _line(doc.split("\n\n")[0]))


def _line(text: str) -> str:
    return " ".join(text.replace("``", "`").split())
