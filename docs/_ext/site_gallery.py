"""The gallery: examples/*.py run in a folder of their own below build/, as the scripts that they are."""

from __future__ import annotations

import ast
import shutil
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx
from sphinx_gallery.scrapers import figure_rst

ROOT = Path(__file__).resolve().parents[2]
STAGE = ROOT / "build" / "gallery"  #: what the examples write stays here
PICTURES = {".png", ".svg"}

#: Examples that are shown and not run, with the reason.
NOT_RUN = {
    "ppo_tune_noise": "it needs stable-baselines3 and trains for minutes",
    "replay_recording": "the recording is not part of the repository",
}

#: Arguments without which an example would show less.
ARGUMENTS = {"before_a_trip": ["trip.png"]}

GALLERY = {
    "examples_dirs": "build/gallery",
    "gallery_dirs": "docs/gallery",
    "filename_pattern": rf"/(?!({'|'.join(NOT_RUN)})\.py)\w+\.py$",
    "example_extensions": {".py"},
    "image_scrapers": ("site_gallery.saved_pictures",),
    "reset_argv": "site_gallery.as_script",
    "reset_modules": (),
    "capture_repr": (),
    "within_subsection_order": "FileNameSortKey",
    "default_thumb_file": str(ROOT / "docs" / "_static" / "prints.png"),  # of an example that draws nothing
    "download_all_examples": False,
    "show_signature": False,
    "write_computation_times": False,
    "abort_on_example_error": False,
}


def saved_pictures(block: Any, block_vars: dict[str, Any], gallery_conf: dict[str, Any]) -> str:
    """Take the pictures that an example has saved, and return what shows them."""
    taken = []
    folder = Path(block_vars["src_file"]).parent
    for picture in sorted(folder.iterdir(), key=lambda path: path.stat().st_mtime):
        if picture.suffix in PICTURES:
            place = Path(next(block_vars["image_path_iterator"])).with_suffix(picture.suffix)
            shutil.move(picture, place)
            taken.append(str(place))
    return figure_rst(taken, gallery_conf["src_dir"])


def as_script(gallery_conf: dict[str, Any], script: dict[str, Any]) -> list[str]:
    """Give an example the docstring and the path that a script has, and its arguments."""
    path = Path(script["src_file"])
    script["example_globals"].update(__doc__=ast.get_docstring(ast.parse(path.read_text("utf-8"))), __file__=str(path))
    return ARGUMENTS.get(path.stem, [])


def stage(app: Sphinx) -> None:
    """Copy the examples to where they may write; the gallery runs those again that have changed."""
    shutil.rmtree(STAGE, ignore_errors=True)
    STAGE.mkdir(parents=True)
    for path in (ROOT / "examples").iterdir():
        if path.suffix in (".py", ".rst"):
            shutil.copy2(path, STAGE)
    shutil.copytree(ROOT / "examples" / "scenarios", STAGE / "scenarios")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect with Sphinx."""
    app.connect("builder-inited", stage, priority=100)  # before the gallery looks for them
    return {"parallel_read_safe": True}
