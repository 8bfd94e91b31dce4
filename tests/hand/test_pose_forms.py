"""The forms that the pose raises on the built-in hand's detailed surface."""

import numpy as np
import pytest
from livehand.backend.hand.gestures import FingerAxes, Gesture, theta_of
from livehand.backend.surface.detail_surface import PoseForm
from livehand.backend.teacher.detailed_surface import detailed_surface
from livehand.backend.teacher.frames import swap_distal, template_to_build
from livehand.backend.teacher.rays import build_rays

pytestmark = pytest.mark.nightly

MIDDLE_MCP = 4


@pytest.fixture(scope="module")
def surface(hand):
    return detailed_surface(hand, levels=2)


@pytest.fixture(scope="module")
def middle(surface):
    """The vertices in the coordinates of the middle finger."""
    return build_rays()["middle"].coordinates(swap_distal(template_to_build(surface.vertices_m)))


def relief_mm(surface, flexion=None, thumb=((0, 0, 0),) * 3):
    """[N] along the normals, of a gesture."""
    theta = theta_of(Gesture(flexion or {}, thumb=thumb).angles_deg(), FingerAxes.of_default_hand())
    return 1e3 * (surface.relief_m(theta) * surface.normals).sum(1)


def test_share_grows_with_the_bend_or_with_the_extension():
    bent = PoseForm(1, 20, 80, np.ones(3))
    assert [bent.share(angle) for angle in (0, 20, 50, 80, 120)] == [0, 0, 0.5, 1, 1]
    lifted = PoseForm(1, 0, -18, np.ones(3))
    assert [lifted.share(angle) for angle in (30, 0, -9, -18, -40)] == [0, 0, 0.5, 1, 1]


def test_rest_pose_has_no_forms(surface):
    np.testing.assert_array_equal(surface.relief_m(np.zeros((16, 3))), 0)


def test_a_bent_finger_shows_its_knuckle_between_two_hollows(surface, middle):
    relief = relief_mm(surface, {"middle": (90, 0, 0)})
    on_surface = (middle.distance < 1.5) & (middle.dorsal > 4)
    at_head = on_surface & (np.abs(middle.along - 1.5) < 2) & (np.abs(middle.lateral) < 1.5)
    beside = (middle.distance < 2) & (middle.dorsal > 3) & (np.abs(middle.along) < 3)
    beside &= np.abs(np.abs(middle.lateral) - 9.2) < 1.5
    assert 2.3 < relief[at_head].mean() < 3.6
    assert relief[beside].min() < -0.8
    far = middle.along > 40
    np.testing.assert_allclose(relief[far], 0, atol=0.02)


def test_a_lifted_finger_shows_its_tendon(surface, middle):
    relief = relief_mm(surface, {"middle": (-20, 0, 0)})
    on_back = (middle.distance < 2) & (middle.dorsal > 5) & (np.abs(middle.along + 25) < 8)
    ridge, beside = (np.abs(middle.lateral) < 1.0), (np.abs(np.abs(middle.lateral) - 6.5) < 1)
    assert relief[on_back & ridge].mean() > 0.9
    assert relief[on_back & beside].mean() < -0.2


def test_flesh_rises_beside_the_crease_of_a_bent_joint(surface, middle):
    joint = build_rays()["middle"].joints_along[1]
    relief = relief_mm(surface, {"middle": (0, 90, 0)})
    on_palm = (middle.distance < 1.5) & (middle.dorsal < -5)
    assert relief[on_palm & (np.abs(middle.along - joint) < 0.6)].mean() < -0.2
    assert relief[on_palm & (np.abs(middle.along - joint - 4.6) < 1)].mean() > 0.5


def test_veins_stand_out_in_a_clenched_hand(surface):
    flat, clenched = (
        np.zeros((16, 3)),
        theta_of(
            Gesture({finger: (80, 0, 0) for finger in ("index", "middle", "ring", "pinky")}).angles_deg(),
            FingerAxes.of_default_hand(),
        ),
    )
    vein = surface.masks["vein"].argmax()

    def height_mm(theta):
        with_veins, without = surface.relief_m(theta, 0.4), surface.relief_m(theta)
        return 1e3 * (with_veins - without)[vein] @ surface.normals[vein]

    strength = surface.masks["vein"][vein]
    assert height_mm(flat) == pytest.approx(0.3 * strength)
    assert height_mm(clenched) == pytest.approx(0.5 * strength, rel=0.01)


def test_forms_stay_small_and_local(surface):
    for form in surface.forms:
        assert np.abs(form.height_mm).max() < 4
        assert (np.abs(form.height_mm) > 0.05).mean() < 0.12, form.joint


def test_thumb_raises_two_tendons(surface):
    relief = relief_mm(surface, thumb=((-20, 0, 0), (0, 0, 0), (0, 0, 0)))
    ray = build_rays()["thumb"]
    thumb = ray.coordinates(swap_distal(template_to_build(surface.vertices_m)))
    at_base = (thumb.distance < 2) & (thumb.dorsal > 4) & (np.abs(thumb.along + ray.metacarpal - 8) < 5)
    assert relief[at_base].max() > 0.6
    assert relief[at_base].min() < -0.4
