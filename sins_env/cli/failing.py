"""The error of an estimator as the one line of a command whose run failed."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from sins_env.cli.output import RunFailed
from sins_env.evaluation.estimators.guard import EstimatorError, Refusal


@contextmanager
def failing(what: str = "") -> Iterator[None]:
    """Turn the error of an estimator into that of a failed run, whose message begins with ``what``; wrong use stays what it is.

    Raises:
        RunFailed: the estimator failed.
    """
    try:
        yield
    except Refusal:
        raise
    except EstimatorError as error:
        raise RunFailed(f"{what}: {error}" if what else str(error)) from error
