"""Tables of the result: one row per filter for the terminal and ``--md``, one row per package for docs/peers.md."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Mapping, Sequence
from typing import Any

from peers.features import FEATURES, PACKAGES

FILTERS = ("KF", "EKF", "UKF", "CKF")
SAME = 1e-8  #: difference in standard deviations up to which two filters count as the same
CLEARLY = 1.1  #: ratio of speeds from which on a filter counts as faster
QUIET = 0.1  #: number of cores that other processes may keep busy on a quiet machine
OWN = 1.0  #: load of the measurement itself
OURS, HAND = "sins_env", "by hand"

Result = Mapping[str, Any]  #: the measured result, or a row of it


def headings(result: Result) -> list[str]:
    """Return the headings of the table of all filters."""
    sizes = [f"{int(runs):,} runs" for runs in result["rows"][0]["steps_per_s"]]
    return ["package", "filter", "1 run", *sizes, "mean off", "cov. off", "compiles"]


def cells(row: Result) -> list[str]:
    """Return the cells of a row of the table of all filters."""
    loop = " *" if row["looped"] else "  "
    return [
        package(row),
        row["filter"],
        digits(row["us_per_step"]),
        *(f"{digits(value / 1e3)}{loop}" for value in row["steps_per_s"].values()),
        power(row["mean_differs"]),
        power(row["cov_differs"]),
        "" if row["first_call_s"] is None else f"{row['first_call_s']:.1f} s",
    ]


def package(row: Result) -> str:
    """Return the package of a row, the library on which it runs, and whether a call filters a whole record."""
    return f"{row['peer']}, {row['numbers']}" + ("" if row["stepped"] else ", whole record")


def digits(value: float) -> str:
    """Return a number to two digits, with a comma at thousands."""
    return f"{float(f'{value:.2g}'):,.{max(0, 1 - math.floor(math.log10(value)))}f}"


def power(value: float) -> str:
    """Return a number to one digit with a power of ten, such as 2e-7."""
    return f"{value:.0e}".replace("e-0", "e-") if value else "0"


def conditions(result: Result) -> list[str]:
    """Return lines that tell how to read the table of all filters."""
    return [
        f"{result['task']}: ten states, two measurements, {result['steps']} steps. One core; CPU time, median of "
        f"{result['rounds']} interleaved rounds. One run: microseconds per step. More: thousand run-steps per second; "
        f"a star: one run after another, timed on {result['looped_runs']} of them. Compiles: the first call.",
        "Off: the largest difference at the end from our filter of the same kind, in standard deviations.",
    ]


def notes(result: Result) -> list[str]:
    """Return lines on what else matters beside the times."""
    return [
        *differing(result),
        *whole_ins(result),
        "Every KF is given F. In the pipeline `kf` also feeds its errors back at each epoch, which the `ckf` above does not.",
        *(f"{name}: not measured, {why}." for name, why in result["absent"].items()),
        where(result),
    ]


def differing(result: Result) -> list[str]:
    """Return lines on the filters that differ from ours of the same kind, and why."""
    why: dict[str, list[str]] = {}
    for row in result["rows"]:
        noisier = row["noisier_differs"] or 0.0
        if worst(row) > SAME or noisier > SAME:
            found = f"{row['filter']} {power(worst(row))}"
            loud = f" ({power(noisier)} with {result['noisier']:,.0f} times the Q)" if noisier > SAME else ""
            name = f"{row['peer']}, {row['remark']}" if row["remark"] else row["peer"]
            if found + loud not in why.setdefault(name, []):  # alike fix by fix and with a whole record
                why[name].append(found + loud)
    lines = [f"{name}: {', '.join(found)} standard deviations." for name, found in why.items()]
    if not lines:
        return [f"All agree with our filters of the same kind within {power(SAME)} standard deviations."]
    return [f"All but these agree with our filters of the same kind within {power(SAME)} standard deviations.", *lines]


def whole_ins(result: Result) -> list[str]:
    """Return the comparison with pyins as a whole INS, because it has no filter for a model of one's own."""
    flight = result["flight"]
    if "pyins" not in flight["us_per_step"]:
        return []
    ours, pyins = (digits(flight["us_per_step"][name] / 1e3) for name in ("sins_env", "pyins"))
    return [
        f"pyins is a whole INS with GPS of 15 states. On `{flight['task']}` it takes {pyins} ms per epoch, of one increment "
        f"and one fix, and sins_env's `ekf` {ours} ms; their ends are {flight['differs']['pyins']:.1g} standard deviations apart."
    ]


def worst(row: Result) -> float:
    """Return the larger of the differences of mean and covariance."""
    return float(max(row["mean_differs"], row["cov_differs"]))


def where(result: Result) -> str:
    """Return the line with date, machine and versions."""
    machine = result["machine"]
    versions = ", ".join(f"{name} {version}" for name, version in result["versions"].items())
    others, load = result["others_busy_cores"], max(result["load"])
    quiet = others < QUIET if others is not None else load < OWN + QUIET
    busy = "" if quiet else f"; the machine was busy (load {load:.1f}): the times are long, the ratios better"
    return (
        f"{result['date']}, {machine['processor']}, {machine['cores']} cores, {machine['system']}, "
        f"Python {machine['python']}, {versions}{busy}."
    )


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]], text_columns: int = 1) -> str:
    """Return a Markdown table; columns after the first ``text_columns`` are aligned to the right."""
    rule = ["---" if i < text_columns else "---:" for i in range(len(head))]
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, rule, *rows))


