"""The information of a depth sensor: that of a height of the other sign."""

from __future__ import annotations

from sins_env.evaluation.bound.height import HeightTerm


class DepthTerm(HeightTerm):
    """The depth with its offset."""

    name = "depth"
    sign = -1.0
