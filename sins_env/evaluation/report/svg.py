"""Conversion of a Matplotlib figure to SVG inside an HTML page.

A colour of ``PAGE`` becomes the CSS variable of that name, so that one figure serves a light and a dark page. Text stays
text, in the font of the page. Identifiers are short and the same in every run.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING
from xml.etree import ElementTree

if TYPE_CHECKING:  # matplotlib is slow to import and needed only to draw
    from matplotlib.figure import Figure

LOOKS = 8  #: number of colours for solvers
#: Colours that a figure may be drawn in, by the name of the CSS variable that replaces each.
PAGE = {
    "ink": "#010101",
    "grid": "#020202",
    "other": "#030303",
    **{f"look-{i}": f"#0404{i:02x}" for i in range(LOOKS)},
}
_VARIABLES = {colour: f"var(--{name})" for name, colour in PAGE.items()}
_DROPPED = {"font-family", "font", "stroke-linejoin"}  #: styles that the page sets
_NUMBER = re.compile(r"-?\d+\.\d+(?:e-?\d+)?")
_REFERENCE = re.compile(r"url\(#([^)]*)\)")


def inline(figure: Figure, prefix: str, title: str, description: str, names: Mapping[str, str]) -> str:
    """Return a figure as an ``<svg>`` element with size, title and description.

    Args:
        figure: figure to convert.
        prefix: prefix of its identifiers, which must differ between the figures of a page.
        title: title for screen readers.
        description: description for screen readers.
        names: tooltips by the gid of the artist that gets one.
    """
    import matplotlib  # slow to import

    file = io.BytesIO()
    with matplotlib.rc_context({"svg.fonttype": "none", "path.simplify_threshold": 0.2}):
        figure.savefig(file, format="svg", transparent=True)
    root = ElementTree.fromstring(file.getvalue())
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
        element.attrib = {name.rpartition("}")[2]: value for name, value in element.attrib.items()}
    for parent in list(root.iter()):
        for child in [c for c in parent if c.tag in ("metadata", "style")]:
            parent.remove(child)
    _name(root, names)
    _shorten(root)
    _rename(root, prefix)
    width, height = (round(float(v)) for v in root.attrib["viewBox"].split()[2:])
    labels = {"role": "img", "aria-labelledby": f"{prefix}-t {prefix}-d", "class": "plot"}
    root.attrib = {"width": str(width), "height": str(height), "viewBox": f"0 0 {width} {height}", **labels}
    for i, (tag, text) in enumerate((("title", title), ("desc", description))):
        told = ElementTree.Element(tag, {"id": f"{prefix}-{tag[0]}"})
        told.text = text
        root.insert(i, told)
    return ElementTree.tostring(root, encoding="unicode")


def _name(root: ElementTree.Element, names: Mapping[str, str]) -> None:
    for element in root.iter("g"):
        name = names.get(element.get("id", ""))
        if name is not None:
            element.set("class", "named")
            told = ElementTree.Element("title")
            told.text = name
            element.insert(0, told)


def _shorten(root: ElementTree.Element) -> None:
    """Round to tenths of a pixel, drop white space, and replace colours by variables."""
    markers = {element for defs in root.iter("defs") for element in defs.iter()}
    for element in root.iter():
        element.tail = None
        if element.text is not None and not element.text.strip():
            element.text = None
        digits = 2 if element in markers else 1
        for name in ("d", "x", "y", "width", "height", "transform"):
            if name in element.attrib:
                element.set(name, _rounded(element.attrib[name], digits))
        if "d" in element.attrib:
            element.set("d", re.sub(r"\s*([A-Za-z])\s*", r"\1", element.attrib["d"]).strip())
        if "style" in element.attrib:
            parts = [part.strip().split(": ", 1) for part in element.attrib["style"].split(";") if part.strip()]
            kept = [f"{name}:{_VARIABLES.get(value, value)}" for name, value in parts if name not in _DROPPED]
            size = [f"font-size:{v.split('px')[0]}px" for name, v in parts if name == "font" and "px" in v]
            element.set("style", ";".join(kept + size))


def _rounded(text: str, digits: int) -> str:
    return _NUMBER.sub(lambda found: f"{round(float(found[0]), digits) + 0.0:.{digits}f}".rstrip("0").rstrip("."), text)


def _rename(root: ElementTree.Element, prefix: str) -> None:
    """Shorten the identifiers that something refers to, and drop the others."""
    used: dict[str, str] = {}

    def new(old: str) -> str:
        return used.setdefault(old, f"{prefix}-{len(used)}")

    for element in root.iter():
        if element.get("href", "").startswith("#"):
            element.set("href", f"#{new(element.attrib['href'][1:])}")
        for name, value in element.attrib.items():
            if "url(#" in value:
                element.set(name, _REFERENCE.sub(lambda found: f"url(#{new(found[1])})", value))
    for element in root.iter():
        old = element.attrib.pop("id", None)
        if old in used:
            element.set("id", used[old])
