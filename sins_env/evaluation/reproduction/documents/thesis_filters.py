"""Fine alignment on the swaying base, 000 chapters 3 to 5: figures 3.3 to 3.5, tables 3.1 to 3.4, 4.1 to 4.4 and 5.1 to 5.4.

Every table is run under two priors. The matched prior states the true noise. That of section 2.5.4 is taken in reading C,
the only one under which the printed comparison can be seen (docs/mathematics/simulation.md#told-priors). Tables share the
runs of a filter. Their spans differ, and a shorter one is read off a longer run, because errors depend on the past only.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from sins_env.evaluation.reproduction.pictures.courses import Course, courses
from sins_env.evaluation.reproduction.readings.common import (
    FAILED,
    TIME_OF_A_STEP,
    Reader,
    apart,
    cost_against,
    error,
    quotient,
)
from sins_env.evaluation.reproduction.readings.sway import settling, wander
from sins_env.evaluation.reproduction.tables import Group, Line, Picture, Source, Table
from sins_env.evaluation.reproduction.verdicts import LARGER, SMALLER, Print, Printed, Said
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import EvaluationTask
from sins_env.units import ARCSEC

RUNS, QUICK = 200, 20
PARTICLE_RUNS, QUICK_PARTICLES = 40, 2  #: the same for particle filters, which cost a hundred times as much
#: Filters that a first look leaves out. The first is like gpf, the second the same as ckf, and the third is not printed.
SLOW = {"rqmc_gpf", "cgpf", "aukf_fading"}
AXES = ("east", "north", "azimuth")
LEVELS, AZIMUTH = (0, 1), 2
WHITE, MARKOV = "white noise", "Gauss-Markov noise"
MATCHED, THESIS = "matched prior", "prior of the thesis"
BASES = {WHITE: get_task("sway-white-v0"), MARKOV: get_task("sway-markov-v0")}
START_DEG = [1.0, 1.0, 10.0]  #: misalignment of the single runs in the order E, N, U
#: Limits of a converged error, arcsec. The text calls printed ends of up to 98 and 344 converged, and not those from 1368
#: in azimuth.
WITHIN = {LEVELS: 100.0, AZIMUTH: 1000.0}
#: Thresholds of alignment with which a failed run counts. Told the prior of the thesis, even good runs are beyond one.
CAPS = {MATCHED: 1.0, THESIS: FAILED}
SHORTER_S = 360.0  #: printed length of the runs of the costliest filter
MANY = 10_000  #: particles in a single run


def variant(task: EvaluationTask, suffix: str, what: str, **kwargs: Any) -> EvaluationTask:
    """Return a task with the same worlds, run by run, but for these settings."""
    name = f"{task.name.removesuffix('-v0')}-{suffix}-v0"
    return replace(task, name=name, what=what, kwargs={**task.kwargs, **kwargs}, seeds_of=task.seeds_of or task.name)


def task_of(noise: str, prior: str, solver: str = "") -> EvaluationTask:
    """Return the task on which a solver runs."""
    task = BASES[noise]
    if noise == MARKOV and solver == "rqmc_gpf":
        what = task.what.replace("600 s", f"{SHORTER_S:g} s")
        task = variant(task, f"{SHORTER_S:g}", what, duration=SHORTER_S)
    if prior == THESIS:
        what = task.what.replace(MATCHED, "prior of 000 section 2.5.4")
        task = variant(task, "thesis-prior", what, prior="thesis")
    return task


def _single(task: EvaluationTask) -> EvaluationTask:
    """Return the task with the thesis' start."""
    what = task.what.replace("wrong by 1/1/15 deg (1 sigma)", "wrong by 1, 1 and 10 deg")
    return variant(task, "single", what, misalignment_deg=START_DEG)


