"""The verb ``map``: a first mapping of a text table, with what was measured."""

from __future__ import annotations

import json
from argparse import Namespace
from pathlib import Path

from rich.console import Console

from sins_env.cli.output import remark
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.show.rich_tables import titled
from sins_env.reading.files import following
from sins_env.recordings.file_format import unpacked_name
from sins_env.recordings.guessing import Known, guess
from sins_env.writing.files import replacing


def write_mapping(given: Namespace, console: Console) -> int:
    """Guess the mapping of a file, write it, and print each key with the measure behind it.

    Raises:
        FileExistsError: a mapping that is there already, without ``--force``.
        ValueError: a file that is no table of an IMU.
    """
    path = Path(given.file)
    target = Path(given.out) if given.out else unpacked_name(path).with_suffix(".json")
    if target.exists() and not given.force:
        raise FileExistsError(f"{target} exists already; allowed: --out with another name, or --force")
    site = None if given.site is None else tuple(given.site)
    with Bar(f"reading {path}", total=1.0) as bar, following(bar.update):
        found = guess(path, Known(site, given.axes, given.rate, given.gnss))
    table = titled(f"{path.name}: {target.name}")
    for name in ("key", "guess", "because"):
        table.add_column(name, overflow="fold")
    for line in found.lines:
        table.add_row(*line)
    console.print(table)
    with replacing([target]) as (new,):
        new.write_text(json.dumps(found.mapping, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
    print(target, flush=True)
    for one in found.open:
        remark(f"open: {one}")
    return 0
