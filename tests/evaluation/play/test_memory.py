"""Memory of an evaluation: below 1 GiB at 256 runs, and the same whatever the duration."""

import os
import subprocess
import sys

import pytest
from places import ROOT

MIB = 2**20

_EVALUATION = """
import dataclasses, resource, sys
from sins_env.evaluation import evaluate, get_task
task = get_task("sway-white-v0")
kwargs = {**task.kwargs, "duration": float(sys.argv[1]), "n_sub": 2}
found = evaluate(dataclasses.replace(task, kwargs=kwargs, hold_s=5.0), "evaluation.plugins:Told", 256,
                 workers=1, chunk=256, cost=False)
assert len(found.records) == 256
assert found.summary.runs == 256
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def peak(duration_s):
    """Bytes that a process with one evaluation of 256 runs holds at most."""
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}:{ROOT / 'tests'}", "OPENBLAS_NUM_THREADS": "1"}
    command = [sys.executable, "-c", _EVALUATION, str(duration_s)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return int(done.stdout) * (1 if sys.platform == "darwin" else 1024)


@pytest.mark.skipif(sys.platform == "win32", reason="no getrusage")
def test_memory_does_not_grow_with_the_duration():
    short, long = peak(60.0), peak(240.0)
    assert long < 1024 * MIB
    assert long - short < 8 * MIB  # errors kept at every epoch would be 10, observations 200