@dataclass(frozen=True)
class Column:
    """The column of a filter in a printed table."""

    label: str
    solver: str
    printed: tuple[float, float, float] | None = None  #: errors E, N and azimuth at the end, arcsec
    settled_s: float | None = None  #: time at which the text has its azimuth converged; inf for not until the end
    mean_s: float = 0.0  #: span up to the end over which the printed azimuth is a mean; 0 for the value at the end
    std: float | None = None  #: standard deviation printed beside this mean
    settings: Mapping[str, Any] = field(default_factory=dict)
    single: Mapping[str, Any] = field(default_factory=dict)  #: other settings of the single run

    @property
    def at_end(self) -> tuple[float, float, float]:
        """Printed errors of a filter that has them."""
        assert self.printed
        return self.printed

    def source(self, noise: str, prior: str) -> Source:
        """Return the runs of the filter."""
        return Source(task_of(noise, prior, self.solver), self.solver, self.settings)

    def single_source(self, noise: str, prior: str) -> Source:
        """Return the single run from the thesis' start."""
        return Source(_single(task_of(noise, prior, self.solver)), self.solver, {**self.settings, **self.single})


class Saying(NamedTuple):
    """A statement of the text on the quotient of the RMS of two filters, by label, at the end."""

    one: str
    other: str
    of: int | tuple[int, ...]
    said: Said


ALIKE = Said("alike, 0.8 to 1.25", 0.8, 1.25)


@dataclass(frozen=True)
class Printing:
    """A printed table: its columns, of which the first is the standard of the others, and the statements of the text."""

    number: str
    noise: str
    end_s: float
    columns: tuple[Column, ...]
    sayings: tuple[Saying, ...]
    why: tuple[str, str]  #: explanations under the matched prior and under that of the thesis
    level_s: float = 20.0  #: time by which the text has all levels converged; 0 if it says nothing
    apart: float = 0.0  #: stated distance of the others from the first in each axis, arcsec; 0 for the printed one
    others: tuple[Column, ...] = ()  #: filters that are not printed
    costs: tuple[tuple[str, str], ...] = ()  #: pairs of labels; the first is said to take longer than the second
    note: str = ""

    @property
    def title(self) -> str:
        """Names of the filters, noise and length."""
        names = [column.label for column in self.columns]
        return f"{', '.join(names[:-1])} and {names[-1]}, {self.noise}, {self.end_s:g} s"

    @property
    def particles(self) -> bool:
        """Whether particle filters are among the columns."""
        return any(column.single for column in self.columns)

    @property
    def runs(self) -> int:
        """Number of runs."""
        return PARTICLE_RUNS if self.particles else RUNS

    @property
    def quick(self) -> int:
        """Number of runs in a first look."""
        if self.noise == MARKOV:  # the longer runs, of filters that are in white noise too
            return 0
        return QUICK_PARTICLES if self.particles else QUICK

    def column(self, label: str) -> Column:
        """Return a column by its label."""
        return next(column for column in self.columns if column.label == label)


def cap(noise: str, prior: str, of: int | tuple[int, ...]) -> float:
    """Return the size of an error E, N, U, or of several together, with which a failed run counts, rad."""
    return CAPS[prior] * math.hypot(*BASES[noise].delta[np.atleast_1d(of)])


def _line(at: Source, label: str, read: Reader, printed: Print | None = None, against: Source | None = None) -> Line:
    quick = not SLOW & {at.solver, against.solver if against else ""}
    return Line(label, at.task, at.solver, read, at.settings, printed, against, quick=quick)


def _errors(p: Printing, column: Column, prior: str) -> Iterable[Line]:
    """Yield a line for each component at the end; the azimuth is a mean over a span up to it if the printed one is."""
    at = column.source(p.noise, prior)
    for i, axis in enumerate(AXES):
        over_s = column.mean_s if i == AZIMUTH else 0.0
        mean = f", mean of {over_s:g} s" if over_s else ""
        figure = Printed(column.printed[i], 1, kind=axis) if column.printed else None
        yield _line(
            at, f"{column.label}, {axis}{mean}", error(i, ARCSEC, cap(p.noise, prior, i), p.end_s, over_s), figure
        )
    if column.std is not None:
        label = f"{column.label}, azimuth, standard deviation over {column.mean_s:g} s"
        read = wander(AZIMUTH, ARCSEC, cap(p.noise, prior, AZIMUTH), p.end_s, column.mean_s)
        # the variance of a random walk about its own mean scatters as if it had two to three degrees of freedom
        yield _line(at, label, read, Printed(column.std, 3, about_mean=True, kind="std"))


