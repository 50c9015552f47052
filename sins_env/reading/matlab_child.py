"""Read a ``.mat`` file from standard input, and write its arrays as an NPZ archive to standard output.

:mod:`sins_env.reading.matlab` runs this file as a program. It imports nothing of the package.
"""

import io
import json
import sys

import numpy as np

try:
    import resource
except ImportError:  # only Unix has limits of this kind
    resource = None  # type: ignore[assignment]

OTHERS = "__others__"  #: name under which it describes what is no array of numbers or text


def limit(memory: int, seconds: int) -> None:
    """Limit memory, bytes, and CPU time, s, of this process."""
    if resource is None:
        return
    for what, most in ((resource.RLIMIT_CORE, 0), (resource.RLIMIT_CPU, seconds), (resource.RLIMIT_AS, memory)):
        hard = resource.getrlimit(what)[1]
        resource.setrlimit(what, (most if hard == resource.RLIM_INFINITY else min(most, hard), hard))


def main() -> None:
    """Read and write, or end with one line that says why not."""
    from scipy.io import loadmat  # slow to import, and not needed by the parent

    limit(int(sys.argv[1]), int(sys.argv[2]))
    try:
        found = loadmat(io.BytesIO(sys.stdin.buffer.read()), squeeze_me=False)
    except NotImplementedError:
        sys.exit("MATLAB 7.3 (HDF5); allowed: save(..., '-v7') or older")
    except BaseException as error:  # whatever damaged bytes provoke
        sys.exit(" ".join(f"{type(error).__name__}: {error}".split()))
    trj = found.get("trj")
    if isinstance(trj, np.ndarray) and trj.dtype.names and trj.size == 1:
        found = {**found, **{name: trj[name].item() for name in trj.dtype.names}}
    structs = {
        name: one for name, one in found.items() if isinstance(one, np.ndarray) and one.dtype.names and one.size == 1
    }
    for name, one in structs.items():
        found |= {f"{name}.{field}": one[field].item() for field in one.dtype.names}
    arrays, others = {}, {}
    for name, value in found.items():
        if name.startswith("__"):
            continue
        if isinstance(value, np.ndarray) and value.dtype.kind in "biufcU":
            arrays[name] = value
        else:
            shape = getattr(value, "shape", ())
            others[name] = f"{getattr(value, 'dtype', type(value).__name__)} of shape {shape}"[:200]
    out = io.BytesIO()
    arrays[OTHERS] = np.array(json.dumps(others))
    np.savez(out, **arrays)  # type: ignore[arg-type]  # the stubs take any keyword for allow_pickle
    sys.stdout.buffer.write(out.getbuffer())


if __name__ == "__main__":
    main()
