"""File formats, one module each: a file becomes a :class:`sins_env.recordings.Recording`, and a recording becomes a file.

A module here makes its ``FORMAT``; every list of formats and every help text is made from these. Read ``npz``, the
package's own, then ``csv_files``, ``kfgins``, ``psins_imu``, ``psins_mat``.
"""

from __future__ import annotations

import importlib
import pkgutil

from sins_env.recordings.file_format import Format

_MODULES = (importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__))
#: Every format by its name, in the order of the names.
FORMATS: dict[str, Format] = {name: one for name, one in sorted((m.FORMAT.name, m.FORMAT) for m in _MODULES)}