def _differences(p: Printing, prior: str) -> Iterable[Line]:
    """Yield the distances of the others from the first in the same run, in azimuth or in all axes."""
    first = p.columns[0]
    for column in p.columns[1:]:
        for i in (0, 1, AZIMUTH) if p.apart else (AZIMUTH,):
            size = p.apart or abs(column.at_end[i] - first.at_end[i])
            label = f"{column.label} from {first.label}, {AXES[i]}, same run"
            read = apart(i, ARCSEC, cap(p.noise, prior, i), p.end_s)
            printed = Printed(size, 1, kind=f"{AXES[i]} apart")
            yield _line(column.source(p.noise, prior), label, read, printed, first.source(p.noise, prior))


def _quotients(p: Printing, prior: str) -> Iterable[Line]:
    """Yield the statements on quotients, and first that the azimuth of each new filter is better than the UKF's."""
    better = [Saying(column.label, p.columns[0].label, AZIMUTH, SMALLER) for column in p.columns[1:] if column.printed]
    for one, other, of, said in (*better, *p.sayings):
        what = "levels" if of == LEVELS else AXES[of]  # type: ignore[index]
        label = f"{one} / {other}, {what}, quotient"
        sources = [p.column(each).source(p.noise, prior) for each in (one, other)]
        yield _line(sources[0], label, quotient(of, cap(p.noise, prior, of), p.end_s), said, sources[1])


def _times(p: Printing, prior: str) -> Iterable[Line]:
    """Yield the times from which on errors stay small, s."""
    for column in p.columns if p.level_s else ():
        at, read = column.source(p.noise, prior), settling(LEVELS, WITHIN[LEVELS] * ARCSEC, p.end_s)
        yield _line(at, f"{column.label}, levels converged, s", read, Said(f"within {p.level_s:g}", high=p.level_s))
    for column in p.columns:
        by = column.settled_s
        if by is None:
            continue
        at, read = column.source(p.noise, prior), settling(AZIMUTH, WITHIN[AZIMUTH] * ARCSEC, p.end_s)
        said = Said(f"not in {p.end_s:g}", low=p.end_s) if by == math.inf else Said(f"by {by:g}", high=by)
        yield _line(at, f"{column.label}, azimuth converged, s", read, said)


def _group(p: Printing, prior: str, why: str) -> Group:
    errors = chain.from_iterable(_errors(p, column, prior) for column in (*p.columns, *p.others))
    lines = (*errors, *_differences(p, prior), *_quotients(p, prior), *_times(p, prior))
    return Group(prior, "arcsec unless said", lines, p.runs, p.quick, why)


def _cost(p: Printing) -> Iterable[Group]:
    """Yield a group with the quotients of the time of a step, if the text speaks of it."""
    lines = []
    for one, other in p.costs:
        a, b = (p.column(label).source(p.noise, MATCHED) for label in (one, other))
        said = Said("longer", low=1.0)
        lines.append(Line(f"{one} / {other}", a.task, a.solver, cost_against, a.settings, said, b, timed=True))
    if lines:
        yield Group(TIME_OF_A_STEP, "quotient", tuple(lines), p.runs, 0, COST_WHY)


def table(p: Printing) -> Table:
    """Return the table with the runs that stand beside it."""
    groups = tuple(_group(p, prior, why) for prior, why in zip((MATCHED, THESIS), p.why, strict=True))
    figures = not p.columns[0].printed
    what = f"Misalignment on the thesis' swaying base after {p.end_s:g} s of fine alignment, {p.noise}. Printed is one "
    what += "run; ours are RMS over runs at that time."
    if p.level_s:
        what += (
            f" Converged: from then on within {WITHIN[LEVELS]:g} arcsec (both levels) or {WITHIN[AZIMUTH]:,.0f} arcsec (azimuth) "
            f"until {p.end_s:g} s, the median over runs."
        )
    name = "figures 3.3 to 3.5" if figures else ""
    return Table(
        p.number,
        p.title,
        "000",
        f"{what} {p.note}".strip(),
        (*groups, *_cost(p)),
        name,
        pictures=(_picture(p, "figure-3-3" if figures else f"table-{p.number.replace('.', '-')}"),),
    )


