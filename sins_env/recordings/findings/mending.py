"""The fixes of a recording without those that its mapping leaves out, on the clock that it names, with velocities."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from sins_env.arrays import Mask
from sins_env.recordings.assembling import site, with_velocities
from sins_env.recordings.findings.fixes import is_held, is_null
from sins_env.recordings.mapping import Mapping
from sins_env.recordings.recording import Gnss, Recording


def with_mended_fixes(recording: Recording, mapping: Mapping) -> Recording:
    """Return the recording with its fixes as ``drop_null_fixes``, ``drop_held_fixes`` and ``fix_shift_s`` want them.

    A site that was that of a fix which is left out becomes that of the first fix that stays. With
    ``velocity_from_positions`` the fixes that stay get velocities, unless they have some.

    Raises:
        ValueError: no fix is left, or no two in a row for velocities.
    """
    gnss = recording.gnss
    if gnss is None:
        return recording
    first = gnss.pos[0]
    if mapping.drop_null_fixes:
        gnss = _kept(gnss, ~is_null(gnss))
    if mapping.drop_held_fixes:
        gnss = _kept(gnss, ~is_held(gnss))
    if not len(gnss.t_s):
        raise ValueError("no fix is left without those that its mapping leaves out; allowed: a file with fixes")
    place = recording.site
    if np.array_equal([place.latitude, place.longitude], first[:2]) and not np.array_equal(gnss.pos[0], first):
        place = site(gnss.pos[0], place.earth)
    if mapping.velocity_from_positions and gnss.vel is None:
        gnss = with_velocities(gnss)
    return replace(recording, gnss=gnss._replace(t_s=gnss.t_s + mapping.fix_shift_s), site=place)


def _kept(gnss: Gnss, keep: Mask) -> Gnss:
    if keep.all():
        return gnss
    vel, pos_std, vel_std = (None if part is None else part[keep] for part in (gnss.vel, gnss.pos_std, gnss.vel_std))
    return Gnss(gnss.t_s[keep], vel, gnss.pos[keep], pos_std, vel_std)
