"""What counts as unusual in the colours of a hand."""

import numpy as np
import pytest
from livehand.backend.evaluation.skin_colours import BACK, DEEP_SKIN, LIGHT_SKIN, colour_findings


def middle_of(ranges):
    """A hand whose every known coordinate is the middle of its range."""
    points = {}
    for place, usual in ranges.items():
        rows = (usual.l_star, usual.a_star, usual.b_star)
        points[place] = np.array([sum(row) / 2 if row else 0.0 for row in rows])
        if place != BACK:
            points[place] = points[place] + points[BACK]
    return points


@pytest.mark.parametrize("ranges", [LIGHT_SKIN, DEEP_SKIN])
def test_a_usual_hand_has_no_findings_and_each_place_can_be_found(ranges):
    points = middle_of(ranges)
    assert colour_findings(points) == []
    for place in ranges:
        odd = dict(points)
        odd[place] = points[place] + np.array([0, 40.0, 0]) if ranges[place].a_star else points[place] + 10.0
        found = colour_findings(odd)
        assert any(line.startswith(f"{place}:") for line in found)


def test_places_that_a_hand_lacks_are_left_out():
    points = middle_of(LIGHT_SKIN)
    del points["forearm"]
    assert colour_findings(points) == []


def test_without_its_back_a_hand_is_compared_with_nothing():
    points = middle_of(LIGHT_SKIN)
    del points[BACK]
    assert colour_findings(points) == []
