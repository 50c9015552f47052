"""The verb ``bound``: the best that the sensors of a task allow over time, and what limits it. No run is played."""

from __future__ import annotations

import json
import sys
from argparse import Namespace

from rich.console import Console

from sins_env.cli.output import check_plot, save_figure
from sins_env.evaluation.planning import tables
from sins_env.evaluation.planning.family import bound as find
from sins_env.evaluation.planning.figure import forecast_figure


def bound(given: Namespace, console: Console) -> int:
    """Print the bound over time, when a wanted accuracy is reached, and the budget by source of error."""
    check_plot(given.plot)
    found = find(given.task, given.until, dict(given.compare))
    if given.at is not None:
        found.index(found.t, given.at)
    if given.plot:
        save_figure(forecast_figure(found), given.plot)
    if given.json:
        json.dump(found.to_dict(given.at), sys.stdout, indent=2, allow_nan=False)
        print()
        return 0
    for part in tables.told(found, given.at):
        console.print(part)
    return 0
