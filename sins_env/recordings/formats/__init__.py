"""File formats, one module each.

A file and a mapping come in and a :class:`sins_env.recordings.Recording` goes out, or the other way round. A module makes
its ``FORMAT``; lists of formats and help texts are made from these. Read ``npz``, which has the package's own format,
then ``csv_files``, ``kfgins``, ``psins_imu``, ``psins_mat``. ``kitti``, ``navego``, ``novatel`` and ``rtklib`` are read only.
"""

from __future__ import annotations

import importlib
import pkgutil

from sins_env.recordings.file_format import Format

_MODULES = (importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__))
#: Formats by name, in alphabetical order.
FORMATS: dict[str, Format] = {name: one for name, one in sorted((m.FORMAT.name, m.FORMAT) for m in _MODULES)}
