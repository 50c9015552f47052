"""The report in a real Chromium: on a phone and a desktop, light and dark, with and without JavaScript."""

import re

import pytest
from evaluation.report.browser import Browser
from evaluation.report.test_report import file, page  # noqa: F401  fixtures

PHONE, DESKTOP = 390, 1280
#: Every figure, swatch and interval: its drawn size, and what its attributes say.
SVGS = """[...document.querySelectorAll('svg')].map(e => { const b = e.getBoundingClientRect(); return {
  plot: e.classList.contains('plot'), width: b.width, height: b.height, left: b.left, right: b.right,
  shown: getComputedStyle(e.parentElement).display != 'none', sized: e.hasAttribute('width') && e.hasAttribute('height') &&
  e.hasAttribute('viewBox'), named: !e.classList.contains('plot') || (!!e.querySelector('title').textContent &&
  e.getAttribute('aria-labelledby').split(' ').every(id => document.getElementById(id))) } })"""
#: What is written over what: relative luminance of text and of the first opaque background behind it.
CONTRASTS = """(() => {
  const of = text => { const [r, g, b, a] = text.match(/[0-9.]+/g).map(Number); return {a: a ?? 1, l: [r, g, b]
    .map(v => v / 255).map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4)
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0)} };
  const out = {};
  for (const e of document.querySelectorAll('h1, h2, h3, p, small, td, th, li, a, b, td span, .muted, svg text')) {
    const style = getComputedStyle(e); let back = e;
    while (back && of(getComputedStyle(back).backgroundColor).a < 1) back = back.parentElement;
    const colours = [of(e.tagName == 'text' ? style.fill : style.color).l,
      back ? of(getComputedStyle(back).backgroundColor).l : 1];
    const name = e.tagName + '.' + e.getAttribute('class');
    const ratio = (Math.max(...colours) + 0.05) / (Math.min(...colours) + 0.05);
    out[name] = Math.min(out[name] ?? 99, ratio);
  }
  return out })()"""
TABLE = """[...document.querySelector('table.board').tBodies[0].rows].map(r => [r.cells[0].innerText,
  r.cells[1].innerText, r.cells[2].querySelector('span').innerText])"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with Browser(tmp_path_factory.mktemp("browser")) as found:
        yield found


@pytest.fixture(scope="module")
def url(page, tmp_path_factory):  # noqa: F811
    path = tmp_path_factory.mktemp("page") / "report.html"
    path.write_text(page, encoding="utf-8")
    return path.as_uri()


def arcsec(text):
    return float(text.rstrip('°"').replace(",", "")) * (3600 if text.endswith("°") else 1)


@pytest.mark.parametrize("scripts", [True, False], ids=["", "no-scripts"])
@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
@pytest.mark.parametrize("width", [PHONE, DESKTOP], ids=["phone", "desktop"])
def test_in_chromium(browser, url, width, dark, scripts):
    with browser.page(url, width, dark=dark, scripts=scripts) as shown:
        assert shown.log == []
        assert [request for request in shown.requests if not request.startswith("data:")] == [url]
        assert shown.value("innerWidth") == width
        assert shown.value("document.documentElement.scrollWidth") <= width

        figures = shown.value(SVGS)
        assert sum(one["plot"] for one in figures) == 8
        for one in figures:
            assert one["sized"]
            assert one["named"]
            assert not one["shown"] or min(one["width"], one["height"]) > 0
            if one["plot"]:
                assert one["width"] > 300
                assert one["width"] / one["height"] == pytest.approx(400 / 290, rel=0.01)
                assert 0 <= one["left"] < one["right"] <= width

        ranks, names, scores = zip(*shown.value(TABLE), strict=True)
        assert names[0] == "better"
        assert len(names) == 5
        assert set(ranks) == {"-"}  # too few runs
        assert [arcsec(one) for one in scores] == sorted(arcsec(one) for one in scores)

        back = [int(v) for v in re.findall(r"\d+", shown.value("getComputedStyle(document.body).backgroundColor"))]
        assert (max(back) < 60) if dark else (min(back) > 240)
        low = {name: ratio for name, ratio in shown.value(CONTRASTS).items() if ratio < 4.5}
        assert low == {}


def test_text_of_figures_is_readable_on_a_phone(browser, url):
    with browser.page(url, PHONE) as shown:
        heights = shown.value("[...document.querySelectorAll('.plot text')].map(e => e.getBoundingClientRect())"
                              ".map(b => Math.min(b.width, b.height))")  # fmt: skip
        assert len(heights) > 60
        assert sorted(heights)[len(heights) // 20] > 5.0  # of a single digit the width is less than the height
        size = shown.value("(e => parseFloat(getComputedStyle(e).fontSize) * e.ownerSVGElement.getBoundingClientRect()"
                           ".width / 400)(document.querySelector('.plot text'))")  # fmt: skip
        assert size > 9.5


def test_texts_of_a_figure_do_not_overlap_and_stay_inside(browser, url):
    script = """[...document.querySelectorAll('.plot')].flatMap(plot => {
      const box = plot.getBoundingClientRect(), texts = [...plot.querySelectorAll('text')].map(e => [e.textContent,
        e.getBoundingClientRect()]);
      return texts.flatMap(([a, p], i) => [
        ...(p.left < box.left - 1 || p.right > box.right + 1 || p.bottom > box.bottom + 1 ? [a + ' is cut off'] : []),
        ...texts.slice(i + 1).filter(([b, q]) => p.left < q.right - 1 && q.left < p.right - 1 && p.top < q.bottom - 2 &&
          q.top < p.bottom - 2).map(([b]) => a + ' over ' + b)]) })"""
    with browser.page(url, PHONE) as shown:
        assert shown.value(script) == []


def test_the_browser_sees_faults(browser, tmp_path):
    """What the tests above look at can go wrong, and is seen then."""
    path = tmp_path / "bad.html"
    body = "<div style='width:700px'>wide</div><script>console.error('oh'); missing()</script><img src=none.png>"
    path.write_text(f"<!DOCTYPE html><meta name=viewport content='width=device-width, initial-scale=1'>{body}")
    with browser.page(path.as_uri(), PHONE) as shown:
        assert shown.value("document.documentElement.scrollWidth") > 700
        assert len(shown.log) >= 3
        assert any(request.endswith("none.png") for request in shown.requests)
    with browser.page(path.as_uri(), PHONE, scripts=False) as shown:
        assert not any("Uncaught" in text for text in shown.log)
