"""What the recommended solver holds possible
==========================================

Headings, noises of the IMU and regimes of the fixes, as a figure over time::

    python examples/bank_of_headings.py                                  # bank.png: a swaying base, any heading
    python examples/bank_of_headings.py --task sway-jump-v0 --seconds 360
"""

import argparse

import solvers
from sins_env.evaluation.show.bank_figure import bank_figure
from sins_env.evaluation.tasks.catalogue import get_task


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--task", default="sway-anyheading-v0", help="default %(default)s")
    parser.add_argument("--seconds", type=float, default=120.0, help="default %(default)s")
    parser.add_argument("--figure", default="bank.png", help="default %(default)s")
    given = parser.parse_args()
    task, solver = get_task(given.task), solvers.make("gsf_imm")
    env = task.make(1)
    obs, _ = task.reset(env, (0,))
    public = env.unwrapped.task
    solver.reset(public, None)
    times, facts = [], []
    for k in range(1, min(round(given.seconds / public.epoch_s), public.num_epochs) + 1):
        obs, *_ = env.step(solver.step(obs))
        if k % 10 == 0:
            times.append(k * public.epoch_s)
            facts.append({name: value[0] for name, value in solver.diagnostics().items()})
    bank_figure(times, facts, solver.labels, f"gsf_imm on {task.name}").savefig(given.figure)
    slices = [
        f"{one['slices']:.0f} at {t:.0f} s" for t, one in list(zip(times, facts, strict=True))[:: len(times) // 4]
    ]
    print(f"{given.figure}; slices of the heading: {', '.join(slices)}")


if __name__ == "__main__":
    main()
