"""Examples 1 and 2 of Zhao et al. (2010)
======================================

Does the adaptive filter of document 002 find the noise if it is told a wrong one?

The printed system explodes, so this is its bounded form with ``|x2 x3|``. The filter "as printed" has the recursion of the paper.
The filter "safeguarded" counts the told noise as 20 fixes, damps what a single fix may say, and bounds the estimate.
See docs/mathematics/filters.md#benchmark-of-002.
"""

import argparse

import numpy as np

from sins_env.evaluation.reproduction.pictures.toy import draw_example
from solvers.toy_examples import STEPS, example_1, example_2, exploded

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument(
    "--runs",
    type=int,
    default=200,
    help="default %(default)s; five times as many of the printed system",
)
RUNS = parser.parse_args().runs

ended = exploded(5 * RUNS)
print(f"the system as printed: {np.mean(ended > 0):.0%} of {len(ended)} runs exceed 1e6 within {STEPS} steps, "
      f"half of those by step {np.median(ended[ended > 0]):.0f}\n")  # fmt: skip

for number, title, example in (
    (1, "told q = 0, Q = 0.2; true q = 0.2, Q = 0.4", example_1(RUNS)),
    (2, "told R = 1; true R = 0.5, 0.9, 0.3, 0.7, 0.5; b = 0.95", example_2(RUNS)),
):
    print(f"example {number}: {title}")
    for label, track in example.tracks.items():
        x1, x2, x3 = np.sqrt(np.mean(example.errors(label) ** 2, axis=(0, 1)))
        lost, mended = track.health.failed_at >= 0, track.health.repairs > 0
        print(f"  {label:16} RMS x1 {x1:6.3f}  x2 {x2:6.3f}  x3 {x3:6.3f}   "
              f"runs frozen {lost.mean():4.0%}, with an indefinite covariance {mended.mean():4.0%}")  # fmt: skip
    draw_example(number, example).savefig(f"002_example_{number}.png", dpi=120)
