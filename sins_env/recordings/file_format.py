"""The description of a file format: the names of its files, their possible contents, and how to read and write them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from sins_env.recordings.mapping import Mapping
from sins_env.recordings.recording import Recording

#: Keys that the mapping of every format takes.
COMMON_KEYS = (
    "format",
    "file",
    "axes",
    "resample_hz",
    "drop_duplicates",
    "drop_null_fixes",
    "drop_held_fixes",
    "fix_shift_s",
    "bridge_s",
    "accept",
)
#: Keys of formats whose files do not state the place of the recording.
SITE_KEYS = ("rate_hz", "site", "lever_arm_m", "velocity_from_positions")
#: Keys of text formats, which have fixes and reference in files of their own.
TEXT_KEYS = (*SITE_KEYS, "gnss", "reference", "decimal", "comment", "skip_lines")


PACKED = (".gz", ".zip")  #: endings of compressed text files, behind their own


def unpacked_name(path: Path) -> Path:
    """Return a path without the ending of its compression."""
    return path.with_suffix("") if path.suffix.lower() in PACKED else path


@dataclass(frozen=True)
class Format:
    """A file format. Each module in ``formats`` makes one and calls it ``FORMAT``."""

    name: str  #: name that users type
    ending: str  #: end of a file's name, with the dot, or its whole name
    load: Callable[[Path, Mapping], Recording]
    #: Writes all files or none, and returns their paths; None for a format that is read only.
    save: Callable[[Recording, Path], list[Path]] | None = None
    keys: tuple[str, ...] = ()  #: keys that its mappings take, besides ``COMMON_KEYS``
    #: Endings that files with fixes and with the reference add to NAME; the mapping NAME.json names these files.
    companions: tuple[str, ...] = ()
    lacks: tuple[str, ...] = ()  #: names of ``PARTS`` that it has no place for
    #: Test of a file whose ending several formats share; what none recognises is that of the one that writes the ending.
    recognises: Callable[[Path], bool] = lambda path: False
    distinctive: bool = True  #: whether most files with this ending are recordings
    more_endings: tuple[str, ...] = ()  #: other endings of files that are read

    @property
    def allowed_keys(self) -> tuple[str, ...]:
        """Keys that a mapping of its files may have."""
        return (*COMMON_KEYS, *self.keys)

    def beside(self, path: Path) -> tuple[Path, ...]:
        """Return the files with fixes and reference that belong to ``path``; none if it holds them itself."""
        return tuple(path.with_name(f"{path.stem}{more}{path.suffix}") for more in self.companions)

    def __str__(self) -> str:
        """Return its name and files as help texts show them, such as "psins-imu (.imu)"."""
        beside = [f"NAME{more}{self.ending}" for more in self.companions]
        more = f", with {', '.join(beside)} and NAME.json" if beside else ""
        return f"{self.name} ({self.ending}{more})"


def _has_spread(recording: Recording) -> bool:
    gnss = recording.gnss
    return gnss is not None and (gnss.pos_std is not None or gnss.vel_std is not None)


#: Parts that a recording may have, each with a test. Not every format has a place for them.
PARTS: dict[str, Callable[[Recording], bool]] = {
    "fixes": lambda recording: recording.gnss is not None,
    "reference": lambda recording: recording.reference is not None,
    "lever arm": lambda recording: recording.lever_arm is not None,
    "displacements": lambda recording: recording.displacements is not None,
    "standard deviations of the fixes": _has_spread,
    "aids": lambda recording: bool(recording.aids),
}
