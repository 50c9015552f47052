"""Small recordings."""

import pytest
from oracles import recorded as files


@pytest.fixture
def parked(tmp_path):
    """10 s at 100 Hz without GNSS; the reference begins at 0.1 s."""
    return files.counts(tmp_path / "parked.npz")


@pytest.fixture
def driven(tmp_path):
    """12 s at 200 Hz with fixes at 0.95 s + n."""
    return files.increments(tmp_path / "driven.npz")
