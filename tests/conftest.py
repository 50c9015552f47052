"""The recordings stay beside the project; tests that need them are skipped where they are absent."""

import os
from pathlib import Path

import pytest

os.environ.setdefault("SINS_ENV_DATA", str(Path(__file__).resolve().parents[2] / "shared" / "data"))


@pytest.fixture
def recorded(request):
    """The name of a recording: ``@pytest.mark.parametrize("recorded", [...], indirect=True)``."""
    folder = Path(os.environ["SINS_ENV_DATA"])
    if not (folder / request.param).is_file():
        pytest.skip(f"{request.param} is not in $SINS_ENV_DATA = {folder}")
    return request.param
