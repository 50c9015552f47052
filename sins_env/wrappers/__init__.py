"""Wrappers of the environments, single and vector, for those who learn: corrections as actions, NED and FRD, scaled observations.

An environment comes in; a wrapper of Gymnasium of the same form goes out. Read ``translated``, which both forms share, then
``correcting``, ``frames``, ``scaling``. Together they are put on in this order, from the inside out.

    env = gymnasium.make("SINS/AlignSway-v0")
    env = wrappers.scaled(wrappers.north_east_down(wrappers.corrections(env, solver="ckf")))

docs/learning.md#wrappers.
"""

from sins_env.wrappers.correcting import corrections
from sins_env.wrappers.frames import north_east_down
from sins_env.wrappers.scaling import scaled

__all__ = ["corrections", "north_east_down", "scaled"]
