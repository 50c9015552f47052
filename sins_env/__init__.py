"""sins_env: which filter aligns a strapdown inertial system fastest, and how far is it from the best possible?

These conventions hold everywhere. Quantities are SI, radians and float64. Degrees, arcsec, deg/h and micro-g appear only
in fields that carry the unit in their name, on the command line and in reports.

Frames     n: East-North-Up at the base; b: Right-Forward-Up of the IMU; i: inertial; e: Earth-fixed; c: the computed n.
Attitude   ``q_nb`` is a Hamilton quaternion, scalar first, that turns body vectors into n: v_n = q_nb v_b q_nb*,
           C_nb @ v_b = v_n. Heading is clockwise from north, pitch nose up, roll right side down.
Errors     computed minus true, measured minus true. The misalignment phi (E, N, U) turns n into c: C_hat = C_n^c(phi) C_nb.
Position   latitude rad, longitude rad, height m.
Shapes     batch first: (..., n) states and (..., n, n) covariances; one run is batch shape ().
Time       observation k covers (t_{k-1}, t_k]; the action is the estimate at t_k.

Symbols x P F Q H R K S stand for themselves inside the mathematics. The source documents are 000, Wang Junhou's thesis
(2011), and 001 to 004. Equation numbers such as (2.2.17) are the thesis' own; docs/mathematics/errata.md corrects its
misprints. The frames and errors are those of docs/mathematics/frames.md.

Read the ground floor first: ``units``, ``types``, ``attitude``, ``earth``, ``specs``, ``presets``, ``prior``, ``motion``.
Then follow the data: ``trajectory``, ``sensors``, ``recordings``, ``worlds``, ``envs``, ``evaluation``, ``learning``, ``cli``.

Importing this package registers the environments of :mod:`sins_env.envs` with Gymnasium, but does not import Gymnasium.
In either order of the two imports ``gymnasium.make("SINS/AlignSway-v0")`` works afterwards.
"""

# ruff: noqa: E402 - Ctrl-C while the command starts and ends, when it has no handler, comes before any other import
import sys as _sys

_NAME = _sys.argv[0] if _sys.argv else ""
#: Whether this process is the command, as a script ``sins-env`` or as ``python -m sins_env``.
_COMMAND = _NAME.endswith(("sins-env", "sins-env.exe")) or (_NAME == "-m" and "sins_env" in _sys.orig_argv)


def _said(kind, error, trace):  # type: ignore[no-untyped-def]  # their types would have to be imported
    """Print what ended the command: one line for Ctrl-C, and a traceback for all else."""
    if issubclass(kind, KeyboardInterrupt):
        _sys.stderr.write("sins-env: interrupted\n")
    else:
        _sys.__excepthook__(kind, error, trace)


if _COMMAND:
    _sys.excepthook = _said

from importlib import import_module as _import
from importlib.util import find_spec as _find_spec
from typing import TYPE_CHECKING as _TYPES
from typing import Any as _Any

from sins_env import imports as _imports
from sins_env import moved as _moved

if _TYPES:
    from sins_env import tasks
    from sins_env.evaluation.monte_carlo import evaluate
    from sins_env.evaluation.planning.family import bound
    from sins_env.evaluation.score.paired import compare
    from sins_env.evaluation.show.drawn_results import DrawnResults as Results
    from sins_env.evaluation.solution.navigating import navigate
    from sins_env.evaluation.solution.solution import Solution
    from sins_env.evaluation.store.results_file import ResultsFile as Store
    from sins_env.learning.dataset import dataset
    from sins_env.prior import Prior
    from sins_env.specs import GPS_PRESETS, IMU_PRESETS, GpsSpec, ImuSpec
    from sins_env.types import Estimator, NavState, Observation, Site, Task

__version__ = "0.2.0"
__all__ = [
    "GPS_PRESETS",
    "IMU_PRESETS",
    "Estimator",
    "GpsSpec",
    "ImuSpec",
    "NavState",
    "Observation",
    "Prior",
    "Results",
    "Site",
    "Solution",
    "Store",
    "Task",
    "bound",
    "compare",
    "dataset",
    "evaluate",
    "navigate",
    "tasks",
]

#: Modules of the public names. They are imported when a name is asked for, so that the command line can begin before.
_MODULES = {
    "Prior": "prior",
    "Results": "evaluation.show.drawn_results:DrawnResults",
    "Store": "evaluation.store.results_file:ResultsFile",
    "bound": "evaluation.planning.family",
    "compare": "evaluation.score.paired",
    "dataset": "learning.dataset",
    "evaluate": "evaluation.monte_carlo",
    "Solution": "evaluation.solution.solution",
    "navigate": "evaluation.solution.navigating",
    **dict.fromkeys(("GPS_PRESETS", "IMU_PRESETS", "GpsSpec", "ImuSpec"), "specs"),
}


def __getattr__(name: str) -> _Any:
    if name in __all__ and name != "tasks":
        module, _, other = _MODULES.get(name, "types").partition(":")
        found = globals()[name] = getattr(_import(f"{__name__}.{module}"), other or name)
        return found
    if not name.startswith("_") and _find_spec(f"{__name__}.{name}"):
        return _import(f"{__name__}.{name}")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})


_moved.install()
_imports.install()
