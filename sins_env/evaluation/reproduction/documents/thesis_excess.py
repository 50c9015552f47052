"""What lies between the bound and the filters on the swaying base: the start, a wandering bias, the rate of the fixes, vibration.

Each part is worked out or run by itself. See docs/mathematics/bound.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from sins_env.evaluation.bound import bounds
from sins_env.evaluation.bound.error_dynamics import ErrorDynamics, simulated, true_motion
from sins_env.evaluation.reproduction.documents.thesis_filters import (
    AZIMUTH,
    BASES,
    MARKOV,
    MATCHED,
    RUNS,
    WHITE,
    cap,
    variant,
)
from sins_env.evaluation.reproduction.readings.common import bound_at, end_errors, quotient
from sins_env.evaluation.reproduction.tables import Claim, Group, Line, Source, Table
from sins_env.evaluation.reproduction.verdicts import NOTHING, Estimate
from sins_env.evaluation.score import losses, paired
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.units import ARCSEC

TIMES_S = (300.0, 360.0, 600.0)  #: times at which the tables print Gauss-Markov runs
END_S = 360.0  #: time at which they print runs in white noise
SHAKEN = variant(BASES[WHITE], "vibration", f"{BASES[WHITE].what}, with the vibration of 000 (2.5.5)", vibration=True)
FAST = variant(
    BASES[WHITE],
    "fixes-100hz",
    f"{BASES[WHITE].what}, a fix at each step of 100 Hz",
    gps={"preset": "thesis", "rate_hz": 100.0},
    epoch=0.01,
    n_sub=1,
)


def over_bound(results: Results) -> Estimate:
    """Read the azimuth at the end over the bound, adjusted by the luck of the oracle in the same runs."""
    if results.oracle is None:
        return NOTHING
    mine, its = paired.common(results.records, results.oracle)
    value, (low, high) = losses.over_bound(
        losses.capped(end_errors(results)[mine, AZIMUTH], cap(MARKOV, MATCHED, AZIMUTH)),
        np.square(results.oracle.final[its, AZIMUTH]),
        bound_at(results, AZIMUTH, results.records.criteria.duration_s),
    )
    return Estimate(value, low, high, len(mine))


def for_constant(task: EvaluationTask) -> dict[float, float]:
    """Return at TIMES_S the azimuth error of a linear filter that takes wandering biases for constant, over the bound.

    It is linear at the truth as the bound is, and worked out without a draw. With x the errors, e = x - estimate, and F' the
    transition that the filter believes: x = F x + w, e = (F - F') x + F' e + w, and a fix leaves (I - K H) e - K v.
    """
    found = simulated(task)
    assert found is not None
    public, world = found
    model, believed = ErrorDynamics(world), ErrorDynamics(world)
    believed.biases = [(states, kind._replace(time_constant_s=math.inf)) for states, kind in believed.biases]
    wandering = np.isin(np.arange(model.n), [_kept(model, i) for i in _wandering(model)])
    P = best = model.P0
    both = np.block([[P, P], [P, P]])
    out: dict[float, float] = {}
    one, azimuth = np.eye(model.n), int(model.scored[AZIMUTH])
    for part in true_motion(task, public, 1):
        F, own, H = model.transitions(part)[0], believed.transitions(part)[0], model.sensitivity(part)[0]
        Q = model.noise(part, F[None])[0]
        told = np.where(wandering[:, None] | wandering, 0.0, Q)
        for k, fix in enumerate(part.fix):
            G = np.block([[F[k], 0.0 * F[k]], [F[k] - own[k], own[k]]])
            both = G @ both @ G.T + np.block([[Q[k], Q[k]], [Q[k], Q[k]]])
            P, best = own[k] @ P @ own[k].T + told[k], F[k] @ best @ F[k].T + Q[k]
            if fix:
                K = np.linalg.solve(H[k] @ P @ H[k].T + model.R, H[k] @ P).T
                left = np.block([[one, 0.0 * one], [0.0 * one, one - K @ H[k]]])
                both = left @ both @ left.T
                both[model.n :, model.n :] += K @ model.R @ K.T
                P, best = bounds.correct(P, H[k], model.R), bounds.correct(best, H[k], model.R)
            t = round((part.first + k + 1) * public.epoch_s, 6)
            if t in TIMES_S:
                out[t] = math.sqrt(both[model.n + azimuth, model.n + azimuth] / best[azimuth, azimuth])
    return out


def _wandering(model: ErrorDynamics) -> list[int]:
    """Return the indices, in the full layout, of the biases that wander."""
    return [
        i
        for states, kind in model.biases
        if math.isfinite(kind.time_constant_s)
        for i in range(states.start, states.stop)
    ]


def _kept(model: ErrorDynamics, full: int) -> int:
    """Return the index among the states that the model keeps."""
    return int(np.flatnonzero(np.asarray(model.kept) == full)[0])


def _exact(values: Sequence[float]) -> list[Estimate]:
    """Return estimates of what is worked out without a draw."""
    return [Estimate(value, value, value, 0) for value in values]


def _constant(_: int) -> list[Estimate]:
    found = for_constant(BASES[MARKOV])
    return _exact([found[t] for t in TIMES_S])


def _fixes(_: int) -> list[Estimate]:
    found = [bounds.find(task) for task in (BASES[WHITE], FAST)]
    return _exact([float(np.interp(END_S, one.t, one.sigma[:, AZIMUTH])) / ARCSEC for one in found if one is not None])


TABLES = (
    Table(
        "000.excess",
        "between the bound and the filters",
        "after 000 ch. 3",
        "What the azimuth of filters that are told the truth has above the bound, and what the bound depends on. Nothing of it is "
        "printed.",
        (
            Group(
                "azimuth at 600 s over the bound, Gauss-Markov noise, matched prior",
                "ratio, adjusted by the oracle",
                tuple(
                    Line(label, BASES[MARKOV], solver, over_bound, lucky=True)
                    for label, solver in (("UKF", "ukf"), ("CKF", "ckf"), ("invariant EKF", "inekf"))
                ),
                RUNS,
                0,
            ),
            Group(
                "a linear filter that takes wandering biases for constant, azimuth over the bound",
                "ratio",
                runs=1,
                quick=1,
                claims=tuple(Claim(f"at {t:g} s") for t in TIMES_S),
                compute=_constant,
            ),
            Group(
                f"bound of the azimuth at {END_S:g} s in white noise",
                "arcsec",
                runs=1,
                quick=0,
                claims=(Claim("fixes at 10 Hz, as everywhere here"), Claim("a fix at each step of 100 Hz")),
                compute=_fixes,
            ),
            Group(
                f"azimuth at {END_S:g} s with the vibration of (2.5.5) over that without, white noise, matched prior",
                "ratio",
                (
                    Line(
                        "CKF, with vibration / without",
                        SHAKEN,
                        "ckf",
                        quotient(AZIMUTH, cap(WHITE, MATCHED, AZIMUTH), END_S),
                        against=Source(BASES[WHITE], "ckf"),
                    ),
                ),
                RUNS,
                0,
            ),
        ),
        name="the excess",
    ),
)
