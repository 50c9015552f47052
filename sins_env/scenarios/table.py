"""The keys of a scenario that all kinds of motion share, and those of one kind together with them."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from sins_env import checks
from sins_env.earth import EARTHS
from sins_env.prior import PRIORS
from sins_env.scenarios.key import Key, nameless, number, one_of, text, whole
from sins_env.scenarios.motions import KINDS, MotionKind
from sins_env.sensors import aids
from sins_env.specs import gps_spec, imu_spec
from sins_env.worlds import settings
from sins_env.worlds.flight import ERRORS
from sins_env.worlds.receiver_std import ReceiverStd

RANKINGS = ("azimuth", "position", "velocity", "failures")  #: scores by which a task of navigation can rank
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,79}")


def _name(name: str, given: Any) -> str:
    if not isinstance(given, str) or not _NAME.fullmatch(given):
        raise checks.refused(name, given, "letters, digits, points, dashes and underlines, such as ferry-v0")
    return given


def _aids(name: str, given: Any) -> Any:
    on = {one: spec for one, spec in given.items() if spec != "off"} if isinstance(given, Mapping) else given
    aids.specs(on)
    return given


COMMON = (
    Key("name", "name of the task; a change of anything but what and source needs a new one", "task.name", _name),
    Key("what", "description in one line", "task.what", text),
    Key("source", "where the scenario comes from", "task.source", text),
    Key("motion.kind", "kind of motion", "", one_of(*KINDS)),
    Key("site.latitude_deg", "latitude", "latitude_deg", settings.check_latitude),
    Key("site.longitude_deg", "longitude", "longitude_deg", settings.check_longitude),
    Key("site.height_m", "height", "height_m", settings.check_height),
    Key(
        "site.heading_deg",
        "mean heading, clockwise from north; any: drawn in each run; a list: run i takes item i, again and again",
        "heading_deg",
        nameless(settings.check_heading),
        {"any": None},
    ),
    Key("site.earth", "model of the Earth", "earth", one_of(*EARTHS)),
    Key(
        "imu",
        "errors of the inertial sensors: a preset, or a dict of fields with or without a preset",
        "imu",
        nameless(imu_spec),
    ),
    Key(
        "gps", "errors of the fixes: a preset, or a dict of fields with or without a preset", "gps", nameless(gps_spec)
    ),
    Key("aids", "further sensors: a dict with a preset or a dict of fields for each", "aids", _aids),
    Key(
        "start.kind", "told: the start is told with errors; unknown: solvers find it", "start", one_of(*settings.STARTS)
    ),
    Key(
        "start.coarse_s",
        "coarse phase of an unknown start; 0: solvers begin at switch-on",
        "coarse",
        nameless(settings.check_coarse, "unknown", 0.0),
    ),
    Key(
        "start.attitude_std_deg", "1 sigma of a told attitude, E, N, U", "attitude_std_deg", settings.check_attitude_std
    ),
    Key("start.velocity_std_mps", "1 sigma of a told velocity", "velocity_std_mps", settings.check_velocity_std),
    Key("start.position_std_m", "1 sigma of a told position", "position_std_m", settings.check_position_std),
    Key(
        "start.misalignment_deg",
        "a misalignment E, N, U that is the same in every run instead of drawn",
        "misalignment_deg",
        nameless(settings.check_misalignment, "told"),
    ),
    Key("start.any_heading", "whether the told heading is drawn over the circle", "any_heading", checks.flag),
    Key("start.errors", "fixed: misalignment and biases are + 1 sigma in every run", "errors", one_of(*ERRORS)),
    Key("told.imu", "what solvers are told of the IMU where it differs from imu", "told.imu", nameless(imu_spec)),
    Key("told.gps", "what solvers are told of the fixes where it differs from gps", "told.gps", nameless(gps_spec)),
    Key(
        "told.fix_std",
        "how the standard deviations that a receiver states are used",
        "fix_std",
        nameless(ReceiverStd.made),
    ),
    Key(
        "told.prior",
        "matched: the prior states what is drawn; thesis: that of 000 section 2.5.4",
        "prior",
        one_of(*PRIORS),
    ),
    Key("epoch_s", "time from one estimate to the next", "epoch", nameless(settings.check_epoch)),
    Key("samples_per_epoch", "IMU samples in an epoch", "n_sub", nameless(settings.check_samples)),
    Key("duration_s", "length of a run, with the coarse phase", "duration", nameless(settings.check_duration, 0.0)),
    Key(
        "navigate",
        "whether a solver of a recording returns velocity and position, too",
        "mode",
        checks.flag,
        {True: "navigate", False: "align"},
    ),
    Key(
        "score.azimuth_deg",
        "threshold of the azimuth; left out, three times the bound at the end, rounded up to 0.1",
        "task.delta_azimuth_deg",
        number(above=0.0, most=180.0),
    ),
    Key(
        "score.level_arcsec",
        "threshold of the level; left out, three times the bound at the end, rounded up to 10",
        "task.delta_level_arcsec",
        number(above=0.0, most=648000.0),
    ),
    Key(
        "score.hold_s",
        "least time that an error must stay within its threshold until the end; left out, 60 s or half of what is scored",
        "task.hold_s",
        number(least=0.0, most=1e7),
    ),
    Key("score.rank_by", "score that ranks a task of navigation", "task.rank_by", one_of(*RANKINGS)),
    Key(
        "score.from_s",
        "start of the time means of a task of navigation",
        "task.score_from_s",
        number(least=0.0, most=1e7),
    ),
    Key(
        "score.fail_azimuth_deg",
        "azimuth error at the end above which a run has failed",
        "task.fail_azimuth_deg",
        number(above=0.0, most=180.0),
    ),
    Key("seed", "seed of the suite", "task.suite_seed", whole(0)),
    Key("seeds_of", "name of a task whose runs have the same draws", "task.seeds_of", _name),
    Key("digest", "digest of the world, as sins-env describe shows it; another world is refused", "task.digest", text),
)

#: Word that may stand for an object of keys, and which of them it then is.
SHORT = {"motion": "motion.kind", "start": "start.kind"}


def keys_of(kind: MotionKind) -> dict[str, Key]:
    """Return the keys of scenarios with a kind of motion, by path, in the order in which they are best written."""
    own = [key for key in COMMON if key.path == "motion.kind" or kind.target(key)]
    place = next(i for i, key in enumerate(own) if key.path == "motion.kind") + 1
    return {key.path: key for key in (*own[:place], *kind.keys, *own[place:])}


def every_key() -> dict[str, tuple[Key, list[MotionKind]]]:
    """Return every key by path, with the kinds of motion that have it."""
    found: dict[str, tuple[Key, list[MotionKind]]] = {}
    for kind in KINDS.values():
        for path, key in keys_of(kind).items():
            found.setdefault(path, (key, []))[1].append(kind)
    return found
