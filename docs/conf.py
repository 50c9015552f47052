"""Settings of the documentation site. ``make docs`` builds it into build/site.

The source of the site is the whole repository, so that a link between two pages is the same here as on GitHub: reproduction/
and CHANGELOG.md are pages as they stand. Nothing is fetched while it is built or read.
"""

from __future__ import annotations

import re
import sys
from importlib.util import find_spec
from pathlib import Path

DOCS = Path(__file__).resolve().parent
ROOT = DOCS.parent
sys.path[:0] = [str(DOCS / "_ext"), str(DOCS / "api")]

import public  # noqa: E402
from site_gallery import GALLERY  # noqa: E402

import sins_env  # noqa: E402

project = "sins_env"
author = "the authors of sins_env"
release = version = sins_env.__version__
project_copyright = author

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",  # docstrings are prose with sections as Google writes them, which napoleon reads
    "sphinx.ext.napoleon",
    "sphinx.ext.mathjax",
    "sphinx.ext.viewcode",
    "sphinx_gallery.gen_gallery",
    "site_api",
    "site_gallery",
]

# --- pages ------------------------------------------------------------------------------------------------------------
root_doc = "docs/index"
include_patterns = ["docs/**", "reproduction/*.md", "CHANGELOG.md", "CONTRIBUTING.md", "examples/*/README.md"]
PARTS = ("docs", "reproduction", "examples", "CHANGELOG.md", "CONTRIBUTING.md")
exclude_patterns = [path.name for path in ROOT.iterdir() if path.name not in PARTS]
exclude_patterns += ["docs/_static", "docs/_ext"]
source_suffix = {".md": "markdown", ".rst": "restructuredtext"}

myst_enable_extensions = ["dollarmath", "amsmath"]
myst_heading_anchors = 4
myst_fence_as_directive = ["math"]  # as GitHub writes a formula

# --- code -------------------------------------------------------------------------------------------------------------
add_module_names = False
autodoc_member_order = "bysource"
autodoc_typehints_format = "short"
python_use_unqualified_type_names = True
nitpicky = True
#: A name of the reference that is cited must be there. Names of other packages would need their sites, and what lies behind
#: the public modules has no page.
PUBLIC = "|".join(re.escape(module) for page in public.PAGES.values() for module in page.modules)
nitpick_ignore_regex = [
    (r"py:.*", rf"(?!({PUBLIC})\.[A-Za-z]\w*$).*"),
    (r"py:.*", r"solvers\.types\.B"),
    (r"py:mod", r".*"),
]
suppress_warnings = ["ref.python"]  # a shape (R, n) is taken for a name R, of which there are several

sphinx_gallery_conf = GALLERY

# --- the look ---------------------------------------------------------------------------------------------------------
html_theme = "pydata_sphinx_theme"  # that of NumPy, SciPy and scikit-learn: its readers know their way about it
html_title = "sins_env"
html_favicon = "_static/favicon.svg"
html_static_path = ["_static"]
html_extra_path = ["_root"]  # leads from the root of the site to docs/index.html
html_css_files = ["site.css"]
html_js_files = ["offline.js"]
html_show_sourcelink = False
html_copy_source = False
html_context = {"default_mode": "auto"}  # light or dark as the reader's system is
html_theme_options = {
    "header_links_before_dropdown": 7,
    "navigation_with_keys": False,
    "show_prev_next": True,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
}

# --- formulas without a network: one file, which holds its glyphs as outlines --------------------------------------------
mathjax = find_spec("sphinx-mathjax-offline")
assert mathjax is not None, "no MathJax: pip install -e '.[docs]'"
html_static_path += [str(Path(str(mathjax.origin)).parent / "static" / "mathjax" / "tex-svg.js")]
mathjax_path = "tex-svg.js"
