"""What a file format is: how its files are called, what they have a place for, and the functions that read and write them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from sins_env.recordings.mapping import Mapping
from sins_env.recordings.recording import Recording

#: Keys that the mapping of every format takes.
COMMON_KEYS = ("format", "file", "axes", "resample_hz", "drop_duplicates")
#: Keys of formats whose files do not say where they were recorded, and of text files that have others beside them.
SITE_KEYS = ("rate_hz", "site", "lever_arm_m", "velocity_from_positions")
TEXT_KEYS = (*SITE_KEYS, "gnss", "reference")


@dataclass(frozen=True)
class Format:
    """A file format. Each file in ``formats`` makes one and calls it ``FORMAT``."""

    name: str  #: what users type
    ending: str  #: the end of a file's name, with the dot
    load: Callable[[Path, Mapping], Recording]
    save: Callable[[Recording, Path], list[Path]]  #: writes all files or none, and returns their paths
    keys: tuple[str, ...] = ()  #: keys that its mappings take, besides ``COMMON_KEYS``
    companions: tuple[
        str, ...
    ] = ()  #: what the names of files with fixes and reference add to NAME; NAME.json maps them
    lacks: tuple[str, ...] = ()  #: names of ``PARTS`` that it has no place for
    recognises: Callable[[Path], bool] = lambda path: True  #: asked where formats share an ending
    distinctive: bool = True  #: False where most files of that ending are no recordings

    @property
    def allowed_keys(self) -> tuple[str, ...]:
        """Every key that a mapping of its files may have."""
        return (*COMMON_KEYS, *self.keys)

    def beside(self, path: Path) -> tuple[Path, ...]:
        """The files with fixes and reference that belong to ``path``; none where it holds them itself."""
        return tuple(path.with_name(f"{path.stem}{more}{path.suffix}") for more in self.companions)

    def __str__(self) -> str:
        """Its name and files as help texts show them: "psins-imu (.imu)"."""
        beside = [f"NAME{more}{self.ending}" for more in self.companions]
        more = f", with {', '.join(beside)} and NAME.json" if beside else ""
        return f"{self.name} ({self.ending}{more})"


def _has_spread(recording: Recording) -> bool:
    gnss = recording.gnss
    return gnss is not None and (gnss.pos_std is not None or gnss.vel_std is not None)


#: Parts that not every recording has, and not every format has a place for.
PARTS: dict[str, Callable[[Recording], bool]] = {
    "fixes": lambda recording: recording.gnss is not None,
    "reference": lambda recording: recording.reference is not None,
    "lever arm": lambda recording: recording.lever_arm is not None,
    "displacements": lambda recording: recording.displacements is not None,
    "standard deviations of the fixes": _has_spread,
}
