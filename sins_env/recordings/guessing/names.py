"""What the names of columns say: which are times, angular rates, specific forces, positions and velocities."""

from __future__ import annotations

import re
from collections.abc import Iterator

AXES = ("xyz", "012", "123")  #: ends of the names of three components
_SHORT = {"gyro": ("w", "g", "om", "wrss", "wrs"), "accel": ("a", "f", "arss", "ars")}
_ENDS = {
    "gyro": ("gyr", "gyro", "gyros", "gyroscope", "angvel", "angularvelocity", "angularrate", "angrate", "angularrates", "omega",
             "dtheta", "deltatheta", "deltaangle", "rate", "gyrorate", "rotationrate"),
    "accel": ("acc", "accel", "accels", "accelerometer", "acceleration", "linearacceleration", "specificforce", "force", "dvel",
              "deltavel", "deltavelocity", "dv", "userfacc"),
}  # fmt: skip
_OTHERS = ("free", "mag", "lin", "ref", "true", "bias", "std", "cov", "euler")
#: Words that a name of a single column may be, in the order of preference.
SINGLE = {
    "time": ("t", "time", "timestamp", "timestamps", "stamp", "sampletimefine", "gpstime", "tow", "itow", "sow", "gpssow", "sec",
             "seconds", "secondsofweek", "timeus", "timems", "timens", "times", "utc", "utctime", "datetime", "unixtime",
             "headerstamp", "timestampsample", "timeofweek", "gpst"),
    "week": ("week", "gpsweek", "weeknumber", "wn", "weekno"),
    "latitude": ("lat", "latitude", "latdeg", "gpslat", "latituderad", "gnsslat", "latitudedeg"),
    "longitude": ("lon", "lng", "long", "longitude", "londeg", "gpslon", "gnsslon", "longitudedeg"),
    "height": ("h", "hae", "heightell", "height", "alt", "altitude", "hellipsoid", "gpsalt", "heightm", "altitudem", "hgt",
               "altellipsoid"),
    "north": ("vn", "veln", "velnorth", "vnorth", "northvelocity", "velocitynorth", "vnmps", "velocityn", "veln"),
    "east": ("ve", "vele", "veleast", "veast", "eastvelocity", "velocityeast", "vemps", "velocitye"),
    "down": ("vd", "veld", "veldown", "vdown", "downvelocity", "velocitydown", "vdmps", "velocityd"),
    "up": ("vu", "velu", "velup", "vup", "upvelocity", "velocityup", "vumps", "velocityu"),
    "std_north": ("sdn", "stdn", "stdnorth", "sigman"),
    "std_east": ("sde", "stde", "stdeast", "sigmae"),
    "std_up": ("sdu", "stdu", "stdup", "sigmau"),
}  # fmt: skip


def plain(name: str) -> str:
    """Return a name without its unit, signs and capitals."""
    return "".join(filter(str.isalnum, re.sub(r"[\[({][^\])}]*[\])}]\s*$", "", name))).lower()


def single(names: list[str], role: str) -> str | None:
    """Return the column whose name is one of the words for a role."""
    there = {plain(name): name for name in reversed(names)}
    return next((there[word] for word in SINGLE[role] if word in there), None)


def triples(names: list[str], role: str) -> Iterator[list[str]]:
    """Yield the columns x, y, z whose names are those of gyros or of accelerometers; the most usual first."""
    there = {plain(name): name for name in reversed(names)}
    found: list[tuple[bool, list[str]]] = []
    for ends in AXES:
        for word in there:
            base = word.removesuffix(ends[0])
            if base == word or any(base + end not in there for end in ends):
                continue
            if base in _SHORT[role] or base.endswith(_ENDS[role]):
                found.append((any(other in base for other in _OTHERS), [there[base + end] for end in ends]))
    yield from (columns for other, columns in sorted(found, key=lambda one: one[0]))
