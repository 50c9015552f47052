"""What a filter's file says of it for the tests: which other filter it equals, under which settings.

A file that registers filters ends with these constants, each a mapping from the filter's name. So a new filter is one file.

    SAME_AS     Relations that hold; every filter has an entry. The first one that leads to ``kf``, directly or through other
                filters, makes the filter a Kalman filter on linear problems. A filter that equals no other has ``()``.
    UNLIKE      Pairs that must differ on nonlinear problems. What SAME_AS says without its settings is tested anyway.
    VARIANTS    Settings beyond the defaults with which all tests of the zoo are run.

``FIRST_FIX_TOGETHER = True`` says besides that all runs of a batch must have their first fix in the same epoch.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple


class Relation(NamedTuple):
    """The filter with ``settings`` and the filter ``other`` with ``of_other`` give the same estimates."""

    other: str
    settings: Mapping[str, Any] = {}
    of_other: Mapping[str, Any] = {}
    on: str = "nonlinear"  #: the problems on which it holds: "nonlinear", "nonlinear f" with a linear h, or "linear"
    within: float = 1e-12  #: relative tolerance
