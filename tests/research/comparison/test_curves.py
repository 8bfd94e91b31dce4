"""Curves: where points lie, and that names are text."""

import re
import xml.etree.ElementTree as ElementTree

from livehand.backend.research.comparison.page import svg_curves


def test_curves_span_the_drawing():
    drawing = svg_curves({"a <b>": [(2.0, -4.0), (0.0, 0.0)], "lonely": [(1.0, 1.0)]}, "mm", "dB")
    root = ElementTree.fromstring(drawing)
    circles = [e for e in root if e.tag.endswith("circle")]
    points = [(float(c.get("cx")), float(c.get("cy"))) for c in circles]
    assert len(points) == 2
    assert points[0][0] < points[1][0]
    assert points[0][1] < points[1][1]  # a loss lies lower
    assert "a <b>" in [e.text for e in root]
    assert "lonely" not in drawing
    assert re.search(r"viewBox=\"0 0 \d+ \d+\"", drawing)
    assert svg_curves({"lonely": [(1.0, 1.0)]}, "mm", "dB") == ""
