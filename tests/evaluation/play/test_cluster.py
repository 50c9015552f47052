"""A Dask scheduler and two workers that run elsewhere, as processes of their own: the rows are those of the local run."""

import json
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from evaluation import plugins
from evaluation.test_monte_carlo import HERE, assert_same, run
from places import ROOT

from sins_env.evaluation.play import cluster
from sins_env.evaluation.play.executors import check_executor
from sins_env.evaluation.play.job import Job
from sins_env.evaluation.store.store import Store

WAIT_S = 120.0


@pytest.fixture
def started(tmp_path):
    """Start the scheduler and its workers, and return its address with the processes."""
    pytest.importorskip("distributed", reason="the cluster elsewhere is one of Dask: pip install distributed")
    processes = []

    def start(what, *more):
        command = [sys.executable, "-m", "distributed.cli.dask_" + what, *more]
        environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}"}
        processes.append(subprocess.Popen(command, env=environment, cwd=tmp_path, stderr=subprocess.DEVNULL))

    file = tmp_path / "scheduler.json"
    start("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    until(file.exists)
    until(file.read_text)
    address = json.loads(file.read_text())["address"]
    for _ in range(2):
        start("worker", address, "--nthreads", "1", "--no-nanny", "--no-dashboard")
    yield address, processes
    for process in processes:
        process.kill()
        process.wait()


def told(folder):
    """The processes in which TellsWhere has played."""
    return {int(path.name) for path in folder.iterdir() if path.name.isdecimal()}


def until(condition):
    deadline = time.monotonic() + WAIT_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_cluster_elsewhere(short, started, cli, tmp_path, monkeypatch):
    """One worker is killed while it plays; others with another environment get no work; in the end the scheduler dies."""
    address, (scheduler, *workers) = started
    with cluster.elsewhere(address) as there:
        there.client.wait_for_workers(2, timeout=WAIT_S)
        job = Job(short, plugins.Told, (0,))
        joined_late = there.client.submit(cluster._run_elsewhere, job, 1, {"numpy": "0.1"})
        with pytest.raises(cluster.ClusterError, match=r"worker tcp://\S+ has numpy \S+, needed 0.1"):
            joined_late.result(timeout=WAIT_S)
    with monkeypatch.context() as other:
        other.setattr(cluster.version.metadata, "version", lambda name: "7.7")
        with pytest.raises(cluster.ClusterError) as raised:
            run(short, "Told", 1, executor=address, workers=None)
    assert f"{address}: worker tcp://" in str(raised.value)
    assert "needed 7.7 (2 of 2 workers differ)" in str(raised.value)

    given = {"folder": str(tmp_path), "seconds": 0.002}
    ours = run(short, "TellsWhere", 4, chunk=1, settings=given).records
    before = told(tmp_path)
    with ThreadPoolExecutor(1) as thread:
        found = thread.submit(run, short, "TellsWhere", 4, chunk=1, settings=given, executor=address, workers=None)
        until(lambda: told(tmp_path) - before)
        os.kill((told(tmp_path) - before).pop(), signal.SIGKILL)
    assert_same(found.result().records, ours, rtol=0)
    assert sum(worker.poll() is None for worker in workers) == 1

    # A stranger's solver has a process of its own on the worker, which outlives it.
    add = Store.add

    def last(self, key, records):
        add(self, key, records)
        scheduler.kill()

    db = tmp_path / "r.sqlite"
    monkeypatch.setattr(Store, "add", last)
    code, _, (line,) = cli("eval", "--task", "short-v0", "--solver", HERE + "Leaves", "--runs", "2", "--chunk", "1",
                           "--db", db, "--executor", address)  # fmt: skip
    assert (code, line.removeprefix("sins-env: ")) == (
        1, f"{address}: the scheduler is gone: 1 of 2 runs are in {db}; --resume continues"
    )  # fmt: skip
    with Store(db, read_only=True) as store:
        assert "ended its process" in store.results(*store.keys()).records.reason[0]
    assert sum(worker.poll() is None for worker in workers) == 1
    monkeypatch.setattr(cluster, "CONNECT_S", 0.2)
    with pytest.raises(cluster.ClusterError, match=f"{address}: no Dask scheduler answers"):
        run(short, "Told", 1, executor=address, workers=None)


@pytest.mark.parametrize(
    "bad",
    [
        "tcp://",
        "tcp://host",
        "udp://host:8786",
        "tcp://host:0",
        "tcp://host:99999",
        "tcp://host:8786/path",
        "tcp://user@host:8786",
        "tcp://:8786",
        "tcp://ho st:8786",
        "tcp://[::g]:8786",
        "tcp://[::1]",
        "tcp://host:-1",
        "tcp://host:٣",
        "://",
        "tcp:host:1",
    ],
)
def test_bad_addresses(bad, cli):
    code, _, (line,) = cli("eval", "--task", "sway-white-v0", "--solver", "ckf", "--executor", bad)
    assert code == 2
    assert "allowed" in line or "did you mean" in line


def test_addresses():
    for good in ("tcp://localhost:8786", "tls://10.0.0.1:1", "tcp://[::1]:65535", "tcp://node-1.cluster.local:8786"):
        check_executor(good)
    with pytest.raises(ValueError, match="allowed: none, its cluster has its own"):
        check_executor("tcp://localhost:8786", 2)
