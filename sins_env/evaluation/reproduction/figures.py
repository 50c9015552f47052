"""Every figure of the documents: what it shows, which of our pictures stands in its place, and why if there is none."""

from __future__ import annotations

from typing import NamedTuple

NO_NUMBERS = "curves without numbers"
ENDS = "curves; the errors at the end are in its table"
NONE = "no result: a diagram"


class Figures(NamedTuple):
    """Figures of a document that show one thing, from ``first`` to ``last``."""

    document: str
    first: str
    last: str
    what: str
    printed: str  #: numbers that the print gives
    pictures: tuple[str, ...] = ()  #: names of our pictures
    why: str = ""  #: reason why there is no picture, or how ours differs

    @property
    def name(self) -> str:
        """The numbers in words."""
        return self.first if self.first == self.last else f"{self.first} to {self.last}"

    @property
    def numbers(self) -> list[str]:
        """The number of each figure."""
        chapter, dot, low = self.first.rpartition(".")
        return [f"{chapter}{dot}{i}" for i in range(int(low), int(self.last.rpartition(".")[2]) + 1)]


def _diagram(document: str, first: str, last: str, what: str, printed: str = NONE) -> Figures:
    return Figures(document, first, last, what, printed)


def _table(first: str, last: str, number: str, *more: str) -> Figures:
    """Return the three figures of a table of chapters 3 to 5 of 000."""
    pictures = (f"table-{number.replace('.', '-')}", *more)
    return Figures("000", first, last, f"misalignment of table {number}", ENDS, pictures)


CAR = "the recordings are not public: simulated records in their place"
FIGURES = (
    _diagram("000", "2.1", "2.2", "strapdown INS, its frames"),
    Figures("000", "2.3", "2.5", "coarse misalignment of 50 runs", "mean and deviation in the text", ("figure-2-3",)),
    _diagram("000", "2.6", "2.6", "scheme of fine alignment"),
    _diagram("000", "3.1", "3.1", "unscented transform"),
    Figures("000", "3.2", "3.2", "points of UKF and CKF", "points without numbers", ("figure-3-2",)),
    Figures("000", "3.3", "3.5", "misalignment, DDF2, UKF and CKF", NO_NUMBERS, ("figure-3-3",)),
    _table("3.6", "3.8", "3.1"),
    _table("3.9", "3.11", "3.2"),
    _table("3.12", "3.14", "3.3"),
    _table("3.15", "3.17", "3.4"),
    _diagram("000", "4.1", "4.2", "H-infinity as a control problem"),
    _table("4.3", "4.5", "4.1", "figure-4-5"),
    _table("4.6", "4.8", "4.2", "figure-4-5"),
    _table("4.9", "4.11", "4.3"),
    _table("4.12", "4.14", "4.4"),
    Figures(
        "000",
        "5.1",
        "5.1",
        "low-discrepancy points in 15 dimensions",
        "points without numbers",
        ("figure-5-1",),
        "without Faure's sequence, which no library of ours has",
    ),
    Figures("000", "5.2", "5.2", "2048 points in the unit square", "points without numbers", ("figure-5-2",)),
    Figures("000", "5.3", "5.3", "2048 Gaussian points", "points without numbers", ("figure-5-3",)),
    _table("5.4", "5.6", "5.1"),
    _table("5.7", "5.9", "5.2"),
    _table("5.10", "5.12", "5.3"),
    _table("5.13", "5.15", "5.4"),
    _diagram("000", "6.1", "6.2", "the unit, the car", "no result: photographs"),
    Figures(
        "000",
        "6.3",
        "6.4",
        "velocities, record 6 of position 3",
        NO_NUMBERS,
        why="the recordings are not public, and in alignment estimators answer the attitude alone: no velocity is on record",
    ),
    Figures("000", "6.5", "6.7", "attitude, record 6 of position 3", NO_NUMBERS, ("figure-6-5",), CAR),
    Figures("000", "6.8", "6.9", "velocities, record 7 of position 3", NO_NUMBERS, why="as figures 6.3 and 6.4"),
    Figures("000", "6.10", "6.12", "attitude, record 7 of position 3", NO_NUMBERS, ("figure-6-5",), CAR),
    Figures(
        "000",
        "6.13",
        "6.40",
        "azimuth, the other 28 records",
        "curves; the headings at the end are in tables 6.6 to 6.8",
        ("figure-6-13", "figure-6-recording"),
        f"{CAR}, and a recording of another car",
    ),
    Figures("001", "1", "1", "flight path", "the plan is in the text", ("001-figure-1",)),
    Figures("001", "2", "2", "pitch error", "curves; the average is in table 1", ("001-table-1",)),
    Figures("001", "3", "3", "roll error", "curves; the average is in table 1", ("001-figure-3",)),
    Figures("001", "4", "5", "heading and position errors", "curves; the averages are in table 1", ("001-table-1",)),
    Figures("001", "6", "6", "velocity error", "curves; the average is in table 1", ("001-figure-3",)),
    Figures("002", "1", "2", "estimated noise, error of x1", NO_NUMBERS, ("002-example-1",)),
    Figures("002", "3", "3", "error of x2, estimated R", NO_NUMBERS, ("002-example-2",)),
    Figures(
        "002", "4", "4", "position errors in flight", NO_NUMBERS, ("002-figure-4",), "the flight is ours: none is given"
    ),
    _diagram("003", "1", "2", "correntropy, weight functions", "no result: two formulas"),
    Figures("003", "3", "3", "flight path", "the plan is lost in our text", ("003-figure-3",), "the flight is ours"),
    Figures("003", "4", "4", "position error, Gaussian fixes", NO_NUMBERS, ("003-figure-4",)),
    Figures("003", "5", "5", "position error, contaminated fixes", NO_NUMBERS, ("003-figure-5",)),
    Figures("003", "6", "6", "position error against the kernel width", NO_NUMBERS, ("003-figure-6",)),
)
