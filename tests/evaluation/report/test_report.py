"""The report says what the terminal says, from the results file alone, in one file that needs nothing else."""

import dataclasses
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from xml.etree import ElementTree

import numpy as np
import pytest

from sins_env.cli.main import main
from sins_env.evaluation.play.criteria import Criteria
from sins_env.evaluation.play.records import score
from sins_env.evaluation.report import page as report
from sins_env.evaluation.report import page_figures, page_tables, panel, svg
from sins_env.evaluation.score import ranking
from sins_env.evaluation.show import cells, footer, numbers
from sins_env.evaluation.speed.cost import Cost
from sins_env.evaluation.store.key import Key
from sins_env.evaluation.store.store import Store
from sins_env.evaluation.tasks.catalogue import get_task
from sins_env.evaluation.tasks.task import suite_hash
from sins_env.units import ARCSEC, DEG

TASK, UNSCORED = get_task("sway-white-v0"), get_task("rlg-car-v0")
CRITERIA = Criteria(0.1, 3600, 0, TASK.delta, np.radians([10.0, 10.0, 150.0]), 60.0)
NAMES = {"good": 700.0, "better": 500.0, "worst": 9_000.0, "evil:<script>alert(1)</script>": 900.0}
RUNS = 8


def records(azimuth, seed=0, runs=RUNS, criteria=CRITERIA):
    """Runs whose errors fall off to constants, spread evenly with the given azimuth RMS in arcsec."""
    rng = np.random.default_rng(seed)
    t = criteria.epoch_s * np.arange(1, criteria.num_epochs + 1)[:, None]
    size = 1 + 30 * np.exp(-t / (20 + 5 * rng.uniform(size=(runs, 1, 1))))
    even = np.linspace(-1.5, 1.5, runs)
    constants = rng.permuted(np.stack([even] * 3, axis=1)[:, None] / even.std(), axis=0)
    return score(constants * np.array([15.0, 15.0, azimuth]) * ARCSEC * size, None, criteria)


def failing(found):
    """Runs 0 to 2 raise at different times; run 3 was repaired."""
    status, reason = found.status.astype("<U8"), list(found.reason)
    status[:3] = "raised"
    reason[:3] = [f"step raised ValueError: <b>no root</b>, at {t} s" for t in ("10.0", "30.5", "20.0")]
    history = found.history.copy()
    history[:3, 10:] = np.nan
    return dataclasses.replace(
        found, status=status, reason=tuple(reason), repairs=np.eye(1, RUNS, 3, dtype=np.int64)[0] * 5, history=history
    )


def add(db, task, solver, found, cost=None, **settings):
    key = Key.of(task.name, suite_hash(task), solver, settings, "0.1+abc")
    db.add(key, found)
    if cost:
        db.add_cost(key, cost)


@pytest.fixture(scope="session")
def file(tmp_path_factory):
    """Two tasks; one of them has no reference."""
    path = tmp_path_factory.mktemp("report") / "r.sqlite"
    with Store(path) as db:
        db.add_task(TASK)
        for seed, (name, azimuth) in enumerate(NAMES.items()):
            found = records(azimuth, seed)
            add(db, TASK, name, failing(found) if name == "worst" else found, Cost(100.0, 150.0, 0.5 + seed))
        unscored = dataclasses.replace(CRITERIA, scored=False, coarse_epochs=900, known_start=False)
        found = dataclasses.replace(records(100.0, 7, 7, unscored), heading=1 + 0.01 * np.arange(7.0))
        add(db, UNSCORED, "good", found, Cost(100.0, 150.0, 0.5))
    with Store(path) as db:  # another session, of which one solver has settings
        add(db, TASK, "good", records(2000.0, 9), gain=2)
    return path


@pytest.fixture(scope="session")
def page(file):
    with Store(file, read_only=True) as db, pytest.MonkeyPatch.context() as patch:
        patch.setenv("SINS_ENV_DATA", "")  # a page needs no recording, though the file has runs of one
        return report.html_report(db, db.keys())


class Dom(HTMLParser):
    """Elements with their attributes, and the text of every table's rows."""

    def __init__(self, text):
        super().__init__()
        self.elements, self.tables, self.cell = [], [], None
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, dict(attrs)))
        if tag == "table":
            self.tables.append([])
        elif tag == "tr":
            self.tables[-1].append([])
        elif tag in ("td", "th"):
            self.tables[-1][-1].append("")
            self.cell = self.tables[-1][-1]
        elif tag == "small" and self.cell:
            self.cell[-1] += " "

    def handle_endtag(self, tag):
        self.cell = None if tag in ("td", "th") else self.cell

    def handle_data(self, data):
        if self.cell is not None:
            self.cell[-1] += data

    def values(self, name):
        return [attrs[name] for _, attrs in self.elements if name in attrs]


