"""Try many examples of every kind on all cores, and print a table: ``python -m fuzz N [KIND ...]``."""

import collections
import json
import multiprocessing
import multiprocessing.connection
import os
import resource
import shutil
import sys
import tempfile
import time
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


def fuzz(wanted: list[tuple[str, int]], cores: int) -> dict[str, Tally]:
    """Try the chunks (kind, number of examples), each in a process of its own, ``cores`` at a time."""
    fork, found = multiprocessing.get_context("fork"), {name: Tally() for name, _ in wanted}
    waiting = [(name, count, number) for number, (name, count) in enumerate(wanted)]
    running: dict[Any, tuple[Any, str, Path]] = {}
    done = 0
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
            process, name, place = running.pop(receive)
            try:
                tally = receive.recv()
            except EOFError:
                process.join()
                tally = _dead(place, process.exitcode)
            process.join()
            found[name].add(tally)
            shutil.rmtree(place, ignore_errors=True)
            done += 1
            print(f"{done} of {len(wanted)} chunks", end="\r", file=sys.stderr, flush=True)
    return found


def main(arguments: list[str]) -> int:
    """Print the table and the failures, and return 1 if there are any."""
    total, names = int(arguments[0]), arguments[1:] or list(KINDS)
    whole = sum(KINDS[name].share for name in names)
    wanted = []
    for name in names:
        count = max(round(total * KINDS[name].share / whole), 1)
        wanted += [(name, min(CHUNK, count - begin)) for begin in range(0, count, CHUNK)]
    begin = time.perf_counter()
    for name in names:  # once, and not in each process
        KINDS[name].prepare()
    found = fuzz(wanted, os.cpu_count() or 1)
    form = "{:28} {:>8} {:>8} {:>8} {:>9} {:>9}"
    print(form.format("kind", "tried", "refused", "worked", "failures", "CPU, s"))
    everything = Tally()
    for name, tally in found.items():
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
    return 1 if everything.causes else 0


def _row(form: str, name: str, tally: Tally) -> str:
    counts = tally.counts
    return form.format(
        name, counts["tried"], counts["refused"], counts["worked"], counts["failures"], f"{tally.cpu_s:.0f}"
    )


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
