"""What one attempt comes to: refused in one clear line, worked, or a failure."""

import contextlib
import os
import resource
import signal
import traceback
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

MOST_CPU_S, MOST_MEMORY, MOST_MESSAGE = 5.0, 1 << 30, 3000
ROOTS = ("sins_env", "solvers")
#: Subclasses of ValueError that say nothing of where and what, or not to a user.
BARE = (UnicodeError, np.linalg.LinAlgError)


class Failed(AssertionError):
    """A failure; ``kind`` is the same for failures of one cause."""

    def __init__(self, kind: str, detail: str = "") -> None:
        super().__init__(f"{kind}: {detail}" if detail else kind)
        self.kind = kind


class _TooLong(BaseException):
    """The CPU time is over."""


def _stop(*_: Any) -> None:
    raise _TooLong


@contextlib.contextmanager
def _limits() -> Iterator[None]:
    """Limit CPU time and memory of what runs inside."""
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    pages = int(Path("/proc/self/statm").read_text().split()[0]) if os.path.exists("/proc/self/statm") else None
    before = signal.signal(signal.SIGPROF, _stop)
    if pages:
        resource.setrlimit(resource.RLIMIT_AS, (pages * resource.getpagesize() + MOST_MEMORY, hard))
    signal.setitimer(signal.ITIMER_PROF, MOST_CPU_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
        signal.signal(signal.SIGPROF, before)


def attempt(go: Callable[[], Any], names: tuple[str, ...] = ()) -> str:
    """Return "worked" or "refused".

    A refusal is a ValueError or an OSError of one line that holds one of ``names``, if there are any.

    Raises:
        Failed: anything else.
    """
    with warnings.catch_warnings(record=True) as seen:
        warnings.simplefilter("always")
        try:
            with _limits():
                go()
        except Failed:
            raise
        except BARE as error:
            raise Failed(f"{type(error).__name__} at {_place(error)}", str(error)) from error
        except (ValueError, OSError) as error:
            _check_message(error, names)
            return "refused"
        except _TooLong as error:
            raise Failed(f"more than {MOST_CPU_S:g} s of CPU at {_place(error)}") from error
        except (KeyboardInterrupt, GeneratorExit):
            raise
        except BaseException as error:
            raise Failed(f"{type(error).__name__} at {_place(error)}", str(error)[:300]) from error
    for one in seen:
        if "gymnasium" not in one.filename:
            where = f"{os.path.basename(one.filename)}:{one.lineno}"
            raise Failed(f"{one.category.__name__} at {where}", str(one.message)[:300])
    return "worked"


def _check_message(error: BaseException, names: tuple[str, ...]) -> None:
    text = str(error)
    if not text.strip():
        raise Failed(f"an empty {type(error).__name__} at {_place(error)}")
    if len(text) > MOST_MESSAGE:
        raise Failed(f"{type(error).__name__} of {len(text)} characters at {_place(error)}", text[:300])
    if "\n" in text:
        raise Failed(f"{type(error).__name__} of several lines at {_place(error)}", text[:300])
    if names and not any(name in text for name in names):
        raise Failed(f"{type(error).__name__} without the file's name at {_place(error)}", text[:300])


def _place(error: BaseException) -> str:
    """Return file and line of the innermost frame that is the project's own."""
    frames = traceback.extract_tb(error.__traceback__)
    own = [f for f in frames if any(f"/{root}/" in f.filename for root in ROOTS)] or list(frames)
    return f"{os.path.basename(own[-1].filename)}:{own[-1].lineno}"


def check_finite(what: str, values: Any) -> None:
    """Check that numbers, or a dict of them, are finite.

    Raises:
        Failed: they are not.
    """
    for name, value in values.items() if isinstance(values, dict) else [("", values)]:
        if isinstance(value, dict):
            check_finite(f"{what} {name}", value)
        elif not np.isfinite(value).all():
            raise Failed(f"{what} {name} not finite".replace("  ", " "))