def _picture(p: Printing, name: str) -> Picture:
    rows = [(prior, [_course(column, p.noise, prior) for column in p.columns]) for prior in (MATCHED, THESIS)]
    many = f"; particle filters with {MANY:,} particles" if p.particles else ""
    caption = (
        f"{p.title}. Lines: single runs from the thesis' start (1, 1, 10 deg{many}). Shaded: where 95 % of our runs lie, with "
        "starts of 1/1/15 deg (1 sigma)."
    )
    caption += " Dots: printed." if p.columns[0].printed else ""
    return courses(name, caption, rows, p.end_s, runs=p.runs, quick=0)  # a single run costs as much as many together


def _course(column: Column, noise: str, prior: str) -> Course:
    printed = column.printed or (None, None, None)
    return Course(column.label, column.source(noise, prior), column.single_source(noise, prior), printed)


def _particles(label: str, solver: str, printed: tuple[float, float, float], settled_s: float) -> Column:
    many = {"particles": 8192 if solver == "rqmc_gpf" else MANY}  # Sobol points fill space by powers of two
    return Column(label, solver, printed, settled_s, single=many)


def _ukf(east: float, north: float, azimuth: float, settled_s: float | None = math.inf) -> Column:
    return Column("UKF", "ukf", (east, north, azimuth), settled_s)


UKF_WHITE, UKF_MARKOV = _ukf(-5.634, 4.931, 1368.211), _ukf(-15.182, -24.694, 1400.056)  # 360 s, 600 s
UKF_WHITE_300, UKF_MARKOV_300 = _ukf(-11.579, 5.775, 1453.6), _ukf(-19.218, 7.203, 1629.979)
UKF_MARKOV_360 = _ukf(-21.802, -12.906, 1569.170)
FADING = Column("AUKF, fading memory", "aukf_fading")
SPS, MIXED = "H-infinity UKF-SPS", "UKF/H-infinity UKF"
LAST_S = 100.0  #: span up to the end whose mean is the azimuth of chapter 4, s

SAME_RUN = (
    "All filters get the same fixes and the same gyros, and are told what these are. The printed azimuths of the new filters lie "
    "far below the bound, which the gyros' random walk and bias set for any filter: a single run may come so close to zero by "
    "luck, a method cannot. The UKF's printed azimuth is nothing unusual of the same law. Filters near the bound have nearly the "
    "same error in a run, so they cannot be as far apart as printed."
)
LEARNS = (
    "Told far too much velocity noise, the UKF takes for noise what the azimuth does to the velocity, and has not converged: that "
    "is the printed story. Whatever a filter does about it, the bound stays where it was, and the printed azimuths of the "
    "new filters lie far below it."
)
HINF = (
    " The smoother of the name (SPS) goes backwards in time and leaves the estimate at the end as it was, so that ours is the "
    "H-infinity UKF; the smoother is tried under section 4.3.3."
)
MIXED_WHY = (
    " The mixing weight is derived from errors that are uncorrelated; those of two filters of the same fixes are not, and the "
    "optimum under the model is the UKF itself."
)
PARTICLES_WHY = (
    " The fixes are linear in the state and their noise is Gaussian: the Kalman update is exact there, and particles can only add "
    "Monte Carlo noise to it. Ours are matched to the moments that they stand for, without which their covariance collapses."
)
PARTICLES_TOLD = (
    "Told far too much velocity noise the UKF has not converged, as printed. But a particle filter believes the same prior: it "
    "has the UKF's posterior up to Monte Carlo noise, and nothing in it learns the noise. What is printed of it is neither in "
    "the method nor above the bound."
)
SPKF_WHY = (
    "The three differ in what they make of the large start, in the first seconds, which the fixes then wipe out: what is left at "
    "the end is a small part of the error itself, and a single run cannot say which filter is better."
)
SPKF_TOLD = (
    "A filter that has not converged still has in it what its points made of the large start: the three are further apart than "
    "under the matched prior, and a single run cannot say which is better."
)
COST_WHY = "Ours is vectorised NumPy, where a filter of few points is paid in calls rather than in points."


