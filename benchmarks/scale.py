"""Throughput against the number of workers, the cost of a chunk beside its runs, and what many workers would do.

    python benchmarks/scale.py                              processes and Dask on this machine, 1 and 2 workers
    python benchmarks/scale.py --json benchmarks/scale.json --runs 1024
    python benchmarks/scale.py --doc                        writes the figures of docs/scale.md from the kept result

Four things are measured: runs per second of an evaluation, an empty job there and back, and a job and its records as bytes.
The fourth is rows per second of the one process that writes, and of a merge. The model takes its figures from them. A worker
needs the time of its runs and of a round trip for each chunk. The process that writes needs its own time for each chunk,
whatever the number of workers, so that it is the first to be busy all the time.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import pickle
import platform
import resource
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import wait
from pathlib import Path
from typing import Any

from markers import replaced
from rich.console import Console
from rich.table import Table

from sins_env.evaluation import evaluate
from sins_env.evaluation.estimators.memory import keep_freed_memory
from sins_env.evaluation.play.cluster import dask_client
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.play.playing import run_job
from sins_env.evaluation.play.pool import Processes
from sins_env.evaluation.play.queue import CHUNK_MOST
from sins_env.evaluation.play.records import Records
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.merging import merge
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import suite_hash

RESULT = Path(__file__).with_name("scale.json")
DOC = Path(__file__).parents[1] / "docs/scale.md"
MARKS = "figures"
EMPTY_JOBS = 100  #: number of empty jobs whose round trip is timed
CHUNKS_WRITTEN = 20  #: number of chunks that the writer is timed with
MODELLED = (1, 10, 100, 1000)  #: numbers of workers
LINE_BYTES_S = 125e6  #: bytes per second of the line to the process that writes, 1 Gbit/s

Result = dict[str, Any]


def cpu_s() -> float:
    """Return the CPU seconds of this process and of all its children that have ended."""
    return sum(
        used.ru_utime + used.ru_stime
        for used in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def throughput(task: str, solver: str, runs: int, executor: str, workers: int) -> Result:
    """Evaluate once on workers that have started, and return wall and CPU time."""
    begin_cpu = cpu_s()
    chunk = max(1, runs // (4 * workers))

    def played(where: Any) -> tuple[float, float]:
        given = {"executor": where, "chunk": chunk, "cost": False}
        evaluate(task, solver, workers * 2, **given | {"chunk": 1})  # kernels, task and solver are loaded
        begin, here = time.perf_counter(), time.process_time()
        evaluate(task, solver, runs, **given)
        return time.perf_counter() - begin, time.process_time() - here

    if executor == "dask":
        with dask_client(workers) as client:
            wall, here = played(client.get_executor())
    else:
        with Processes(workers) as processes:
            wall, here = played(processes)
    for process in multiprocessing.active_children():  # which count when they have ended
        process.join()
    return {
        "executor": executor,
        "workers": workers,
        "chunk": chunk,
        "runs_per_s": runs / wall,
        "parent_cpu_ms_per_chunk": 1e3 * here / (runs / chunk),
        "cpu_s_with_start": cpu_s() - begin_cpu,
    }


def nothing(number: int) -> int:
    """Return the number of an empty job."""
    return number


def round_trips() -> Result:
    """Time empty jobs: one after another, and all at once, where the time of each is that of the parent."""
    found: Result = {}
    with Processes(1) as processes:
        processes.call(nothing, 0)
        found["processes"] = timed(lambda: [processes.call(nothing, i) for i in range(EMPTY_JOBS)], EMPTY_JOBS)
    with dask_client(1) as client:
        executor = client.get_executor(pure=False)
        executor.submit(nothing, 0).result()
        found["dask"] = timed(lambda: [executor.submit(nothing, i).result() for i in range(EMPTY_JOBS)], EMPTY_JOBS)
        found["dask, all at once"] = timed(
            lambda: wait([executor.submit(nothing, i) for i in range(EMPTY_JOBS)]), EMPTY_JOBS
        )
    return found


def timed(work: Callable[[], Any], count: int) -> Result:
    """Return wall and CPU microseconds of this process, for each of ``count`` things that ``work`` does."""
    begin, here = time.perf_counter(), time.process_time()
    work()
    return {"us": 1e6 * (time.perf_counter() - begin) / count, "cpu_us": 1e6 * (time.process_time() - here) / count}


def parcels(task: str, solver: str, runs: int) -> tuple[Result, Records]:
    """Play one chunk here, and return its CPU time, the bytes that travel, and the records."""
    job = Job(get_task(task), solver, tuple(range(runs)))
    run_job(Job(job.task, solver, (0,)))
    begin = time.process_time()
    records = run_job(job)
    played = time.process_time() - begin
    sent, back = pickle.dumps(job), pickle.dumps(records)
    repeats = range(20)
    read = [timed(lambda: pickle.loads(back), runs)["cpu_us"] for _ in repeats]  # our own bytes
    written = [timed(lambda: pickle.dumps(records), runs)["cpu_us"] for _ in repeats]
    return {
        "chunk": runs,
        "run_ms": 1e3 * played / runs,
        "job_bytes": len(sent),
        "bytes_per_run": len(back) / runs,
        "pickle_us_per_run": statistics.median(written),
        "unpickle_us_per_run": statistics.median(read),
    }, records


def writing(task: str, records: Records, folder: Path) -> Result:
    """Write chunks to a results file and merge two files that share half their runs; return rows per second."""
    found: Result = {}
    of = get_task(task)
    each = [records.row(i) for i in range(len(records))]
    for name, first in (("a", 0), ("b", CHUNKS_WRITTEN // 2)):
        with Store(folder / f"{name}.sqlite") as store:
            store.add_task(of)
            key = Key.of(of.name, suite_hash(of, None), "ckf", {}, "1")
            parts = [
                Records.of_rows(records.criteria, [{**row, "run": k * len(each) + i} for i, row in enumerate(each)])
                for k in range(first, first + CHUNKS_WRITTEN)
            ]

            def write(store: Store = store, key: Key = key, parts: list[Records] = parts) -> None:
                for part in parts:
                    store.add(key, part)

            found["write"] = timed(write, CHUNKS_WRITTEN * len(each))
    found["file_bytes_per_run"] = (folder / "a.sqlite").stat().st_size / (CHUNKS_WRITTEN * len(each))
    total = 2 * CHUNKS_WRITTEN * len(each)
    found["merge"] = timed(lambda: merge([folder / "a.sqlite", folder / "b.sqlite"], folder / "c.sqlite"), total)
    return found


def measured(task: str, solver: str, runs: int) -> Result:
    """Measure everything."""
    keep_freed_memory()
    parcel, records = parcels(task, solver, CHUNK_MOST)
    with tempfile.TemporaryDirectory() as folder:
        rows = writing(task, records, Path(folder))
    loads = [os.getloadavg()[0]]
    tables = [throughput(task, solver, runs, name, n) for name in ("processes", "dask") for n in (1, 2)]
    return {
        "date": time.strftime("%Y-%m-%d", time.gmtime()),
        "system": f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        "load": [*loads, os.getloadavg()[0]],
        "task": task,
        "solver": solver,
        "runs": runs,
        "throughput": tables,
        "round_trip": round_trips(),
        "parcel": parcel,
        "rows": rows,
    }


def modelled(found: Result, run_ms: float | None = None) -> list[Result]:
    """Return what so many workers would do with chunks of CHUNK_MOST runs on Dask.

    A run takes ``run_ms`` of CPU time on its worker, by default what was measured. The process that writes spends on each run
    its share of a submission, the unpickling, and the row. All are CPU times, which a busy machine changes little.
    """
    parcel, trip, chunk = found["parcel"], found["round_trip"], CHUNK_MOST
    work_s = 1e-3 * (run_ms or parcel["run_ms"]) * chunk + 1e-6 * (
        parcel["pickle_us_per_run"] * chunk + trip["dask"]["cpu_us"]
    )
    own = {
        "scheduler": 1e-6 * trip["dask, all at once"]["cpu_us"] / chunk,
        "unpickling": 1e-6 * parcel["unpickle_us_per_run"],
        "rows": 1e-6 * found["rows"]["write"]["cpu_us"],
    }
    writer_s = sum(own.values())
    line_s = parcel["bytes_per_run"] / LINE_BYTES_S
    out = []
    for workers in MODELLED:
        wanted = workers * chunk / work_s
        limits = {"workers": wanted, "writer": 1 / writer_s, "line": 1 / line_s}
        first = min(limits, key=lambda name: limits[name])
        out.append(
            {
                "workers": workers,
                "runs_per_s": limits[first],
                "limit": first,
                "writer_busy": min(wanted * writer_s, 1.0),
                "line_MB_s": limits[first] * parcel["bytes_per_run"] / 1e6,
                "least_runs": workers * chunk,
                "first_s": work_s,
            }
        )
    return out


def served(found: Result) -> float:
    """Return the number of workers that keep the process that writes busy all the time."""
    one = modelled(found)[0]
    return 1.0 / float(one["writer_busy"])


def lines(found: Result) -> list[tuple[str, list[str], list[list[str]]]]:
    """Return the tables: title, headings and cells."""
    parcel, rows = found["parcel"], found["rows"]
    runs = [
        [
            one["executor"],
            str(one["workers"]),
            f"{one['runs_per_s']:,.0f}",
            f"{one['cpu_s_with_start']:.1f}",
            f"{one['parent_cpu_ms_per_chunk']:.1f}",
        ]
        for one in found["throughput"]
    ]
    costs = [
        [f"empty job, {name}", f"{one['us']:,.0f}", f"{one['cpu_us']:,.0f}", f"{1e6 / one['cpu_us']:,.0f}"]
        for name, one in found["round_trip"].items()
    ]
    for name, us in (
        (f"records to bytes, {parcel['chunk']} runs", parcel["pickle_us_per_run"] * parcel["chunk"]),
        (f"records from bytes, {parcel['chunk']} runs", parcel["unpickle_us_per_run"] * parcel["chunk"]),
    ):
        costs.append([name, "", f"{us:,.0f}", ""])
    for name, one in (
        (f"a row written, in chunks of {parcel['chunk']}", rows["write"]),
        ("a row merged, half of them twice", rows["merge"]),
    ):
        costs.append([name, f"{one['us']:,.0f}", f"{one['cpu_us']:,.0f}", f"{1e6 / one['cpu_us']:,.0f}"])
    long_ms = 10 * parcel["run_ms"]
    many = [
        [
            f"{one['workers']:,}",
            f"{one['runs_per_s']:,.0f}",
            one["limit"],
            f"{100 * one['writer_busy']:.0f} %",
            f"{one['line_MB_s']:.2g}",
            f"{one['least_runs']:,}",
            f"{slow['runs_per_s']:,.0f}",
            slow["limit"],
        ]
        for one, slow in zip(modelled(found), modelled(found, long_ms), strict=True)
    ]
    return [
        (
            f"Measured: {found['runs']:,} runs of {found['solver']} on {found['task']}",
            ["executor", "workers", "runs/s", "CPU s with start", "parent, CPU ms a chunk"],
            runs,
        ),
        ("Measured: one thing each, in the process that writes", ["what", "us", "CPU us", "per CPU second"], costs),
        (
            f"Model: chunks of {CHUNK_MOST}, {parcel['run_ms']:.1f} ms of CPU time a run, and ten times as much",
            ["workers", "runs/s", "limit", "writer busy", "MB/s", "runs to fill them", "runs/s at 10 x", "limit at 10 x"],
            many,
        ),
    ]  # fmt: skip


def told(found: Result) -> str:
    """Return the figures as Markdown."""
    parcel = found["parcel"]
    text = [
        f"Measured on {found['date']}, {found['system']}, load {max(found['load']):.1f}: `python benchmarks/scale.py`. "
        f"A job is {parcel['job_bytes']:,} bytes, its records {parcel['bytes_per_run']:,.0f} bytes a run, and the file "
        f"{found['rows']['file_bytes_per_run']:,.0f}. The process that writes serves {served(found):,.0f} workers of such runs."
    ]
    for title, heads, cells in lines(found):
        rule = ["---", *["---:"] * (len(heads) - 1)]
        text += [f"{title}:", "\n".join("| " + " | ".join(line) + " |" for line in (heads, rule, *cells))]
    return "\n\n".join(text)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(description="throughput against workers, and what limits it")
    parser.add_argument("--task", default="sway-white-v0", help="default %(default)s")
    parser.add_argument("--solver", default="ckf", help="default %(default)s")
    parser.add_argument("--runs", type=int, default=1024, help="runs of an evaluation, default %(default)s")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the result")
    parser.add_argument("--doc", action="store_true", help=f"write the figures of {DOC.name} from {RESULT.name}")
    given = parser.parse_args(arguments)
    if given.doc:
        DOC.write_text(replaced(DOC.read_text(), MARKS, told(json.loads(RESULT.read_text()))))
        return 0
    found = measured(given.task, given.solver, given.runs)
    console = Console()
    for title, heads, cells in lines(found):
        table = Table(title=title, title_justify="left")
        for i, head in enumerate(heads):
            table.add_column(head, justify="right" if i else "left")
        for line in cells:
            table.add_row(*line)
        console.print(table)
    print(json.dumps(found))
    if given.json:
        given.json.write_text(json.dumps(found, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
