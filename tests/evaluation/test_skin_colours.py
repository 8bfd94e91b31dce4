"""Lab by published values, and what counts as unusual."""

import numpy as np
import pytest
from livehand.backend.evaluation.skin_colours import BACK, DEEP_SKIN, LIGHT_SKIN, colour_findings, lab


@pytest.mark.parametrize(
    ("rgb", "expected"),
    [
        ((1, 1, 1), (100, 0, 0)),
        ((0, 0, 0), (0, 0, 0)),
        ((1, 0, 0), (53.24, 80.09, 67.20)),
        ((0, 1, 0), (87.73, -86.18, 83.18)),
        ((0, 0, 1), (32.30, 79.19, -107.86)),
        ((0.18, 0.18, 0.18), (49.50, 0, 0)),
    ],
)
def test_primaries_have_their_published_lab(rgb, expected):
    np.testing.assert_allclose(lab(np.array(rgb, float)), expected, atol=0.03)


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