def _adaptive(p: str, noise: str, end_s: float, ukf: Column, new: Column, *sayings: Saying, **more: Any) -> Printing:
    return Printing(p, noise, end_s, (ukf, new), sayings, (SAME_RUN, LEARNS), **more)


def _levels(one: str, said: Said, other: str = "UKF") -> Saying:
    return Saying(one, other, LEVELS, said)


#: Scaled points with the beta of 000 section 3.3.2, which states no alpha. The default points are the cubature filter's.
SCALED = {"alpha": 1e-3, "beta": 2.0}
SPKF = Printing(
    "3.figures",
    WHITE,
    360.0,
    (Column("DDF2", "ddf2"), Column("UKF", "ukf", settings=SCALED), Column("CKF", "ckf")),
    (
        _levels("UKF", SMALLER, "DDF2"),
        _levels("CKF", SMALLER, "DDF2"),
        Saying("DDF2", "UKF", AZIMUTH, SMALLER),
        Saying("DDF2", "CKF", AZIMUTH, SMALLER),
        Saying("UKF", "DDF2", AZIMUTH, ALIKE),
        Saying("CKF", "DDF2", AZIMUTH, ALIKE),
    ),
    (SPKF_WHY, SPKF_TOLD),
    level_s=0.0,
    apart=10.0,
    costs=(("DDF2", "UKF"), ("UKF", "CKF")),
    note="Printed are curves; the text says that UKF and CKF are about 10 arcsec better in the levels and DDF2 in azimuth, and "
    "that all three are alike.",
)

