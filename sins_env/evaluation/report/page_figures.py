"""Figures of one task in the report, each a small panel that fits a phone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from sins_env.arrays import Array
from sins_env.evaluation.bound.bounds import Bound
from sins_env.evaluation.report.panel import Drawing, Lineup, Panel
from sins_env.evaluation.report.svg import PAGE
from sins_env.evaluation.score.metrics import success_profile
from sins_env.evaluation.score.quantities import QUANTITIES
from sins_env.evaluation.score.resampling import NO_INTERVAL, Interval
from sins_env.evaluation.score.results import Results
from sins_env.evaluation.show.cells import aligned_text, score
from sins_env.evaluation.show.error_figure import error_curve, size_of
from sins_env.evaluation.show.numbers import angle_text, number_text
from sins_env.evaluation.show.style import oracle_style
from sins_env.units import ARCSEC, DEG

CURVE_POINTS = 140  #: most points of a curve over time


def drawings(lineup: Lineup) -> list[Drawing]:
    """Return all figures of a task; a recording without a reference has only its heading spread against the cost."""
    costs = [_cost(lineup)] if any(one.cost for one in lineup.lines) else []
    if not lineup.lines[0].summary.scored:
        return costs
    curves = CURVES if lineup.lines[0].summary.navigation is not None else CURVES[:2]
    over_time = [_over_time(lineup, curve) for curve in curves]
    profiles = [_profile(lineup, azimuth) for azimuth in (True, False)]
    return [*over_time, _failed(lineup), _aligned(lineup), *profiles, *costs]


def _best(lineup: Lineup, say: Any) -> str:
    """Return a text such as 'ckf 731", ekf 783", ...' of the first five."""
    more = f"; and {len(lineup.lines) - 5} more" if len(lineup.lines) > 5 else ""
    return ", ".join(f"{one.label} {say(one)}" for one in lineup.lines[:5]) + more


def _shown(one: Results, axis: str) -> str:
    text = angle_text(one.summary.rms[axis])
    return text if text.endswith("°") else f"{text}″"


def _over_time(lineup: Lineup, curve: Curve) -> Drawing:
    parts, unit, name = list(curve.parts), curve.unit, curve.name
    of_component = len(parts) > 1 and lineup.lines[0].summary.navigation is None  # as the columns of the table
    panel, criteria = Panel(lineup, f"t-{curve.quantity}"), lineup.lines[0].records.criteria
    axes, all_t = panel.axes, np.asarray(criteria.history_t, dtype=float)
    picked = np.unique(np.linspace(0, len(all_t) - 1, CURVE_POINTS).round().astype(int))
    t, least = all_t[picked], np.inf
    for one in lineup.back_to_front:
        told = panel.told(one)
        size = size_of(one.records.history[:, picked][..., parts], of_component)
        value, low, high = error_curve(size, unit, 400 if told else 1)
        style = panel.style(one)
        if told and len(one.records) > 1:
            axes.fill_between(t, low, high, color=style["color"], alpha=0.16, linewidth=0, zorder=2)
        axes.plot(t, value, **style)
        least = min(least, float(np.nanmin(value, initial=np.inf)))
    axial = parts[0] < 3 and (of_component or len(parts) == 1)  # a threshold is of a component
    delta = float(criteria.delta[parts[0]]) / unit if axial else None
    if delta is not None:
        axes.axhline(delta, color=PAGE["ink"], linestyle=(0, (1, 2)), linewidth=1.2)
    if lineup.bound and max(parts) < lineup.bound.sigma.shape[1]:
        sigma = size_of(lineup.bound.sigma[:, parts], of_component) / unit
        axes.plot(lineup.bound.t, sigma, **_bound_style(lineup.bound))
        least = min(least, float(sigma.min()))
    if lineup.oracle:
        size = size_of(lineup.oracle.history[:, picked][..., parts], of_component)
        in_ink: dict[str, Any] = oracle_style() | {"color": PAGE["ink"]}
        axes.plot(t, error_curve(size, unit, 1)[0], **in_ink)
    if criteria.coarse_s:
        axes.axvspan(0, criteria.coarse_s, color=PAGE["grid"], alpha=0.5, linewidth=0)
    axes.set_yscale("log")
    if np.isfinite(least):
        axes.set_ylim(bottom=max(0.8 * least, 1e-4 * (delta or 0.0)))
    what = f"RMS of the {name} error over runs against time. {curve.said(lineup)}."
    caption = "RMS over runs with 95 % bands" + (", of a component" if of_component else "")
    if any(one.records.unfinished.any() for one in lineup.lines):
        caption += "; runs that raised or were lost end there"
    if criteria.coarse_s:
        caption += f"; shaded: {criteria.coarse_s:g} s coarse alignment"
    title = f"{name.capitalize()} error over time"
    label = f"{name} error, {curve.unit_name}"
    svg = panel.svg(title, what, xlabel="time, s", ylabel=label, xlim=(0, criteria.duration_s))
    return Drawing(title, caption, svg)


class Curve(NamedTuple):
    """Curve of an error against time."""

    quantity: str  #: name in QUANTITIES
    name: str
    parts: tuple[int, ...]  #: indices of components in the layout SCORED

    @property
    def unit(self) -> float:
        """Size of the unit in SI."""
        return QUANTITIES[self.quantity].unit

    @property
    def unit_name(self) -> str:
        """Name of the unit."""
        return QUANTITIES[self.quantity].unit_name

    def said(self, lineup: Lineup) -> str:
        """Return the errors of the best solvers in words, for the description of the figure."""
        if lineup.lines[0].summary.navigation is None:
            azimuth = self.quantity == "azimuth"
            say = _main if azimuth else lambda one: f"{_shown(one, 'E')} east, {_shown(one, 'N')} north"
            return f"{'Scores' if azimuth else 'In the steady state'}: {_best(lineup, say)}"
        return f"Mean over time, {self.unit_name}: {_best(lineup, lambda one: number_text(_averaged(one, self.quantity)[0]))}"


CURVES = (
    Curve("azimuth", "azimuth", (2,)),
    Curve("level", "level", (0, 1)),
    Curve("position_h", "horizontal position", (6, 7)),
    Curve("position_v", "vertical position", (8,)),
    Curve("velocity_h", "horizontal velocity", (3, 4)),
    Curve("velocity_v", "vertical velocity", (5,)),
)


def _averaged(one: Results, name: str) -> tuple[float, Array]:
    """Return the ARMSE of a navigation task and its interval, in the unit of the quantity."""
    assert one.summary.navigation is not None
    value, ci = one.summary.navigation.armse[name]
    return value / QUANTITIES[name].unit, np.array(ci) / QUANTITIES[name].unit


def _bound_style(bound: Bound) -> dict[str, Any]:
    """Return the line style of a bound: solid, or dashed if it is only a reference."""
    dash = "-" if bound.holds else (0, (5, 3))
    return {"color": PAGE["ink"], "linewidth": 1.1, "linestyle": dash, "zorder": 3}


def _failed(lineup: Lineup) -> Drawing:
    """Draw the share of failed runs of each solver with its interval, in the order of the table."""
    panel = Panel(lineup, "fa")
    for place, one in reversed(list(enumerate(lineup.lines, start=1))):
        told = one.verdict
        style = panel.style(one, f"{told.failures} of {told.runs}")
        low, high = (100 * end for end in told.failed_ci)
        panel.axes.plot(
            [place, place], [low, high], color=style["color"], linewidth=style["linewidth"], zorder=style["zorder"]
        )
        marker: dict[str, Any] = {"marker": "o", "markersize": 6, "linestyle": "", "markeredgewidth": 0}
        panel.axes.plot(
            [place], [100 * told.failed], color=style["color"], gid=style["gid"], zorder=style["zorder"], **marker
        )
    said = _best(lineup, lambda one: f"{one.verdict.failures} of {one.verdict.runs}")
    title, count = "Failed runs", len(lineup.lines)
    top = min(103.0, 110.0 * max(one.verdict.failed_ci[1] for one in lineup.lines))
    svg = panel.svg(
        title,
        f"Share of failed runs with 95 % intervals, in the order of the table. {said}.",
        xlabel="place in the table",
        ylabel="% of runs",
        ylim=(-0.03 * top, top),
        xlim=(0.4, count + 0.6),
        xticks=[*range(1, count + 1, max(count // 8, 1))],
    )
    return Drawing(title, "with the 95 % interval of Clopper and Pearson", svg)


def _aligned(lineup: Lineup) -> Drawing:
    """Draw the share of runs that have aligned by a time; runs that never align keep the curve below 100 %."""
    panel, criteria = Panel(lineup, "al"), lineup.lines[0].records.criteria
    end = criteria.duration_s - criteria.coarse_s
    for one in lineup.back_to_front:
        times = np.sort(one.records.aligned_s)
        known = times[np.isfinite(times)]
        part = 100 * np.arange(len(known) + 1) / len(times)
        x, y = np.r_[0.0, known, end], np.r_[part, part[-1]]
        if len(x) > CURVE_POINTS:
            kept = np.unique(np.linspace(0, len(x) - 1, CURVE_POINTS).round().astype(int))
            x, y = x[kept], y[kept]
        panel.axes.step(x, y, where="post", **panel.style(one, aligned_text(one)))
    said = _best(lineup, aligned_text)
    what = f"Part of the runs that are aligned, against time. At the end: {said}."
    title = "Runs aligned by a time"
    svg = panel.svg(
        title,
        what,
        xlabel="time from the start of fine alignment, s",
        ylabel="% of runs",
        ylim=(-3, 103),
        xlim=(0, end),
    )
    return Drawing(title, "all three errors within the thresholds from then on", svg)


def _profile(lineup: Lineup, azimuth: bool) -> Drawing:
    name, unit, unit_name = ("azimuth", DEG, "deg") if azimuth else ("level", ARCSEC, "arcsec")
    panel, criteria = Panel(lineup, "pa" if azimuth else "pl"), lineup.lines[0].records.criteria
    delta = float(criteria.delta[2 if azimuth else 0]) / unit
    for one in lineup.back_to_front:
        deltas, success = success_profile(one.records)[slice(0, 2) if azimuth else slice(2, 4)]
        panel.axes.step(deltas / unit, 100 * success, where="post", **panel.style(one))
    panel.axes.axvline(delta, color=PAGE["ink"], linestyle=(0, (1, 2)), linewidth=1.2)
    panel.axes.set_xscale("log")
    index = 2 if azimuth else slice(0, 2)

    def within(one: Results) -> str:
        largest = one.records.hold_max[:, index].reshape(len(one.records), -1).max(axis=1)
        return f"{100 * float((largest <= criteria.delta[index].min()).mean()):.0f} %"

    what = f"Part of the runs within a threshold, against the threshold. At {delta:g} {unit_name}: {_best(lineup, within)}."
    held = f"{name} within the threshold for the last {criteria.hold_s:g} s"
    title = f"Convergence profile, {name}"
    label = f"threshold of the {name}, {unit_name}"
    svg = panel.svg(
        title,
        what,
        xlabel=label,
        ylabel="% of runs",
        ylim=(-3, 103),
        xlim=(0.03 * delta, 10 * delta),
    )
    return Drawing(title, held, svg)


def _cost(lineup: Lineup) -> Drawing:
    """Draw error against cost, with the Pareto front."""
    panel, scored = Panel(lineup, "co"), lineup.lines[0].summary.scored
    relative = all(one.cost.ratio is not None for one in lineup.lines if one.cost)
    points = []
    for one in lineup.back_to_front:
        cost, y, ci = _position(one, relative)
        if not (np.isfinite(cost) and cost > 0 and np.isfinite(y) and y > 0):
            continue
        style, look = panel.style(one), lineup.looks.get(one.label)
        colour, order = style["color"], style["zorder"]
        if np.isfinite(ci).all():
            panel.axes.plot([cost, cost], ci, color=colour, linewidth=1.2 if look else 0.8, zorder=order)
        marker: dict[str, Any] = {
            "marker": look.marker if look else "o",
            "markersize": 8 if look else 4.5,
            "linestyle": "",
        }
        panel.axes.plot([cost], [y], color=colour, gid=style["gid"], zorder=order + 0.1, markeredgewidth=0, **marker)
        points.append((cost, y))
    best = pareto_front(points)
    if len(best) > 1:
        x, y = np.array(best).T
        panel.axes.step(x, y, where="post", color=PAGE["ink"], linewidth=1, linestyle=(0, (2, 2)), zorder=1)
    main = lineup.lines[0].main_score
    if scored and lineup.bound:
        panel.axes.axhline(main.bound, **_bound_style(lineup.bound))
    panel.axes.set(xscale="log", yscale="log")
    panel.axes.margins(x=0.12, y=0.1)
    name, of_error = (main.name, main.unit) if _has_error(lineup.lines[0]) else ("heading spread", "deg")
    unit = "cost of a step / ckf" if relative else "time of a step, µs"
    said = _best(lineup, lambda one: f"{number_text(_position(one, relative)[0], 2)}, {_main(one)}" if scored else "")
    title = "Error against cost" if scored else "Spread against cost"
    told = f"{title}: {name} over the {unit}. {said}."
    caption = f"{name}{' with 95 % interval' if scored else ''}; dotted: the Pareto front"
    return Drawing(title, caption, panel.svg(title, told, xlabel=unit, ylabel=f"{name}, {of_error}"))


def _position(one: Results, relative: bool) -> tuple[float, float, Interval]:
    """Return cost, error and its interval; the heading spread if alignment is not scored. An unknown value is NaN."""
    cost = (one.cost.ratio if relative else one.cost.median_us) if one.cost else None
    _, _, value, interval, _ = one.main_score
    if not _has_error(one):
        value, interval = one.summary.spread_deg, NO_INTERVAL
    return (np.nan if cost is None else cost), value, interval


def _has_error(one: Results) -> bool:
    return one.summary.scored or one.summary.navigation is not None


def _main(one: Results) -> str:
    """Return the score with its unit."""
    return score(one).value.replace('"', "″")


def pareto_front(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the Pareto front of points (cost, error), ordered by cost: no other point is both cheaper and better."""
    out: list[tuple[float, float]] = []
    for x, y in sorted(points):
        if not out or y < out[-1][1]:
            out.append((x, y))
    return out
