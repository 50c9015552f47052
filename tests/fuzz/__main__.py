"""Try many examples of every kind on all cores, and print a table: ``python -m fuzz N [KIND ...]``."""

import collections
import json
import multiprocessing
import multiprocessing.connection
import os
import resource
import shutil
import signal
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hypothesis import HealthCheck, Phase, given, seed, settings

from fuzz import kind
from fuzz.kinds import KINDS
from fuzz.outcome import Failed

CHUNK = 500  #: most examples that one process tries
SHOWN = 60  #: most causes of failure that are printed
QUIET = {
    "database": None, "deadline": None, "suppress_health_check": list(HealthCheck), "report_multiple_bugs": False,
}  # fmt: skip


@dataclass
class Tally:
    """What the examples of a kind came to."""

    counts: collections.Counter[str] = field(default_factory=collections.Counter)
    causes: collections.Counter[str] = field(default_factory=collections.Counter)
    first: dict[str, tuple[str, str]] = field(default_factory=dict)  #: shortest example and its message by cause
    cpu_s: float = 0.0

    def failed(self, cause: str, example: str, message: str) -> None:
        self.counts["failures"] += 1
        self.causes[cause] += 1
        if cause not in self.first or len(example) < len(self.first[cause][0]):
            self.first[cause] = (example, message)

    def add(self, other: "Tally") -> None:
        self.counts += other.counts
        self.causes += other.causes
        self.cpu_s += other.cpu_s
        for cause, (example, message) in other.first.items():
            if cause not in self.first or len(example) < len(self.first[cause][0]):
                self.first[cause] = (example, message)


def _chunk(name: str, count: int, number: int, place: Path, out: Any) -> None:
    """Try ``count`` examples in this process, and send the tally."""
    kind.FOLDER[0] = place
    os.chdir(place)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent ends this process
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
    one, tally = KINDS[name], Tally()

    @seed(number)
    @settings(max_examples=count, phases=[Phase.generate], **QUIET)
    @given(one.examples)
    def try_it(example: Any) -> None:
        tally.counts["tried"] += 1
        text = repr(example)
        (place / "last").write_text(json.dumps([tally.counts["tried"], text]))
        try:
            tally.counts[one.go(example)] += 1
        except Failed as failure:
            tally.failed(failure.kind, text, str(failure))

    try_it()
    tally.cpu_s = time.process_time() + sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
    out.send(tally)


def _dead(place: Path, code: int | None) -> Tally:
    """Return the tally of a process that died."""
    tally = Tally()
    tried, text = json.loads((place / "last").read_text()) if (place / "last").exists() else (0, "?")
    tally.counts["tried"] = tried
    tally.failed(f"the interpreter died with code {code}", text, f"after {tried} examples")
    return tally


def fuzz(wanted: list[tuple[str, int]], cores: int) -> tuple[dict[str, Tally], bool]:
    """Try the chunks (kind, number of examples), each in a process of its own, ``cores`` at a time.

    Returns the tallies, and whether all chunks are among them; Ctrl-C ends the work early.
    """
    found: dict[str, Tally] = {name: Tally() for name, _ in wanted}
    running: dict[Any, tuple[Any, str, Path]] = {}
    try:
        for done in _tallies(wanted, cores, running, found):
            print(f"{done} of {len(wanted)} chunks", end="\r", file=sys.stderr, flush=True)
    except KeyboardInterrupt:
        for process, _, place in running.values():
            process.kill()
            process.join()
            shutil.rmtree(place, ignore_errors=True)
        return found, False
    return found, True


def _tallies(
    wanted: list[tuple[str, int]], cores: int, running: dict[Any, tuple[Any, str, Path]], found: dict[str, Tally]
) -> Iterator[int]:
    """Yield the number of chunks that are done, after each of them."""
    fork, done = multiprocessing.get_context("fork"), 0
    waiting = [(name, count, number) for number, (name, count) in enumerate(wanted)]
    while waiting or running:
        while waiting and len(running) < cores:
            name, count, number = waiting.pop(0)
            receive, send = fork.Pipe(duplex=False)
            place = Path(tempfile.mkdtemp(prefix="sins-env-fuzz-"))
            process = fork.Process(target=_chunk, args=(name, count, number, place, send))
            process.start()
            send.close()
            running[receive] = (process, name, place)
        for receive in multiprocessing.connection.wait(list(running)):
            process, name, place = running[receive]
            try:
                tally = receive.recv()
            except EOFError:
                process.join()
                tally = _dead(place, process.exitcode)
            process.join()
            del running[receive]
            found[name].add(tally)
            shutil.rmtree(place, ignore_errors=True)
            done += 1
            yield done


def main(arguments: list[str]) -> int:
    """Print the table and the failures, and return 1 if there are any."""
    total, names = int(arguments[0]), arguments[1:] or list(KINDS)
    whole = sum(KINDS[name].share for name in names)
    parts: list[tuple[float, str, int]] = []
    for name in names:
        count = max(round(total * KINDS[name].share / whole), 1)
        parts += [(begin / count, name, min(CHUNK, count - begin)) for begin in range(0, count, CHUNK)]
    wanted = [(name, count) for _, name, count in sorted(parts)]  # all kinds advance together
    begin = time.perf_counter()
    for name in names:  # once, and not in each process
        KINDS[name].prepare()
    found, complete = fuzz(wanted, os.cpu_count() or 1)
    form = "{:28} {:>8} {:>8} {:>8} {:>9} {:>9}"
    print(form.format("kind", "tried", "refused", "worked", "failures", "CPU, s"))
    everything = Tally()
    for name, tally in sorted(found.items()):
        everything.add(tally)
        print(_row(form, name, tally))
    print(_row(form, "all", everything), f"   {time.perf_counter() - begin:.0f} s on {os.cpu_count()} cores")
    for name, tally in found.items():
        for cause, count in tally.causes.most_common(SHOWN):
            example, message = tally.first[cause]
            print(f"\n# {name}: {count} x {cause}\n#   {message[:400]!r}")
            print(f"kinds.go({name!r}, {example[:1500]})")
    if everything.causes:
        print("\n# PYTHONPATH=tests; from fuzz import kinds; import math; import numpy as np")
    if not complete:
        print(f"\ninterrupted: {everything.counts['tried']} of {total} tried")
    return 1 if everything.causes else 0 if complete else 130


def _row(form: str, name: str, tally: Tally) -> str:
    counts = tally.counts
    return form.format(
        name, counts["tried"], counts["refused"], counts["worked"], counts["failures"], f"{tally.cpu_s:.0f}"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
