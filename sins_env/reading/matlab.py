"""MATLAB files of others, read by SciPy in a process of its own: a damaged file ends that process, and no more.

The child has limits of memory and of time that grow with the file. It passes back plain arrays, without pickle.
"""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np

from sins_env.reading import matlab_child
from sins_env.reading.files import opened

MOST_FILE = 2 << 30  #: largest file
BASE_MEMORY, MEMORY_PER_BYTE = 2 << 30, 64  #: memory of the child, bytes, and what each byte of the file adds
#: CPU time of the child, s, and what each megabyte of the file adds; by the clock ten times that.
BASE_S, S_PER_MB = 20, 1


def read_matlab(path: Path) -> tuple[dict[str, Any], dict[str, str]]:
    """Read the variables of a ``.mat`` file, and those of a struct of one element called ``trj``.

    Returns arrays of numbers or text by name, and descriptions of the other variables, such as "object of shape (1, 1)".

    Raises:
        ValueError: MATLAB 7.3, a damaged file, or one that needs more memory or time than it may.
        OSError: no such file, or one that cannot be read.
    """
    with opened(path, MOST_FILE) as stream:
        size = os.fstat(stream.fileno()).st_size
        seconds = BASE_S + S_PER_MB * (size >> 20)
        command = [sys.executable, "-P", matlab_child.__file__, str(BASE_MEMORY + MEMORY_PER_BYTE * size), str(seconds)]
        try:
            done = subprocess.run(
                command,
                stdin=stream,
                capture_output=True,
                timeout=10 * seconds,
                env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
            )
        except subprocess.TimeoutExpired:
            raise ValueError(f"{path}: not read within {10 * seconds} s; allowed: a sound .mat file") from None
    if done.returncode:
        said = done.stderr.decode(errors="replace").strip().splitlines()
        if done.returncode == 1 and said and said[-1].startswith("MATLAB 7.3"):
            raise ValueError(f"{path}: {said[-1]}")
        why = said[-1][:300] if done.returncode == 1 and said else f"it ended its reader with code {done.returncode}"
        raise ValueError(f"{path}: not a readable .mat file, or a damaged one ({why})")
    with np.load(io.BytesIO(done.stdout), allow_pickle=False) as found:
        arrays = {name: found[name] for name in found.files if name != matlab_child.OTHERS}
        return arrays, json.loads(str(found[matlab_child.OTHERS]))
