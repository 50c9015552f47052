"""The alignment environments of a simulated base that stays in its place."""

from __future__ import annotations

from typing import Any

from sins_env.envs.base import EpisodeEnv, EpisodeVectorEnv
from sins_env.envs.settings import AlignSettings
from sins_env.envs.world import SwayWorld, World


def _sway(**settings: Any) -> World:
    return SwayWorld("SINS/AlignSway-v0", AlignSettings.of(settings), still=False)


def _static(**settings: Any) -> World:
    return SwayWorld("SINS/AlignStatic-v0", AlignSettings.of(settings), still=True)


class AlignSwayEnv(EpisodeEnv):
    """``SINS/AlignSway-v0``: the swaying base of 000 section 2.5.1."""

    world = staticmethod(_sway)


class AlignSwayVectorEnv(EpisodeVectorEnv):
    world = staticmethod(_sway)


class AlignStaticEnv(EpisodeEnv):
    """``SINS/AlignStatic-v0``: a base that stands still."""

    world = staticmethod(_static)


class AlignStaticVectorEnv(EpisodeVectorEnv):
    world = staticmethod(_static)
