"""Numbers as text for people: three significant digits, angles in a fitting unit, and intervals."""

from __future__ import annotations

import math

from sins_env.evaluation.score.resampling import Interval


def number_text(value: float, digits: int = 3) -> str:
    """Return three significant digits, without an exponent below ten million; '-' for NaN, and 'never' for inf."""
    if math.isnan(value):
        return "-"
    if math.isinf(value):
        return "never"
    if value == 0:
        return "0"
    if abs(value) >= 1e7:  # whatever has diverged
        return f"{value:.{digits - 1}e}"
    decimals = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    return f"{value:,.{decimals}f}"


def seconds_text(value: float) -> str:
    """Return whole seconds, with tenths below ten."""
    return number_text(value) if not math.isfinite(value) else f"{value:.{0 if value >= 10 else 1}f}"


def seconds_interval_text(ci: Interval) -> str:
    """Return an interval such as '115–147', or '> 115'; empty if it is unknown, unbounded below or a point."""
    if not math.isfinite(ci[0]) or ci[0] == ci[1]:
        return ""
    return f"> {seconds_text(ci[0])}" if math.isinf(ci[1]) else f"{seconds_text(ci[0])}–{seconds_text(ci[1])}"


def percent_interval_text(ci: Interval) -> str:
    """Return an interval of shares such as '0.3–4.3 %'; empty if it is unknown."""
    return "" if math.isnan(ci[0]) else "–".join(f"{100 * end:.{1 if 0 < end < 0.0995 else 0}f}" for end in ci) + " %"


def p_text(p: float) -> str:
    """Return a p value such as 'p 0.0012'."""
    return f"p {p:.2g}" if p >= 1e-4 else "p < 1e-4"


def angle_text(arcsec: float, beside: float | None = None) -> str:
    """Return arcseconds without a unit, or degrees with their sign if the angle is 10,000 arcsec or more.

    An angle ``beside`` another one, such as an end of its interval, has the unit of the other.
    """
    in_degrees = 1e4 <= (arcsec if beside is None else beside) < math.inf
    return f"{number_text(arcsec / 3600)}°" if in_degrees else number_text(arcsec)


def angle_interval_text(ci: Interval, value: float) -> str:
    """Return the interval of an angle, all in arcsec, in the unit of the angle; empty if it is unknown."""
    return "" if math.isnan(ci[0]) else "–".join(angle_text(end, value) for end in ci).replace(",", "")


def interval_text(ci: Interval) -> str:
    """Return an interval of numbers; empty if it is unknown."""
    return "" if math.isnan(ci[0]) else f"{number_text(ci[0])}–{number_text(ci[1])}".replace(",", "")
