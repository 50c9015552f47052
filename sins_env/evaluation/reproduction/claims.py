"""Claims of the documents, each in one line, with the line of a table that says whether it holds.

See docs/mathematics/errata.md#claims.
"""

from __future__ import annotations

from typing import NamedTuple


class Claim(NamedTuple):
    """A claim of a document, and the line of a table that tests it."""

    document: str
    text: str
    table: str  #: number of the table
    group: str  #: words in the title of the group
    line: str  #: label of the line


MATCHED, TOLD = "matched prior", "prior of the thesis"
PRINTED, WHERE = "as printed", "where fixes are contaminated"


def _both(text: str, table: str, line: str) -> tuple[Claim, Claim]:
    """Return a claim on the swaying base under both priors."""
    return tuple(Claim("000", f"{text}: {prior}", table, prior, line) for prior in (MATCHED, TOLD))  # type: ignore[return-value]


CLAIMS = (
    Claim(
        "000",
        "coarse alignment leaves an azimuth of 0.56 deg, standard deviation",
        "2.3",
        "azimuth",
        "azimuth: std, two vectors",
    ),
    *_both("DDF2, UKF and CKF are alike (azimuth, UKF over DDF2)", "3.figures", "UKF / DDF2, azimuth, quotient"),
    Claim("000", "a step of DDF2 takes longer than one of the UKF", "3.figures", "time of a step", "DDF2 / UKF"),
    Claim("000", "a step of the UKF takes longer than one of the CKF", "3.figures", "time of a step", "UKF / CKF"),
    *_both("adaptation beats the UKF in azimuth (AUKF over UKF)", "3.1", "AUKF / UKF, azimuth, quotient"),
    *_both("ASMUGSF beats the UKF in azimuth", "3.3", "ASMUGSF / UKF, azimuth, quotient"),
    *_both("H-infinity beats the UKF in azimuth", "4.1", "H-infinity UKF-SPS / UKF, azimuth, quotient"),
    *_both("H-infinity pays with its levels", "4.1", "H-infinity UKF-SPS / UKF, levels, quotient"),
    *_both("the mixed filter beats the UKF in azimuth", "4.3", "UKF/H-infinity UKF / UKF, azimuth, quotient"),
    *_both("GPF beats the UKF in azimuth", "5.1", "GPF / UKF, azimuth, quotient"),
    *_both("RQMC-GPF beats GPF", "5.1", "RQMC-GPF / GPF, azimuth, quotient"),
    *_both("CGPF beats the UKF in azimuth", "5.3", "CGPF / UKF, azimuth, quotient"),
    Claim("000", "a step of GPF takes longer than one of CGPF", "5.4", "time of a step", "GPF / CGPF"),
    Claim("000", "headings of a parked car repeat to 0.025 deg, UKF", "6.6", "the unit as stated", "UKF"),
    Claim("001", "the CKF has a better heading than the EKF", "001", f"quotients, {PRINTED}", "heading, CKF / EKF"),
    Claim("001", "the CKF has a better position than the EKF", "001", f"quotients, {PRINTED}", "position, CKF / EKF"),
    Claim("001", "UKF (kappa = 0) and CKF are the same", "001", f"quotients, {PRINTED}", "heading, UKF / CKF"),
    Claim(
        "002",
        "example 1 runs to step 300 (no value above 1e6), % of runs",
        "002.1",
        "the system as printed",
        "stays below 1e6 until the last step",
    ),
    Claim("002", "the recursion keeps Q a variance, % of runs", "002.1", "the recursion", "Q negative, as printed"),
    Claim(
        "002", "adaptation beats a UKF told wrong (x2)", "002.2", "RMS error of x2", "x2, as printed / UKF told wrong"
    ),
    Claim("002", "in flight the UKF diverges, m", "002.3", "position", "UKF"),
    Claim("003", "the fifth degree is better in Gaussian noise", "003.gauss", "quotients", "HCKF / CKF"),
    Claim("003", f"correntropy (width 3) beats HCKF {WHERE}", "003.mixture", "as said", "MCC-HCKF, sigma 3 / HCKF"),
    Claim("003", f"Huber's criterion beats HCKF {WHERE}", "003.mixture", "as said", "H-HCKF / HCKF"),
    Claim("003", f"Huber is worse than correntropy {WHERE}", "003.mixture", "as said", "H-HCKF / MCC-HCKF, sigma 3"),
)
