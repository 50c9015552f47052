"""The settings of the pipeline around a filter: one value, which is checked once and which all parts read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from sins_env.checks import choice, flag, keep, number, shown
from solvers.pipeline import coarse as coarse_methods
from solvers.pipeline.errors.invariant import COORDINATES

MODELS = ("exact", "thesis")
BIAS_FRAMES = ("body", "nav")
FEEDBACK = ("open", "closed")
ALIGNMENT_ONLY = ("model", "bias_frame")  #: settings that only alignment has


@dataclass(frozen=True)
class Settings:
    """Settings of the pipeline around a filter. ``None`` stands for what the filter asks, else for the task's default.

    ``model``: error model of alignment; "exact" for misalignments of any size, "thesis" to first order in the tilt.
    ``bias_frame``: axes in which alignment takes the biases as constant, "body" or "nav".
    ``feedback``: "open" leaves the INS alone and corrects its output; "closed" resets the INS after each fix. The default
    is "open" in alignment, as in the thesis, and "closed" in navigation.
    ``coordinates``: coordinates of the errors that the filter estimates, "euler", "invariant"
    (:mod:`solvers.pipeline.errors.invariant`) or "equivariant" (:mod:`solvers.pipeline.errors.equivariant`).
    The default is "euler".
    ``coarse``: method of the coarse phase, which an unknown start needs (:mod:`solvers.pipeline.coarse`). Without one the data
    decide (:mod:`solvers.pipeline.coarse.choice`). A base that stays on the spot is aligned by "aided", or in navigation by
    "svd", for there it mostly stands more still than the velocities of fixes tell. One that travels is aligned in motion.
    ``coarse_again``: whether the epochs of the coarse phase are then filtered again, from the first fix on
    (:mod:`solvers.pipeline.switch_on`). They are all kept until then.
    ``aid_gate``: probability that a good reading of an aid, or a fix, lies within its gate; those outside are left out. With 1,
    the default, there is no gate.
    ``stillness``: whether a base that is seen to stand still (:mod:`solvers.pipeline.aiding.stillness`) has a velocity of zero.
    ``zero_rate``: whether it has no rate against the earth, too, with the noise of the gyros that already drives the prediction.
    ``bias_walk``: whether the biases wander as fast as told Gauss-Markov biases do. Otherwise, as by default, they are constants.

    Raises:
        ValueError: a value that is not allowed.
    """

    model: str = "exact"
    bias_frame: str = "body"
    feedback: str | None = None
    coordinates: str | None = None
    coarse: str | None = None
    coarse_again: bool = False
    aid_gate: float = 1.0
    stillness: bool = False
    zero_rate: bool = False
    bias_walk: bool = False

    def __post_init__(self) -> None:
        choice("model", self.model, MODELS)
        choice("bias_frame", self.bias_frame, BIAS_FRAMES)
        for name, allowed in (("feedback", FEEDBACK), ("coordinates", COORDINATES)):
            if getattr(self, name) is not None:
                choice(name, getattr(self, name), allowed)
        keep(self, "coarse_again", flag)
        keep(self, "stillness", flag)
        keep(self, "zero_rate", flag)
        keep(self, "bias_walk", flag)
        if self.zero_rate and not self.stillness:
            raise ValueError(
                "zero_rate = True with stillness = False; allowed: with stillness = True, which sees the rest"
            )
        if self.zero_rate and self.bias_frame == "nav":
            raise ValueError(
                "zero_rate = True with bias_frame = 'nav'; allowed: with bias_frame = 'body', where gyros are"
            )
        keep(self, "aid_gate", number, least=0.5, most=1.0)
        if self.coarse is not None:
            coarse_methods.check_method(self.coarse)
        if self.coordinates not in (None, "euler"):
            self._refuse(f"in {self.coordinates} coordinates")

    def navigating(self) -> Settings:
        """Return the settings with the defaults of those that only alignment has."""
        return replace(self, **{name: getattr(Settings, name) for name in ALIGNMENT_ONLY})

    def refuse_in_navigation(self, what: str) -> None:
        """Refuse a setting that only alignment has and that is not at its default.

        Raises:
            ValueError: there is one.
        """
        self._refuse(f"is of alignment, and {what} navigates")

    def refuse_with_aids(self) -> None:
        """Refuse a setting of the ten-state model, which has no vertical velocity and takes no aids.

        Raises:
            ValueError: there is one that is not at its default.
        """
        self._refuse("is of alignment without aids, and the task has aids")

    def _refuse(self, why: str) -> None:
        for name in ALIGNMENT_ONLY:
            given, default = getattr(self, name), getattr(Settings, name)
            if given != default:
                raise ValueError(f"{name} = {shown(given)} {why}; allowed: {default!r}")

    def completed(self, filter: Any, default: Settings) -> Settings:
        """Return the settings with what the filter asks, else the default, in place of ``None``."""
        return replace(
            self,
            feedback=self.feedback or getattr(filter, "feedback", default.feedback),
            coordinates=self.coordinates or getattr(filter, "coordinates", default.coordinates),
        )
