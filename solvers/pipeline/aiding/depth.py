"""A depth: a height of the other sign. See docs/mathematics/aiding.md#height-and-depth."""

from __future__ import annotations

from solvers.pipeline.aiding.height import Height


class Depth(Height):
    """A depth sensor as an aid."""

    name = "depth"
    sign = -1.0
