"""What the entry point ``solvers`` of the group ``sins_env.estimators`` offers: ``names()``, and a factory under each of them.

zoo.ckf(form="square-root")
"""

from __future__ import annotations

import inspect
from functools import partial

import solvers
from solvers.registry import class_of

RECOMMENDED = "gsf_imm"  #: the solver that who names none gets
#: Its settings for a recording. Real vehicles stand and are rocked, and sensors may be noisier than told in all axes. A model of
#: quieter sensors soon believes its biases too well, and the position drifts when fixes are missing.
RECORDED = {"stillness": True, "imu_factors": ((1.0, 1.0), (10.0, 10.0), (1000.0, 1000.0))}


def names(package: str = "solvers") -> list[str]:
    """The solvers whose classes a package or module defines: this project's own, or those that another has registered."""
    return [name for name in solvers.names() if f"{class_of(name).__module__}.".startswith(f"{package}.")]


def __getattr__(name: str) -> partial[solvers.Estimator]:
    """The factory of a solver, with its docstring and its settings."""
    if name not in solvers.names():
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    factory = partial(solvers.make, name)
    factory.__doc__ = solvers.describe(name)
    factory.__signature__ = inspect.Signature(solvers.settings(name))  # type: ignore[attr-defined]
    return factory