def document(result: Result) -> str:
    """Return the table of all filters with its notes, as Markdown."""
    rows = [[*cells(row)[:2], row["how"], *cells(row)[2:]] for row in result["rows"]]
    head = headings(result)
    table = markdown_table([*head[:2], "how", *head[2:]], rows, text_columns=3)
    return "\n\n".join([table, bullets([*conditions(result), *notes(result)])]) + "\n"


def bullets(lines: Sequence[str]) -> str:
    """Return lines as a Markdown list."""
    return "\n".join(wrapped(f"- {line}", "  ") for line in lines)


def wrapped(line: str, indent: str = "") -> str:
    """Break a line to the width of the page's prose."""
    return textwrap.fill(line, 132, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def feature_table() -> str:
    """Return the table of features as Markdown."""
    rows = [
        [feature.name, *(feature.marks[p].text if p in feature.marks else "" for p in PACKAGES)] for feature in FEATURES
    ]
    return markdown_table(["", *PACKAGES], rows, text_columns=len(PACKAGES) + 1)


def speed_table(result: Result) -> str:
    """Return the table of speeds with one row per package.

    For each filter it has the microseconds per step of one run, and the thousand run-steps per second of many.
    """
    most = list(result["rows"][0]["steps_per_s"])[-1]
    packages: dict[str, dict[str, Result]] = {}
    for row in result["rows"]:
        packages.setdefault(package(row), {})[row["filter"]] = row
    lines = []
    for name, found in packages.items():
        alone = [digits(found[f]["us_per_step"]) if f in found else "" for f in FILTERS]
        many = [digits(found[f]["steps_per_s"][most] / 1e3) if f in found else "" for f in FILTERS]
        lines.append([name, *alone, *many])
    head = ["", *(f"{f}, us" for f in FILTERS), *(f"{f}, k/s" for f in FILTERS)]
    return markdown_table(head, lines)


def section(result: Result) -> str:
    """Return the tables of docs/peers.md, with what they say."""
    most = int(list(result["rows"][0]["steps_per_s"])[-1])
    return "\n\n".join(
        [
            feature_table(),
            "An empty field: not found. `benchmarks/peers/features.py` names the file behind each entry.",
            wrapped(
                f"Speed on the same problem, the alignment of `{result['task']}`: microseconds per step of one run, then "
                f"thousand run-steps per second of {most:,} runs, on one core (`python benchmarks/peers.py`, median of "
                f"{result['rounds']} interleaved rounds, compilation apart):"
            ),
            speed_table(result),
            bullets([*faster(result), *notes(result)]),
        ]
    )


def faster(result: Result) -> list[str]:
    """Return lines on the packages beside sins_env, fix by fix and with whole records, and by how much."""
    ours = {r["filter"]: r for r in result["rows"] if r["peer"] == OURS}
    others = [r for r in result["rows"] if r["peer"] not in (OURS, HAND)]
    most = list(ours["KF"]["steps_per_s"])[-1]
    lines = []
    for stepped, how in ((True, "Fix by fix"), (False, "With a whole record in one call")):
        some = [row for row in others if row["stepped"] == stepped]
        if not some:
            continue
        alone = [(row, ours[row["filter"]]["us_per_step"] / row["us_per_step"]) for row in some]
        many = [(row, row["steps_per_s"][most] / ours[row["filter"]]["steps_per_s"][most]) for row in some]
        lines.append(
            f"{how}, faster than sins_env with one run: {listed(alone)}. With {int(most):,} runs: {listed(many)}."
        )
        if stepped:
            lines += [slower(alone, "with one run"), slower(many, f"with {int(most):,} runs")]
    if any(row["numbers"] == "JAX" for row in others):
        first = [row["first_call_s"] for row in others if row["first_call_s"] is not None]
        lines.append(
            "A whole record is not what an environment gives: it asks for an answer after each fix. "
            f"JAX compiles first, here for {min(first):.1f} to {max(first):.1f} s."
        )
    for row in result["rows"]:
        if row["peer"] == HAND:
            part = ours[row["filter"]]["steps_per_s"][most] / row["steps_per_s"][most]
            lines.append(
                f"`{row['filter'].lower()}` reaches {digits(part)} of the rate of one function that was written for this "
                f"problem alone, with {int(most):,} runs."
            )
    return lines


def slower(ratios: Sequence[tuple[Result, float]], where: str) -> str:
    """Return how many times as long the fastest other package takes, for each filter."""
    found = {}
    for row, ratio in ratios:
        if row["filter"] not in found or ratio > found[row["filter"]][1]:
            found[row["filter"]] = package(row), ratio
    text = ", ".join(f"{name} {digits(1 / ratio)} ({peer})" for name, (peer, ratio) in found.items())
    return f"The fastest other filter {where}, in times of ours: {text}."


def listed(ratios: Sequence[tuple[Result, float]]) -> str:
    """Return ratios of speeds as text grouped by package, such as "dynamax (JAX) KF 12, EKF 13 times"."""
    found: dict[str, list[str]] = {}
    for row, ratio in ratios:
        if ratio > CLEARLY:
            found.setdefault(package(row), []).append(f"{row['filter']} {digits(ratio)}")
    return "; ".join(f"{name} {', '.join(each)} times" for name, each in found.items()) if found else "none"
