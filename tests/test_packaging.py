"""What the package says of itself in several files agrees, and its page on the index has no link that leads nowhere."""

import re
import runpy
import tomllib

import yaml
from places import ROOT

import sins_env

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
CITATION = yaml.safe_load((ROOT / "CITATION.cff").read_text())
absolute = runpy.run_path(str(ROOT / "setup.py"))["absolute"]


def test_versions_agree():
    """The latest version of the changelog is that of the package and of the citation; ruff is the same everywhere."""
    released = re.findall(r"^## \[([\d.]+)\] - ([\d-]+)$", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[0]
    assert released == (sins_env.__version__, str(CITATION["date-released"]))
    assert CITATION["version"] == sins_env.__version__
    (ruff,) = (line for line in PROJECT["project"]["optional-dependencies"]["dev"] if line.startswith("ruff"))
    hooks = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    (pinned,) = (repository["rev"] for repository in hooks if "ruff" in repository["repo"])
    assert pinned == ruff.replace("ruff~=", "v")


def test_addresses_agree():
    assert CITATION["repository-code"] == PROJECT["project"]["urls"]["Repository"]


def test_links_of_the_long_description_are_absolute():
    address = PROJECT["project"]["urls"]["Repository"]
    given = "![a](docs/a.svg) [b](docs/b.md#c) [d](#d) [e](https://e.org) `m[0](x)`\n```python\nm[0](y)\n```"
    assert absolute(given) == (
        f"![a]({address}/raw/HEAD/docs/a.svg) [b]({address}/blob/HEAD/docs/b.md#c) [d](#d) [e](https://e.org) `m[0](x)`"
        "\n```python\nm[0](y)\n```"
    )


def test_the_workflow_has_every_python_that_is_claimed():
    claimed = re.findall(r"Python :: (3\.\d+)", " ".join(PROJECT["project"]["classifiers"]))
    workflow = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())
    assert workflow["jobs"]["test"]["strategy"]["matrix"]["python"] == claimed