def test_one_file_that_needs_nothing(page):
    dom = Dom(page)
    assert not {"script", "iframe", "img", "object"} & {tag for tag, _ in dom.elements}
    assert all(link.startswith("#") or link == "data:," for link in [*dom.values("href"), *dom.values("src")])
    assert "http" not in page.replace("http-equiv", "")
    assert "@import" not in page
    assert sum(tag == "style" for tag, _ in dom.elements) == 1  # a figure's own would colour the whole page
    assert not [name for _, attrs in dom.elements for name in attrs if name.startswith("on")]


def test_identifiers_are_unique_and_lead_somewhere(page):
    dom = Dom(page)
    found = dom.values("id")
    assert len(found) == len(set(found))
    asked = [link[1:] for link in dom.values("href") if link.startswith("#")]
    asked += re.findall(r"url\(#([^)]*)\)", page)
    asked += [part for text in dom.values("aria-labelledby") for part in text.split()]
    assert len(asked) > 50
    assert set(asked) <= set(found)


def test_the_table_is_the_boards(file, page):
    with Store(file, read_only=True) as db:
        lines = ranking.ranked([db.results(key) for key in db.keys([TASK.name])])
    table = next(t for t in Dom(page).tables if t[0][:2] == ["#", "solver"])
    assert len(table) == 1 + len(lines) == 6
    for row, (rank, one) in zip(table[1:], lines, strict=True):
        s = one.summary
        told = {
            name: row[i]
            for i, text in enumerate(table[0])
            for name in ("x bound", "failed", "cost", "time")
            if text.startswith(name)
        }
        assert row[0] == str(rank or "-")
        assert row[1].startswith(one.solver.rpartition(":")[2])
        assert ("gain=2" in row[1]) == ("gain" in one.settings)
        assert row[2] == " ".join(cells.score(one)[:2]).strip()
        assert told["time"] == numbers.seconds_text(one.verdict.time_s)
        assert told["x bound"].startswith(cells.x_bound(one).value)
        assert (
            told["failed"]
            == f"{one.verdict.failures} of {s.runs} {numbers.percent_interval_text(one.verdict.failed_ci)}"
        )
        assert told["cost"] == cells.cost(one).value
    assert lines[0][1].solver == "better"
    for line in footer.footer([one for _, one in lines]).split("\n"):
        assert line.replace('"', "&#34;").replace("'", "&#39;") in page


def test_intervals_on_their_axis(file):
    """On a log axis from the least end to at most five times the median RMS; what is beyond is marked."""
    with Store(file, read_only=True) as db:
        lines = ranking.ranked([db.results(key) for key in db.keys([TASK.name])])
    task = panel.Lineup([one for _, one in lines], {}, "t")
    found = {row.name: row.whisker for row in page_tables.rows_of(lines, task)}
    ends = {one.label: np.full(3, one.verdict.score) for _, one in lines}  # too few runs for intervals
    low, usual = min(ci.min() for ci in ends.values()), np.median([ci[0] for ci in ends.values()])
    bound = task.bound.steady[2]
    low, top = min(low, bound), min(5 * usual, max(ci.max() for ci in ends.values()))
    for name in ("better", "good", "worst"):
        label = name if name != "good" else "good (gain=2)"  # the later line of that name
        expected = np.log(ends[label] / low) / np.log(top / low)
        np.testing.assert_allclose(found[name][:3], expected)
        assert found[name].bound == pytest.approx(np.log(bound / low) / np.log(top / low))
    assert found["worst"].value == 1 > found["better"].high
    few = [
        dataclasses.replace(one, told=dataclasses.replace(one.verdict, score=size))
        for (_, one), size in zip(lines, (1, 1, 1, 9), strict=False)
    ]
    assert page_tables.whiskers(few)(few[3]).value > 1  # beyond five times the median
    alone = page_tables.rows_of(lines[:1], panel.Lineup([lines[0][1]], {}, "t"))[0].whisker
    assert min(alone) == 0
    assert max(alone) == 1


def test_names_and_reasons_are_escaped(page):
    assert "<script>" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    assert "&lt;b&gt;no root&lt;/b&gt;" in page


def test_failures_are_grouped_by_reason(page):
    table = next(t for t in Dom(page).tables if t[0][0] == "solver")
    assert table[1:] == [
        ["worst", "3", "raised step raised ValueError: <b>no root</b>", "10–30.5", "0, 1, 2"],
        ["worst", "1", "repaired covariance repaired, 5 times in all", "", "3"],
    ]
    assert "No run failed" in page  # of the recording


