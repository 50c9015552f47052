"""Every example runs, in a fresh interpreter and a scratch folder, with as little work as it offers."""

import os
import subprocess
import sys

import pytest
from places import ROOT

EXAMPLES = sorted((ROOT / "examples").glob("*.py"))
#: What those that take long are given; without arguments they do the whole of what their docstrings say.
LITTLE = {
    "adaptive_noise": "--runs 2 --seconds 15",
    "aids_of_a_car": "--begin 5 --outage 2 --runs 2",
    "bank_of_headings": "--seconds 10",
    "compare_two_filters": "--runs 2 --seconds 15",
    "custom_estimator": "--runs 1 --seconds 60",
    "gps_outage": "--runs 2 --flight flight-hotstart30-v0",
    "my_recording": "--seconds 40",
    "own_scenarios": "--seconds 20",
    "paper_002_examples": "--runs 20",
    "ppo_tune_noise": "--minutes 0 --runs 2 --seconds 10 --constant -1 0",
    "start_in_motion": "--runs 2 --solver ckf",
}


@pytest.mark.parametrize("script", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(script, tmp_path):
    env = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHONWARNINGS": "error::DeprecationWarning:__main__"}
    command = [sys.executable, script, *LITTLE.get(script.stem, "").split()]
    done = subprocess.run(command, cwd=tmp_path, env=env, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert done.stdout.strip()


def test_what_is_given_is_given_to_an_example():
    assert set(LITTLE) <= {script.stem for script in EXAMPLES}
