"""Three scenarios from files
==========================

A ferry, a tractor with an odometer, and a drone at switch-on::

    python examples/own_scenarios.py                          # all of examples/scenarios, in a minute
    python examples/own_scenarios.py mine.yaml --solver gsf_imm --runs 5
"""

import argparse
from pathlib import Path

import numpy as np

import sins_env
import solvers

HERE = Path(__file__).parent / "scenarios"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", nargs="*", type=Path, default=sorted(HERE.glob("*.yaml")), help="files of scenarios")
    parser.add_argument("--solver", default="ckf", help="default %(default)s")
    parser.add_argument("--runs", type=int, default=1, help="runs of each (default %(default)s)")
    parser.add_argument("--seconds", type=float, default=float("inf"), help="end earlier")
    given = parser.parse_args()
    for path in given.file:
        task = sins_env.tasks.load(path)
        print(f"{task.name}: {task.what}; {task.thresholds}")
        env, solver = task.make(given.runs), solvers.make(given.solver)
        obs, _ = task.reset(env, range(given.runs))
        public = env.unwrapped.task
        solver.reset(public, np.random.default_rng(0).spawn(given.runs), given.runs)
        last = min(round(min(given.seconds, public.duration_s) / public.epoch_s), public.num_epochs)
        for k in range(1, last + 1):
            obs, _, _, _, info = env.step(solver.step(obs))
            if k in (last // 2, last):
                azimuth = ", ".join(f"{x:.3g}" for x in np.abs(np.degrees(info["errors"]["phi"][:, 2])))
                print(f"  {k * public.epoch_s:5.0f} s: azimuth off by {azimuth} deg")


if __name__ == "__main__":
    main()
