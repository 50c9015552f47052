"""benchmarks/markers.py: text of scripts between markers in a document."""

import runpy

import pytest
from places import ROOT

MARKERS = runpy.run_path(str(ROOT / "benchmarks" / "markers.py"))
DOCUMENT = "# A\n<!-- b:begin -->\nold\n<!-- b:end -->\ntail\n"


def test_only_what_stands_between_is_replaced_and_again_changes_nothing():
    once = MARKERS["replaced"](DOCUMENT, "b", "| new |\n\nlast\n")
    assert once == "# A\n<!-- b:begin -->\n\n| new |\n\nlast\n\n<!-- b:end -->\ntail\n"
    assert MARKERS["between"](once, "b") == "| new |\n\nlast"
    assert MARKERS["replaced"](once, "b", MARKERS["between"](once, "b")) == once


@pytest.mark.parametrize(
    "document", ["", DOCUMENT + DOCUMENT, DOCUMENT.replace("end", "fin"), "<!-- b:end --> <!-- b:begin -->"]
)
def test_markers_that_do_not_stand_once_each_in_order_are_refused(document):
    with pytest.raises(ValueError, match="needed once each, in this order: <!-- b:begin --> and <!-- b:end -->"):
        MARKERS["replaced"](document, "b", "text")