def test_provenance(file, page):
    first, recording = (t for t in Dom(page).tables if t[0][0].startswith("begun"))
    assert [row[1:3] for row in first[1:]] == [["32", "0.1+abc"], ["8", "0.1+abc"]]
    assert [row[1] for row in recording[1:]] == ["7"]
    assert f"numpy {np.__version__}" in first[1][3]
    with Store(file, read_only=True) as db:
        (made,) = db.sessions(db.keys([UNSCORED.name])[0])
        assert f"<code>{db.digest_of(TASK.name)}</code>" in page
    assert first[1][0] == made.started
    assert suite_hash(TASK) in page
    assert first[1][4] == made.machine


def test_same_file_same_bytes(file, page, tmp_path):
    """In another process, too, whose sets and dictionaries hash otherwise."""
    command = [sys.executable, "-m", "sins_env.evaluation", "report", "--html", "r.html", "--db", str(file)]
    code = "import sys; from sins_env.cli.main import main; sys.exit(main(sys.argv[1:]))"
    command[1:3] = ["-c", code]
    done = subprocess.run(command, cwd=tmp_path, env={**os.environ, "PYTHONHASHSEED": "7"}, capture_output=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout == b""
    assert b"report: r.html, " in done.stderr
    assert (tmp_path / "r.html").read_text(encoding="utf-8") == page


def test_colours_are_the_pages(page):
    """Nothing is left in the colours that stand for variables; each variable is defined, in light and in dark."""
    assert not [colour for colour in svg.PAGE.values() if colour in page.lower()]
    light, dark = (
        set(re.findall(r"(--[\w-]+):", part)) for part in page.split("@media print")[0].split("@media (prefers")
    )
    used = set(re.findall(r"var\((--[\w-]+)\)", page)) - {"--c"}
    assert used <= light == dark
    drawn = "".join(re.findall(r'<svg [^>]*class="plot".*?</svg>', page, flags=re.S))
    assert set(re.findall(r"(?:fill|stroke):([^;\"]+)", drawn)) <= {"none", *(f"var({name})" for name in used)}


def test_a_recording_without_a_reference(file):
    with Store(file, read_only=True) as db:
        page = report.html_report(db, db.keys([UNSCORED.name]))
    table = next(t for t in Dom(page).tables if t[0][0] == "#")
    assert table[1][0] == "-"
    assert "heading spread" in table[0][-1]
    assert "The recording has no reference" in page
    assert "Spread against cost" in page
    assert "Error over time" not in page


def drawn(monkeypatch, results):
    """The Matplotlib axes of each figure, by title, and tooltips by gid."""
    out = {}

    def keep(figure, prefix, title, description, names):
        out[title] = figure.axes[0], names, description
        return ""

    monkeypatch.setattr(panel, "inline", keep)
    lines = [one for _, one in ranking.ranked(results)]
    looks = {one.label: panel.Look(i) for i, one in enumerate(lines[:-1])}
    captions = [d.caption for d in page_figures.drawings(panel.Lineup(lines, looks, "t"))]
    return out, lines, captions


def curve(axes, names, label):
    (line,) = (line for line in axes.lines if names.get(line.get_gid(), "").startswith(label))
    return line


def test_what_the_figures_draw(file, monkeypatch):
    with Store(file, read_only=True) as db:
        out, lines, captions = drawn(monkeypatch, [db.results(key) for key in db.keys([TASK.name])])
    assert len(out) == 7
    r = lines[0].records
    axes, names, told = out["Azimuth error over time"]
    line = curve(axes, names, "better")
    at = np.searchsorted(r.criteria.history_t, line.get_xdata())
    np.testing.assert_allclose(line.get_ydata(), np.sqrt((r.history[:, at, 2] ** 2).mean(axis=0)) / DEG, rtol=1e-5)
    assert line.get_xdata()[-1] == 360.0
    assert line.get_color() == svg.PAGE["look-0"]
    assert curve(axes, names, lines[-1].label).get_color() == svg.PAGE["other"]
    assert axes.get_ylim()[0] > 0.01
    bound = next(one for one in axes.lines if len(one.get_xdata()) == len(lines[0].bound.t))
    np.testing.assert_allclose(bound.get_ydata(), lines[0].bound.sigma[:, 2] / DEG)
    assert f"better {numbers.angle_text(lines[0].summary.rms['U'])}″" in told
    axes, names, said = out["Failed runs"]
    assert curve(axes, names, "better").get_ydata() == [100 * lines[0].verdict.failed]
    assert "better 0 of" in said
    line = curve(*out["Level error over time"][:2], "better")
    expected = np.sqrt((r.history[:, at, :2] ** 2).mean(axis=(0, 2))) / ARCSEC
    np.testing.assert_allclose(line.get_ydata(), expected, rtol=1e-5)
    assert "raised or were lost end there" in captions[0]

    line = curve(*out["Runs aligned by a time"][:2], "better")
    for t in (30.0, 60.0, 100.0, 300.0):
        i = np.searchsorted(line.get_xdata(), t, side="right") - 1
        assert line.get_ydata()[i] == pytest.approx(100 * (r.aligned_s <= t).mean())
    for title, unit, largest in (
        ("Convergence profile, azimuth", DEG, r.hold_max[:, 2]),
        ("Convergence profile, level", ARCSEC, r.hold_max[:, :2].max(axis=1)),
    ):
        line = curve(*out[title][:2], "better")
        x, y = line.get_xdata(), line.get_ydata()
        np.testing.assert_allclose(y, [100 * (largest <= one * unit).mean() for one in x])
    axes, names, _ = out["Error against cost"]
    line = curve(axes, names, "better")
    assert (line.get_xdata()[0], line.get_ydata()[0]) == (1.5, lines[0].verdict.score / DEG)
    assert not [one for one in names.values() if "gain=2" in one]  # its cost was not measured


def test_the_front():
    points = [(2.0, 3.0), (1.0, 5.0), (3.0, 4.0), (4.0, 1.0), (4.0, 2.0)]
    assert page_figures.pareto_front(points) == [(1.0, 5.0), (2.0, 3.0), (4.0, 1.0)]


def test_forty_solvers_stay_small(tmp_path):
    """Eight tasks of forty solvers below 10 MB; the best in colour, each told apart, and the others grey."""
    with Store(tmp_path / "r.sqlite") as db:
        for i in range(40):
            add(db, TASK, f"s{i:02}", records(300.0 + 40 * i, i, 4), Cost(100.0, 150.0, 1.0 + i))
        page = report.html_report(db, db.keys())
    assert len(page.encode()) < 10e6 / 8
    dom = Dom(page)
    assert len(next(t for t in dom.tables if t[0][0] == "#")) == 41
    assert "32 more" in page
    looks = [panel.Look(i) for i in range(32)]
    assert len({(one.name, one.dash) for one in looks}) == 32
    assert len({one.marker for one in looks[:8]}) == len({one.name for one in looks[:8]}) == 8


def test_svg_of_a_figure():
    from matplotlib.figure import Figure

    figure = Figure(figsize=(200 / 72, 100 / 72), dpi=72)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, 200), ylim=(0, 100))
    axes.axis("off")
    axes.plot([10, 50, 123.456], [20, 80, 40], color=svg.PAGE["look-3"], gid="a")
    axes.text(100, 50, "a < b", color=svg.PAGE["ink"])
    texts = [svg.inline(figure, prefix, "title & more", "what", {"a": "<one>"}) for prefix in ("p", "p", "q")]
    assert texts[0] == texts[1] == texts[2].replace("q-", "p-")
    root = ElementTree.fromstring(texts[0])
    assert [root.get(name) for name in ("width", "height", "viewBox")] == ["200", "100", "0 0 200 100"]
    assert [(e.tag, e.text, e.get("id")) for e in root[:2]] == [
        ("title", "title & more", "p-t"),
        ("desc", "what", "p-d"),
    ]
    (named,) = root.iterfind(".//g[@class='named']")
    assert named.find("title").text == "<one>"
    path = named.find("path")
    assert path.get("d") == "M10 80L50 20L123.5 60"
    assert "stroke:var(--look-3)" in path.get("style")
    (text,) = root.iter("text")
    assert (text.text, "font-family" in texts[0]) == ("a < b", False)
    assert "fill:var(--ink)" in text.get("style")


def test_command_line(file, tmp_path, capsys, monkeypatch):
    def error(*arguments):
        assert main(["report", *arguments]) == 2
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        return said

    target = tmp_path / "r.html"
    assert "--html" in error("--db", str(file))
    assert "did you mean 'sway-white-v0'?" in error("--html", str(target), "--db", str(file), "--task", "sway-whit-v0")
    assert "the directory does not exist" in error("--html", str(tmp_path / "no" / "r.html"), "--db", str(file))
    with Store(tmp_path / "empty.sqlite"):
        pass
    assert "no results yet" in error("--html", str(target), "--db", str(tmp_path / "empty.sqlite"))
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "jinja2", None)
        assert 'pip install "sins-env[report]"' in error("--html", str(target), "--db", str(file))
    assert not target.exists()
    assert main(["report", "--html", str(target), "--db", str(file), "--task", TASK.name, "--solver", "better"]) == 0
    page = target.read_text(encoding="utf-8")
    assert "1 task, 1 solver,\n8 runs." in page
    assert UNSCORED.name not in page
