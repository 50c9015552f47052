"""What the stamps of a recording say: jitter that was evened out, samples left out, and gaps that are bridged.

These are notes: the data are used as the text says.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from sins_env.recordings.findings.finding import Finding
from sins_env.recordings.recording import Gap, Recording, first_few, seconds

MOST_JITTER = 0.05  #: RMS of stamps about the clock, in samples, from which on it is told


def jitter(recording: Recording) -> Iterator[Finding]:
    """Tell how far the stamps of the samples lay from the clock on which the samples were put."""
    stamping = recording.stamping
    if stamping is None or not stamping.evened:
        return
    together = f", {stamping.batch} samples with one stamp (it is that of the last)" if stamping.batch > 1 else ""
    text = (
        f"the stamps of the samples scatter about a clock of {recording.rate_hz:.7g} Hz{together}: jitter "
        f"{_short(stamping.jitter_s)} RMS, at most {_short(stamping.worst_s)}, evened out"
    )
    limit = 1e3 * MOST_JITTER / recording.rate_hz
    yield Finding("jitter", 1e3 * stamping.jitter_s, limit, "ms", _all(recording), text, False)


def repeated_stamps(recording: Recording) -> Iterator[Finding]:
    """Tell samples that were left out because they have the stamp of the one before."""
    stamping = recording.stamping
    if stamping is not None and stamping.dropped:
        text = f"{stamping.dropped} samples with the stamp of the one before were left out, as drop_duplicates wants"
        yield Finding("repeated_stamps", stamping.dropped, 0, "samples", _all(recording), text, False)


def bridged_gaps(recording: Recording) -> Iterator[Finding]:
    """Tell gaps that were filled with interpolated increments."""
    gaps = recording.bridged
    if gaps:
        longest, missing, span = _missing(gaps)
        text = f"{missing}, bridged by interpolated increments"
        yield Finding("bridged", 1e3 * longest, 0, "ms", span, text, False)


def long_gaps(recording: Recording) -> Iterator[Finding]:
    """Tell gaps that are not bridged: no window spans them."""
    gaps = recording.gaps
    if gaps:
        longest, missing, span = _missing(gaps)
        text = f"{missing}, which split the recording; a longer bridge may fill them, with the error that it has on like stretches"
        yield Finding("gaps", longest, 0, "s", span, text, False)


def _missing(gaps: Sequence[Gap]) -> tuple[float, str, tuple[float, float]]:
    """Return the length of the longest gap in s, what is missing in words, and the span from the first gap to the last."""
    longest = max(gap.end - gap.start for gap in gaps)
    times = first_few([f"{seconds(gap.start)} s" for gap in gaps])
    samples = sum(gap.samples for gap in gaps)
    text = f"{samples} samples are missing in {len(gaps)} gaps of up to {_short(longest)} (from {times})"
    return longest, text, (gaps[0].start, gaps[-1].end)


def _short(t: float) -> str:
    return f"{1e3 * t:.3g} ms" if t < 1 else f"{t:.3g} s"


def _all(recording: Recording) -> tuple[float, float]:
    return recording.t0, recording.end
