"""The verb ``reproduce``: published tables as Monte Carlo runs."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

from rich.console import Console

from sins_env.cli.output import remark
from sins_env.evaluation import reproduction
from sins_env.evaluation.play.progress import Bar
from sins_env.evaluation.reproduction.paper import paper
from sins_env.evaluation.reproduction.pictures.common import save
from sins_env.evaluation.reproduction.running import run_tables
from sins_env.evaluation.reproduction.showing import markdown, terminal
from sins_env.evaluation.show.templates import check_jinja2
from sins_env.evaluation.store.store import Store
from sins_env.writing.files import write_text

FIGURES, PARTS = "figures", "tables"
HEAD = """# Published results, reproduced: some tables

Made by `sins-env reproduce` for the tables that were asked for; without a number it makes all of them, and the text around them.
Ours are over Monte Carlo runs, with 95 % intervals. "reproduced": the printed figure lies where so few records as it rests on
would put it; "in order only": it does not, but what differs significantly stands in the same order.
"""


def reproduce(given: Namespace, console: Console) -> int:
    """Make the missing runs, then print and write the tables; all of them together also make the paper.

    Raises:
        ValueError: an unknown table, no directory above ``--out``, or jinja2 is not installed.
    """
    numbers = list(dict.fromkeys(given.table)) or reproduction.printed()
    tables = [reproduction.get_table(number) for number in numbers]
    complete = set(numbers) >= set(reproduction.printed())
    out = Path(given.out)
    if not out.resolve().parent.is_dir():
        raise ValueError(f"--out {out}: the directory above it does not exist")
    if complete:
        check_jinja2()
    for folder in (out, out / FIGURES, out / PARTS):
        folder.mkdir(exist_ok=True)
    with Store(out / "results.sqlite") as store:
        made = run_tables(tables, store, given.runs, quick=given.quick, workers=given.workers)
        for table, outcomes, _ in made:
            console.print(terminal(table, outcomes))
            write_text(_part(out, table.number), markdown(table, outcomes))
        drawn = [one for _, _, pictures in made for one in pictures]
        with Bar(f"{len(drawn)} figures") as bar:
            for done, (picture, results) in enumerate(drawn):
                bar.update(done, len(drawn), note=picture.name)
                save(picture.draw(results), out / FIGURES / f"{picture.name}.svg")
        text = paper(made, store, given.quick) if complete else _some(out)
    write_text(out / "REPRODUCTION.md", text)
    remark(f"tables: {out / 'REPRODUCTION.md'}")
    return 0


def _some(out: Path) -> str:
    """Return every table that this command or an earlier one has written."""
    there = [_part(out, number) for number in reproduction.names()]
    return "\n".join([HEAD, *(part.read_text(encoding="utf-8") for part in there if part.exists())])


def _part(out: Path, number: str) -> Path:
    """Return the file of a table; each has its own, so that a later command for another table keeps it."""
    return out / PARTS / f"{number}.md"
