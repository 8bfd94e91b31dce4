"""The flesh between the metacarpals: it fills hollows of the back, more of some people's, and nothing beside them."""

import numpy as np
import pytest
from livehand.backend.surface.people.drawn_forms import drawn_padding_mm
from livehand.backend.surface.people.hand_chart import HandChart
from livehand.backend.surface.people.look import PersonLook
from livehand.backend.surface.people.skin_lines import plane

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def vertices(template):
    return HandChart.at_vertices(template)


def padding_mm(vertices, **numbers):
    return drawn_padding_mm(vertices, PersonLook.of(3, numbers))


def test_hollows_between_the_metacarpals_are_filled_and_their_heads_are_not(vertices):
    """Across the back before the knuckles: crests and hollows by their own heights."""
    found = padding_mm(vertices, age=22.0, build=0.25)
    d, r = plane(vertices.points_mm).T
    row = (np.abs(d - 71) < 2) & (vertices.points_mm[:, 1] > 5) & (r > -30) & (r < 25)
    on_heads = row & (np.abs(r - 4.5) < 2)
    in_hollow = row & (np.abs(r + 5) < 1.5)
    assert found[in_hollow].mean() > 0.4
    assert found[on_heads].mean() < 0.1
    height = vertices.points_mm[:, 1]
    before, after = (height[on_heads].mean() - (height + more)[in_hollow].mean() for more in (0, found))
    assert after < before - 0.4
    assert after > 0  # flesh does not stand out


def test_palm_digits_arm_and_edges_have_none(vertices):
    found = padding_mm(vertices, age=22.0, build=0.25)
    d, r = plane(vertices.points_mm).T
    for beside in (vertices.palm > 0.9, vertices.on_digit > 0.9, d < 0, r > 27, r < -34):
        assert found[beside].max() < 0.02
    assert 0.5 < found.max() < 2.5


def test_old_people_have_none(vertices):
    assert padding_mm(vertices, age=85.0, build=0.5).max() == 0
