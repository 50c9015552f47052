"""The long description for the package index: README.md, with absolute links, for an index has neither figures nor pages."""

import re
import tomllib
from pathlib import Path

from setuptools import setup

ROOT = Path(__file__).parent
#: Code, which stays, or the beginning of a link to a file of the repository.
CODE_OR_LINK = re.compile(r"```.*?```|`[^`]*`|(?P<link>(?P<figure>!?)\[[^\]]*\]\()(?![a-z]+:|#)", re.DOTALL)


def absolute(markdown: str) -> str:
    """Return Markdown whose links to files of the repository are absolute: figures as they are, pages as they are shown."""
    address = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["urls"]["Repository"]

    def longer(found: re.Match[str]) -> str:
        return f"{found[0]}{address}/{'raw' if found['figure'] else 'blob'}/HEAD/" if found["link"] else found[0]

    return CODE_OR_LINK.sub(longer, markdown)


if __name__ == "__main__":
    setup(
        long_description=absolute((ROOT / "README.md").read_text("utf-8")),
        long_description_content_type="text/markdown",
    )
