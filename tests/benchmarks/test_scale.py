"""benchmarks/scale.py: the model, and the figures in docs/scale.md, which are those of the kept result."""

import json
import runpy

import pytest
from places import ROOT

RESULT = json.loads((ROOT / "benchmarks" / "scale.json").read_text())


@pytest.fixture(scope="module")
def scale():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "benchmarks")
        yield runpy.run_path(str(ROOT / "benchmarks" / "scale.py"))


def test_the_page_says_what_was_measured(scale):
    page = scale["DOC"].read_text()
    assert scale["replaced"](page, scale["MARKS"], scale["told"](RESULT)) == page


def test_the_model(scale):
    """Workers count until the one process that writes, or its line, has no time left."""
    parcel = {"run_ms": 10.0, "pickle_us_per_run": 0.0, "unpickle_us_per_run": 10.0, "bytes_per_run": 1000.0}
    trip = {"dask": {"cpu_us": 0.0}, "dask, all at once": {"cpu_us": 2560.0}}
    found = {"parcel": parcel, "round_trip": trip, "rows": {"write": {"cpu_us": 80.0}}}
    one, ten, hundred, thousand = scale["modelled"](found)
    assert [row["runs_per_s"] for row in (one, ten, hundred)] == pytest.approx([100.0, 1000.0, 10_000.0])
    assert (hundred["writer_busy"], hundred["first_s"]) == pytest.approx((1.0, 2.56))  # 100 us a run
    assert (thousand["limit"], thousand["runs_per_s"]) == ("writer", pytest.approx(10_000.0))
    parcel["bytes_per_run"] = 1e6
    assert scale["modelled"](found)[-1]["limit"] == "line"
    assert scale["modelled"](found)[-1]["runs_per_s"] == pytest.approx(125.0)
    assert scale["modelled"](found, 1e6)[-1]["limit"] == "workers"
