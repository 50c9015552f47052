"""Templates of the HTML report and of the reproduction paper. Jinja2 comes with the extra "report"."""

from __future__ import annotations

import importlib
import json
from pathlib import Path
from typing import Any

from sins_env.writing.visible import LAYOUT, visible


def check_jinja2() -> None:
    """Check that the template engine is installed.

    Raises:
        ValueError: jinja2 is not installed.
    """
    _jinja2()


def _jinja2() -> Any:
    try:
        return importlib.import_module("jinja2")
    except ImportError as error:
        raise ValueError('report needs the package jinja2: pip install "sins-env[report]"') from error


def _shown(value: Any) -> Any:
    """Return what an expression of a page prints; only text that is marked as safe stays as it is."""
    return visible(value, keep=LAYOUT) if type(value) is str else value


def template(name: str) -> Any:
    """Return the template at a path below ``sins_env/evaluation``. An unknown name in it is an error; HTML is escaped.

    Raises:
        ValueError: jinja2 is not installed.
    """
    jinja2 = _jinja2()
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parents[1]),
        autoescape=".html" in name,
        finalize=_shown if ".html" in name else None,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["compact"] = lambda value: json.dumps(value, sort_keys=True)
    return environment.get_template(name)
