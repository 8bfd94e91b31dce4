"""What counts as unusual in the colours of a hand."""

import numpy as np
import pytest
from livehand.backend.evaluation.skin_colours import BACK, DEEP_SKIN, LIGHT_SKIN, colour_findings


def middle_of(ranges):
    """A hand whose every known coordinate is the middle of its range."""
    places = {}
    for place, usual in ranges.items():
        rows = (usual.l_star, usual.a_star, usual.b_star)
        places[place] = np.array([sum(row) / 2 if row else 0.0 for row in rows])
        if place != BACK:
            places[place] = places[place] + places[BACK]
    return places


@pytest.mark.parametrize("ranges", [LIGHT_SKIN, DEEP_SKIN])
def test_a_usual_hand_has_no_findings_and_each_place_can_be_found(ranges):
    places = middle_of(ranges)
    assert colour_findings(places) == []
    for place in ranges:
        odd = dict(places)
        odd[place] = places[place] + np.array([0, 40.0, 0]) if ranges[place].a_star else places[place] + 10.0
        found = colour_findings(odd)
        assert any(line.startswith(f"{place}:") for line in found)


def test_places_that_a_hand_lacks_are_left_out():
    places = middle_of(LIGHT_SKIN)
    del places["forearm"]
    assert colour_findings(places) == []


def test_without_its_back_a_hand_is_compared_with_nothing():
    places = middle_of(LIGHT_SKIN)
    del places[BACK]
    assert colour_findings(places) == []
