"""What the sigma-point filters share: a choice of the root, and of the form in which the covariance is carried.

Source of the square-root form: Arasaratnam & Haykin (2009), doi:10.1109/TAC.2009.2019800, and van der Merwe & Wan (2001),
doi:10.1109/ICASSP.2001.940586. Unlike in the latter, a centre point of negative weight needs no downdate. About the average
of the outer images the covariance is a sum of squares. Equations: docs/mathematics/filters.md#square-roots.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

from sins_env.arrays import Array
from sins_env.checks import choice, keep, refused
from solvers.blocks.moments import SigmaPoints
from solvers.blocks.sigma_rules import PointRule
from solvers.filters.gaussian import GaussianFilter
from solvers.filters.sigma.square_root import PairedFilter
from solvers.types import Function, Gaussian, Innovation, Measurement, Transition

FORMS = ("covariance", "square-root")


class SigmaPointFilter(GaussianFilter[Any]):
    """Base of the sigma-point filters, with the settings ``root`` and ``form``; a subclass gives the ``point_rule``.

    ``form="covariance"`` carries P and takes its root twice a step. ``form="square-root"`` carries the lower root and updates it
    by QR. The estimates are the same, the covariance cannot become indefinite, and only half as many digits are lost.

    Raises:
        ValueError: an unknown root or form, or the square-root form with another root than Cholesky's.
    """

    root: str
    form: str

    def __post_init__(self) -> None:
        _ = self.rule  # checks the settings
        keep(self, "form", choice, FORMS)
        if self.form == "square-root" and self.root != "cholesky":
            raise refused("root", self.root, "'cholesky', for form = 'square-root' carries the triangular one")

    @cached_property
    def point_rule(self) -> PointRule:
        """The sigma points of the filter."""
        raise NotImplementedError(f"{type(self).__name__} has no point rule")

    @cached_property
    def rule(self) -> SigmaPoints:
        return SigmaPoints(self.point_rule, self.root)

    @cached_property
    def by_root(self) -> PairedFilter | None:
        """The filter that does the work in square-root form; None in covariance form."""
        return PairedFilter(self.point_rule) if self.form == "square-root" else None

    def init(self, prior: Gaussian, rng: Any = None) -> Any:
        return super().init(prior, rng) if self.by_root is None else self.by_root.init(prior, rng)

    def predict(self, b: Any, tr: Transition) -> Any:
        return super().predict(b, tr) if self.by_root is None else self.by_root.predict(b, tr)

    def correct(self, b: Any, me: Measurement) -> tuple[Any, Innovation]:
        return super().correct(b, me) if self.by_root is None else self.by_root.correct(b, me)

    def estimate(self, b: Any) -> Gaussian:
        return super().estimate(b) if self.by_root is None else self.by_root.estimate(b)

    def move(self, b: Any, g: Function, jac: Callable[[Array], Array]) -> Any:
        return super().move(b, g, jac) if self.by_root is None else self.by_root.move(b, g, jac)
