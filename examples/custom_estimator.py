"""An estimator of your own
========================

Gyro dead reckoning from the told attitude is checked, run, and compared with the cubature Kalman filter. In one command::

    sins-env eval --task sway-white-v0 --solver examples.custom_estimator:DeadReckoning ckf --runs 20
"""

import argparse
from dataclasses import replace

from scipy.spatial.transform import Rotation


class DeadReckoning:
    """Turns the told attitude by the gyro increments. It drifts with the earth's rotation and keeps the error of the start."""

    batched = False  # one run at a time; with True arrays have a leading run axis

    def reset(self, task, rng, num_runs=1):
        q_nb = task.start.q_nb if task.start is not None else [1.0, 0.0, 0.0, 0.0]
        self.attitude = Rotation.from_quat(q_nb, scalar_first=True)

    def step(self, obs):
        turn = obs["dtheta"].sum(axis=0)  # of the epoch; its coning is small beside the earth's rotation
        self.attitude = self.attitude * Rotation.from_rotvec(turn)
        return self.attitude.as_quat(scalar_first=True)


if __name__ == "__main__":
    from sins_env.evaluation import check_estimator, evaluate, get_task

    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--runs", type=int, default=4, help="default %(default)s")
    parser.add_argument("--seconds", type=float, default=360.0, help="default %(default)g")
    given = parser.parse_args()
    task = get_task("sway-white-v0")
    task = replace(task, kwargs={**task.kwargs, "duration": given.seconds})
    broken = [check.name for check in check_estimator(DeadReckoning) if check.passed is False]
    print("contract:", "kept" if not broken else f"broken: {', '.join(broken)}")
    for solver in (DeadReckoning, "ckf"):
        azimuth = evaluate(task, solver, runs=given.runs).summary.rms_final["U"]
        print(
            f"azimuth RMS after {given.seconds:g} s: {azimuth / 3600:6.2f} deg  {solver if solver == 'ckf' else 'DeadReckoning'}"
        )
