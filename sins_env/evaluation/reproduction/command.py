"""The verb ``reproduce``."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from rich.console import Console

from sins_env.evaluation import reproduction
from sins_env.evaluation.outcome import remark
from sins_env.evaluation.reproduction.pictures import save
from sins_env.evaluation.reproduction.running import run_tables
from sins_env.evaluation.reproduction.showing import markdown, terminal
from sins_env.evaluation.store import Store

FIGURES = "figures"
HEAD = """# Published results, reproduced

Made by `sins-env reproduce`. Ours are root mean squares over Monte Carlo runs with 95 % bootstrap intervals. "reproduced": the
printed figure lies where so few records as it rests on would put it; "in order only": it does not, but what differs significantly
stands in the same order.
"""


def reproduce(given: Namespace, console: Console) -> int:
    """Run what is missing, then show and write the tables."""
    numbers = list(dict.fromkeys(given.table)) or reproduction.printed()
    tables = [reproduction.get_table(number) for number in numbers]
    out = Path(given.out)
    if not out.resolve().parent.is_dir():
        raise ValueError(f"--out {out}: the directory above it does not exist")
    out.mkdir(exist_ok=True)
    with Store(out / "results.sqlite") as store:
        made = run_tables(tables, store, given.runs, quick=given.quick, workers=given.workers)
    for table, outcomes, pictures in made:
        console.print(terminal(table, outcomes))
        for picture, results in pictures:
            (out / FIGURES).mkdir(exist_ok=True)
            save(picture.draw(results), out / FIGURES / f"{picture.name}.svg")
        _part(out, table.number).write_text(markdown(table, outcomes), encoding="utf-8")
    there = [_part(out, number) for number in reproduction.names()]
    whole = "\n".join([HEAD, *(part.read_text(encoding="utf-8") for part in there if part.exists())])
    (out / "REPRODUCTION.md").write_text(whole, encoding="utf-8")
    remark(f"tables: {out / 'REPRODUCTION.md'}")
    return 0


def _part(out: Path, number: str) -> Path:
    """Each table has a file of its own, so that a later command for another one keeps it."""
    return out / f"table-{number}.md"
