"""The flesh between the metacarpals: it fills hollows of the back, more of some people's, and nothing beside them."""

import numpy as np
import pytest
from livehand.backend.surface.people.drawn_forms import drawn_padding_mm, rounded_valleys_mm, web_forms
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


def test_valleys_between_the_fingers_roots_become_round_and_all_else_stays(template, vertices):
    """By how far vertices lie below the mean of their neighbours."""
    flat = np.zeros(len(vertices.palm), np.float32)
    risen = rounded_valleys_mm(template, vertices, flat)
    along = vertices.from_joint_mm[:, 0]
    assert risen[(vertices.palm > 0.999) | vertices.is_thumb | (along > 27) | (along < -31)].max() == 0
    assert 1.0 < risen.max() <= 3.0
    assert 100 < (risen > 0.1).sum() < 1000
    rest_mm, normals = 1e3 * template.rest_vertices().numpy(), template.normals.numpy()
    faces, found = template.faces.numpy(), []
    for height in (flat, risen):
        points, sums, count = rest_mm + height[:, None] * normals, np.zeros_like(normals), np.zeros(len(flat))
        for corner in range(3):
            np.add.at(sums, faces[:, corner], points[faces[:, corner - 1]] - points[faces[:, corner]])
            np.add.at(count, faces[:, corner], 1)
        found.append(((sums / count[:, None]) * normals).sum(1)[(along > -10) & (along < 12) & (vertices.palm < 0.1)])
    before, after = (np.quantile(depth, 0.999) for depth in found)
    assert after < 0.5 * before


def test_what_is_raised_already_stays(template, vertices):
    raised = padding_mm(vertices, age=22.0, build=0.25)
    assert (rounded_valleys_mm(template, vertices, raised) >= raised - 1e-6).all()


def test_the_thumbs_web_rises_by_halves_with_the_thumb_and_the_index_finger(vertices):
    forms = web_forms(vertices)
    d, r = plane(vertices.points_mm).T
    by_joint = {joint: sum(form.height_mm for form in forms if form.joint == joint) for joint in (1, 14)}
    assert sum(form.height_mm.max() for form in forms) == pytest.approx(2 * by_joint[1].max(), rel=1e-5)
    assert 3 < by_joint[1].max() <= 5
    assert np.array_equal(by_joint[1], by_joint[14])
    highest = by_joint[1].argmax()
    assert 50 < d[highest] < 70
    assert 25 < r[highest] < 45
    assert by_joint[1][(r < 0) | (d < 20) | (d > 100)].max() < 0.05
    assert max(form.height_mm.max() for form in forms) < 3.1  # what a stored height can be
    assert all(form.share(0) == 0 and form.share(80) == 1 for form in forms)
