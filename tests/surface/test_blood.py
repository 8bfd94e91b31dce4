"""Where a pressed hand lacks blood: in its pads, and in the beds of the nails across from them."""

import numpy as np
import pytest
import torch
from livehand.backend.surface.blood import (
    PIGMENTED_LOG_ALBEDO,
    PLACE_LOG_ALBEDO,
    Blanching,
    JointBlood,
    place_log_albedo,
)
from livehand.backend.surface.curved_faces import CurvedFaces
from livehand.backend.surface.detail_maps_file import load_surface_detail
from livehand.backend.surface.detail_mesh import DetailTemplate
from livehand.backend.surface.detail_surface import load_detail_surface

PRESSED_M = 0.0008


@pytest.fixture(scope="module")
def template(hand):
    return DetailTemplate.of(load_detail_surface(hand.sha256), hand)


def test_half_of_what_can_leave_has_left_at_four_tenths_of_a_millimetre(hand, template):
    found = Blanching.of(np.full(len(hand.v_template), 0.0004), template).bloodless
    np.testing.assert_allclose(found, 0.3, atol=1e-5)


def test_a_pressed_fingertip_squeezes_its_own_nails_bed(hand, template):
    """Near the free edge most; other fingers, and the skin of the finger's back, keep their blood."""
    rest, weights = template.rest_vertices().numpy(), hand.lbs_weights[:, 3]
    middle = hand.v_template[weights > 0.5].mean(0)
    is_pad = (weights > 0.9) & (hand.v_template[:, 1] < middle[1] - 0.004)
    assert is_pad.sum() > 3
    found = Blanching.of(np.where(is_pad, PRESSED_M, 0.0), template)
    squeezed, place = found.under_nails.numpy(), rest - middle
    is_above = (np.abs(place[:, 2]) < 0.003) & (place[:, 1] > 0.003) & (np.linalg.norm(place, axis=1) < 0.012)
    along = hand.joints[3] - hand.joints[2]
    ahead_m = place @ along / np.linalg.norm(along)
    far, near = squeezed[is_above & (ahead_m > 0)].mean(), squeezed[is_above & (ahead_m < -0.005)].mean()
    assert far > 0.15
    assert far > near + 0.03
    assert squeezed[np.linalg.norm(place, axis=1) > 0.035].max() < 1e-3
    assert found.bloodless.numpy()[is_above].max() < 0.05


def test_what_is_not_pressed_keeps_its_blood(hand, template):
    found = Blanching.of(np.zeros(len(hand.v_template)), template)
    assert found.bloodless.max() == found.under_nails.max() == 0


def test_on_curved_faces_a_vertex_lacks_the_mean_of_what_its_edges_ends_lack(hand, template):
    faces = CurvedFaces.of(template)
    pressed = Blanching.of(np.linspace(0, PRESSED_M, len(hand.v_template)), template)
    found = pressed.on_curved(faces)
    for name in ("bloodless", "under_nails", "of_joints"):
        before, after = getattr(pressed, name), getattr(found, name)
        assert torch.equal(after[: len(before)], before)
        torch.testing.assert_close(after[len(before) :], before[faces.edges].mean(1))
    assert torch.equal(found.joint_log_albedo, pressed.joint_log_albedo)
    assert found.bloodless.max() > 0.3


@pytest.fixture(scope="module")
def joints(template):
    drains = np.full(len(template.offset_m), 80, np.uint8)
    return JointBlood.of({"drains": drains}, 0.0, "cpu")


def flex_of(hand, template, joint, angle_deg):
    bend = load_surface_detail(hand.sha256).bend
    theta = np.zeros((16, 3))
    theta[joint] = np.deg2rad(angle_deg) * bend.flexion[joint]
    flex = torch.as_tensor(bend.flex(theta), dtype=torch.float32)[:, None]
    for level in template.levels:
        flex = level(flex)
    return flex[:, 0]


def test_hands_at_rest_and_lifted_fingers_keep_the_blood_of_their_joints(hand, template, joints):
    for angle_deg in (0.0, -10.0, 15.0):
        assert joints.blanching(flex_of(hand, template, 2, angle_deg)) is None


def test_blood_leaves_a_joint_as_it_bends_and_others_keep_theirs(hand, template, joints):
    half, full = (joints.blanching(flex_of(hand, template, 2, angle)).of_joints for angle in (42.0, 90.0))
    rest = template.rest_vertices().numpy()
    around_m = np.linalg.norm(rest - hand.joints[2], axis=1)
    near, far = around_m < 0.010, np.linalg.norm(rest - hand.joints[5], axis=1) < 0.010
    assert full[near].median() == pytest.approx(0.8, abs=0.01)
    assert half[near].median() == pytest.approx(0.4, abs=0.05)
    assert full[far].max() == 0


def test_a_person_without_such_blood_has_none():
    assert JointBlood.of({}, 0.0, "cpu") is None


def test_under_pigment_blood_is_brown():
    light, deep = place_log_albedo(0.0), place_log_albedo(1.0)
    np.testing.assert_allclose(deep - light, PIGMENTED_LOG_ALBEDO, atol=1e-6)
    np.testing.assert_allclose(light, PLACE_LOG_ALBEDO, atol=1e-6)
