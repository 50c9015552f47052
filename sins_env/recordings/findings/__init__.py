"""Findings: what a recording says against itself, before any filter sees it.

A :class:`Recording` comes in. Findings go out, each with a name, the measured value beside its limit, a time span and what
would explain it. A finding that makes results wrong refuses the recording unless its name is accepted; others are warnings.

Read ``finding``, then the checks: ``time``, ``fixes``, ``inertial``, ``course``, ``together``, ``reference``. A new one is
a function in ``CHECKS``.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

from sins_env.recordings.findings import fixes, inertial, reference, time, together
from sins_env.recordings.findings.finding import REFUSING, Check, Finding
from sins_env.recordings.recording import Recording

#: The checks, in the order in which findings are told.
CHECKS: tuple[Check, ...] = (
    time.jitter,
    time.repeated_stamps,
    time.bridged_gaps,
    time.long_gaps,
    fixes.null_fixes,
    fixes.held_fixes,
    fixes.positions_and_velocities,
    fixes.receiver_std,
    inertial.hung_sensor,
    inertial.saturated,
    inertial.glitches,
    inertial.gravity_at_rest,
    inertial.earth_rate_at_rest,
    together.clocks_and_axes,
    reference.reference_attitude,
    reference.reference_course,
)


@lru_cache(maxsize=2)  # a recording is checked when it is read, and its findings are told after
def findings(recording: Recording) -> tuple[Finding, ...]:
    """Return what the checks find, in the order of ``CHECKS``; empty if all is well."""
    return tuple(one for check in CHECKS for one in check(recording))


def check_findings(found: Sequence[Finding], accepted: Sequence[str]) -> None:
    """Refuse a recording whose findings make results wrong.

    Raises:
        ValueError: findings that are not ``accepted``; the error has the first one and the names of all.
    """
    left = [one for one in found if one.wrong and one.name not in accepted]
    if left:
        names = ", ".join(dict.fromkeys(one.name for one in left))
        raise ValueError(f"{left[0]}; allowed: data without it, or accepted as they are: {names}")


__all__ = ["CHECKS", "REFUSING", "Check", "Finding", "check_findings", "findings"]
