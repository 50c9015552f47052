"""Tables and sentences of a forecast for the terminal."""

from __future__ import annotations

import math

from rich.console import RenderableType
from rich.table import Table
from rich.text import Text

from sins_env.evaluation.planning.curves import Curves, Reached
from sins_env.evaluation.planning.quantities import QUANTITIES
from sins_env.evaluation.show.numbers import number_text, seconds_text
from sins_env.evaluation.show.rich_tables import titled

_DAY = "after a day"
NEXT_TO_0 = 1e-3  #: share of the bound below which what is left of it is not written as a number


def told(one: Curves, t: float | None = None) -> list[RenderableType]:
    """Return everything: the bound over time, each wanted accuracy, and the family or the budget at ``t`` s."""
    sentences = [Text(sentence(one, found)) for found in one.reached]
    rest = family(one) if one.family else budget(one, t) if one.sources else []
    return [*over_time(one), *sentences, *rest]


def over_time(one: Curves) -> list[RenderableType]:
    """Return the table of the bound over time, with its title and notes."""
    table = _table("time\ns")
    for q in one.quantities.values():
        table.add_column(f"{q.name}\n{q.unit_name}", justify="right")
    for row in one.rows():
        cells = [number_text(row[name]) for name in one.quantities]
        table.add_row(f"{row['t']:g}", *cells)
    return _headed(f"{one.task.name}: 1 sigma of the best that is possible", table, " ".join(_notes(one)))


def _notes(one: Curves) -> list[str]:
    notes = ["Level is that of a component, velocity and position are horizontal."]
    if not one.holds:
        notes.append("The start is not drawn from a Gaussian, or an aid errs otherwise: a reference only.")
    if one.known:
        notes.append(f"Counted as known, so that errors are larger: {', '.join(one.known)}.")
    return notes


def budget(one: Curves, t: float | None = None) -> list[RenderableType]:
    """Return two tables of the sources of error at ``t`` s, by default at the end: their shares, and the bound without each."""
    rows, at = one.budget(t), float(one.budget_t[one.index(one.budget_t, one.t[-1] if t is None else t)])
    shares, without = _table("source"), _table("source that is away")
    for q in one.quantities.values():
        shares.add_column(q.name, justify="right")
        without.add_column(f"{q.name}\n{q.unit_name}", justify="right")
    whole = {name: one.at(name, at) / q.unit for name, q in one.quantities.items()}
    for row in rows:
        shares.add_row(row["source"], *(f"{100 * row['share'][name]:.1f}" for name in whole))
        left = ((row["without"][name], bound) for name, bound in whole.items())
        without.add_row(row["source"], *("next to 0" if a < NEXT_TO_0 * b else number_text(a) for a, b in left))
    shares.add_section()
    shares.add_row("all of them", *(f"{100 * sum(row['share'][name] for row in rows):.1f}" for name in whole))
    without.add_section()
    without.add_row("none", *map(number_text, whole.values()))
    return [
        *_headed(f"what limits it at {at:g} s: share in the variance, %", shares),
        *_headed(f"the bound at {at:g} s if one source alone were not there", without),
    ]


def family(one: Curves) -> list[RenderableType]:
    """Return a table with a row for each member of the family, at the end."""
    table = _table("setting")
    for q in one.quantities.values():
        table.add_column(f"{q.name}\n{q.unit_name}", justify="right")
    for asked in one.reached:
        table.add_column(f"{asked.wanted.text}\nfrom, s", justify="right")
    members: dict[str, Curves] = {"as it is": one, **one.family}
    for name, member in members.items():
        cells = [
            number_text(member.final(key) / q.unit) if key in member.sigma else "-" for key, q in one.quantities.items()
        ]
        table.add_row(name, *cells, *(seconds_text(found.holds_s) for found in member.reached))
    known = dict.fromkeys(name for member in one.family.values() for name in member.known)
    note = f"Counted as known in some, whose errors are larger: {', '.join(known)}." if known else ""
    return _headed(f"{one.task.name} with other settings, at the end", table, note)


def sentence(one: Curves, found: Reached) -> str:
    """Return when a wanted accuracy is reached, or how far the task is from it, in one or two sentences."""
    q, end = QUANTITIES[found.wanted.quantity], one.t[-1]
    wanted = f"{found.wanted.text} of {q.what}:"
    if math.isfinite(found.holds_s):
        return f"{wanted} from {seconds_text(found.holds_s)} s on{_earlier(found)}."
    last = f"{number_text(one.final(q.name) / q.unit)} {q.unit_name} at the end, {end:g} s"
    if math.isfinite(found.first_s):
        return f"{wanted} reached at {seconds_text(found.first_s)} s, but it does not hold: {last}."
    limit = f"{number_text(found.limit / q.unit)} {q.unit_name}"
    goes_on = f"If the last {one.repeated_s:g} s went on again and again,"
    if math.isfinite(found.later_s):
        after = f"it would be reached after about {duration_text(found.later_s)}"
    else:
        after = "it would not be reached within a day"
    if math.isinf(found.limit):
        tends = "the bound grows without end"
    else:
        tends = f"the bound tends to {limit}" if found.settled else f"the bound is {limit} {_DAY} and still changes"
    return f"{wanted} never within the {end:g} s; {last}. {goes_on} {after}; {tends}."


def _earlier(found: Reached) -> str:
    if found.first_s == found.holds_s:
        return ""
    return f" (reached at {seconds_text(found.first_s)} s for the first time)"


def duration_text(seconds: float) -> str:
    """Return a duration in seconds, minutes or hours, whichever gives a number of two or three digits."""
    for unit, name in ((3600.0, "h"), (60.0, "min")):
        if seconds >= 2 * unit:
            return f"{number_text(seconds / unit, 2)} {name}"
    return f"{seconds:.0f} s"


def _table(first: str) -> Table:
    table = titled("")
    table.title = None
    table.add_column(first, no_wrap=True)
    return table


def _headed(title: str, table: Table, notes: str = "") -> list[RenderableType]:
    """Return a table below its title and above its notes, which may be wider than it is."""
    return [Text(f"\n{title}", style="bold"), table, *([Text(notes)] if notes else [])]