PRINTINGS = (
    _adaptive(
        "3.1",
        WHITE,
        360.0,
        UKF_WHITE,
        Column("AUKF", "aukf", (9.803, 10.441, -27.373), 320.0),
        _levels("AUKF", ALIKE),
        others=(FADING,),
    ),
    _adaptive(
        "3.2",
        MARKOV,
        600.0,
        UKF_MARKOV,
        Column("AUKF", "aukf", (-20.962, 5.106, 72.205), 450.0),
        _levels("AUKF", ALIKE),
        others=(FADING,),
    ),
    _adaptive(
        "3.3",
        WHITE,
        360.0,
        UKF_WHITE,
        Column("ASMUGSF", "asmugsf", (-12.991, 20.432, 52.441), 60.0),
        _levels("ASMUGSF", LARGER),
    ),
    _adaptive(
        "3.4",
        MARKOV,
        360.0,
        UKF_MARKOV_360,
        Column("ASMUGSF", "asmugsf", (-34.764, 16.684, -44.501), 230.0),
        _levels("ASMUGSF", LARGER),
    ),
    Printing(
        "4.1",
        WHITE,
        300.0,
        (UKF_WHITE_300, Column(SPS, "hinf_ukf", (-73.132, -57.027, 16.479), 270.0, LAST_S, 22.907)),
        (_levels(SPS, LARGER),),
        (SAME_RUN + HINF, LEARNS + HINF),
        note="The text calls the azimuth the mean of the steady state and does not say over how long; the 100 s are those that "
        "the text of table 4.3 names for the same figure.",
    ),
    Printing(
        "4.2",
        MARKOV,
        300.0,
        (UKF_MARKOV_300, Column(SPS, "hinf_ukf", (-3.934, -97.412, -69.767), 150.0, LAST_S, 29.642)),
        (Saying(SPS, "UKF", 0, ALIKE), Saying(SPS, "UKF", 1, LARGER)),
        (SAME_RUN + HINF, LEARNS + HINF),
        note="A deviation stands beside the azimuth, so that it is taken for a mean of 100 s as in table 4.1; the text does not "
        "say so.",
    ),
    Printing(
        "4.3",
        WHITE,
        300.0,
        (
            UKF_WHITE_300,
            Column("H-infinity UKF", "hinf_ukf", (-73.132, -57.027, 16.479), 200.0, LAST_S),
            Column(MIXED, "mixed_hinf_ukf", (-25.648, -37.370, -32.915), 200.0, LAST_S),
        ),
        (_levels("H-infinity UKF", LARGER), _levels(MIXED, LARGER), _levels(MIXED, SMALLER, "H-infinity UKF")),
        (SAME_RUN + MIXED_WHY, LEARNS + MIXED_WHY),
        level_s=50.0,
        note="The H-infinity UKF's run is that of table 4.1, whose text has it converge later.",
    ),
    Printing(
        "4.4",
        MARKOV,
        300.0,
        (
            _ukf(-19.218, 7.203, 1629.979, None),
            Column("H-infinity UKF", "hinf_ukf", (-3.934, -97.412, -69.767), None, LAST_S),
            Column(MIXED, "mixed_hinf_ukf", (-21.841, -58.729, 63.032), None, LAST_S),
        ),
        (
            Saying(MIXED, "H-infinity UKF", AZIMUTH, SMALLER),
            _levels("H-infinity UKF", LARGER),
            _levels(MIXED, LARGER),
            _levels(MIXED, SMALLER, "H-infinity UKF"),
        ),
        (SAME_RUN + MIXED_WHY, LEARNS + MIXED_WHY),
        level_s=50.0,
        note="That the azimuths are means of the last 100 s is said of table 4.3 alone, and taken to hold here.",
    ),
    Printing(
        "5.1",
        WHITE,
        360.0,
        (
            UKF_WHITE,
            _particles("GPF", "gpf", (9.541, 8.351, 183.62), 260.0),
            _particles("RQMC-GPF", "rqmc_gpf", (11.736, 7.421, 39.616), 100.0),
        ),
        (Saying("RQMC-GPF", "GPF", AZIMUTH, SMALLER), _levels("GPF", ALIKE), _levels("RQMC-GPF", ALIKE)),
        (SAME_RUN + PARTICLES_WHY, PARTICLES_TOLD),
    ),
    Printing(
        "5.2",
        MARKOV,
        360.0,
        (
            UKF_MARKOV_360,
            _particles("GPF", "gpf", (2.532, -6.620, 161.29), 330.0),
            _particles("RQMC-GPF", "rqmc_gpf", (2.3195, -9.632, 96.337), 300.0),
        ),
        (Saying("RQMC-GPF", "GPF", AZIMUTH, SMALLER), _levels("GPF", SMALLER), _levels("RQMC-GPF", SMALLER)),
        (SAME_RUN + PARTICLES_WHY, PARTICLES_TOLD),
        costs=(("RQMC-GPF", "GPF"), ("RQMC-GPF", "UKF")),
    ),
    Printing(
        "5.3",
        WHITE,
        360.0,
        (
            UKF_WHITE,
            _particles("GPF", "gpf", (9.541, 8.351, 183.62), 260.0),
            _particles("CGPF", "cgpf", (1.370, 16.452, 20.992), 320.0),
        ),
        (Saying("CGPF", "GPF", AZIMUTH, SMALLER), _levels("GPF", ALIKE), _levels("CGPF", ALIKE)),
        (SAME_RUN + PARTICLES_WHY, PARTICLES_TOLD),
        note="The text below the table says RQMC-GPF where it means CGPF.",
    ),
    Printing(
        "5.4",
        MARKOV,
        600.0,
        (
            UKF_MARKOV,
            _particles("GPF", "gpf", (3.489, -7.241, 343.601), 500.0),
            _particles("CGPF", "cgpf", (-13.839, 4.915, -37.195), 450.0),
        ),
        (Saying("CGPF", "GPF", AZIMUTH, SMALLER), _levels("GPF", SMALLER), _levels("CGPF", SMALLER)),
        (SAME_RUN + PARTICLES_WHY, PARTICLES_TOLD),
        costs=(("GPF", "CGPF"), ("CGPF", "UKF")),
    ),
)

TABLES = tuple(table(p) for p in (SPKF, *PRINTINGS))
