"""The progress display is one line whatever the terminal, and says nothing before there is something to say."""

import io

import pytest
from rich.console import Console

from sins_env.evaluation.play.progress import Bar

LABEL = "filterpy_ukf on sway-told-wrong-v0 (3/4)"


def shown(width, label=LABEL, updates=((1000.0, 36000.0), (2400.0, 36000.0), (36000.0 / 2, 36000.0)), note=""):
    """Lines of the display, after these updates ten seconds apart."""
    console = Console(file=io.StringIO(), width=width, force_terminal=True, color_system=None)
    now = [0.0]  # moves by hand
    bar = Bar(label, console=console, clock=lambda: now[0])
    for done, total in updates:
        now[0] += 10.0
        bar.update(done, total, note)
    console.print(bar)
    return [line.rstrip() for line in console.file.getvalue().splitlines()]


@pytest.mark.parametrize("width", [60, 80, 100, 140])
def test_one_line(width):
    (line,) = shown(width, note="azimuth   -1.234 deg")
    assert len(line) <= width
    for part in ("filterpy_ukf on sway", "50%", "x ", "left"):
        assert part in line
    assert ("azimuth   -1.234 deg" in line) == (width >= 100)
    assert ("real time" in line) is False


def test_a_short_label_leaves_room_for_the_note():
    (line,) = shown(80, "ckf on rlg-car-v0", note="azimuth   -1.234 deg")
    assert line.endswith("azimuth   -1.234 deg")


def test_a_very_long_label_is_cut_not_the_time_left():
    (line,) = shown(80, "package.module.with.a.long.path:AnEstimatorWithALongName on sway-told-wrong-v0 (3/4)")
    assert len(line) <= 80
    assert line.endswith(" left")
    assert "…" in line


def test_nothing_silly_before_the_first_update():
    (line,) = shown(80, updates=())
    assert line.startswith(LABEL)
    for part in ("left", "%", "x ", "-:--", "·", "?"):
        assert part not in line.removeprefix(LABEL)


def test_a_rate_below_one_is_not_shown():
    (line,) = shown(80, updates=((0.5, 2.0), (1.0, 2.0)))
    assert "0x" not in line
