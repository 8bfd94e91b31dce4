"""Depths against closed forms, and poses in which parts only touch."""

import numpy as np
import pytest
import trimesh
from livehand.backend.hand import penetration
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.joint_limits import FREE, LIMITS
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.penetration import HandParts, relieved_angles
from livehand.backend.hand.poses import POSES
from livehand.backend.records.shot import HandPose


@pytest.fixture(scope="module")
def parts(hand):
    return HandParts(hand)


@pytest.fixture(scope="module")
def axes():
    return FingerAxes.of_default_hand()


def deepest_mm(parts, hand, axes, angles_deg):
    pose = HandPose(theta_of(angles_deg, axes), np.zeros(10), np.zeros(3))
    return 1000 * parts.contacts(posed_vertices(hand, pose)).deepest_m


def test_nothing_touches_at_rest(parts, hand):
    assert parts.contacts(hand.v_template).deepest_m == 0


def test_a_finger_that_is_pushed_into_its_neighbour_is_the_deeper_the_farther_it_is_pushed(parts, hand):
    is_index = (hand.lbs_weights[:, 1:4].sum(1) > 0.5)[:, None]
    pushed_mm = (8, 12, 14, 16, 18, 20)
    depths_mm = [
        1000 * parts.contacts(hand.v_template - is_index * np.array([0, 0, push / 1000])).deepest_m
        for push in pushed_mm
    ]
    assert depths_mm[0] == depths_mm[1] == 0  # the gap
    assert 0 < depths_mm[2] < depths_mm[3] < depths_mm[4] < depths_mm[5]
    assert (np.diff(depths_mm[2:]) <= 2).all()  # by no more than the push


def test_the_gap_of_a_contact_is_its_depth_and_opens_along_the_way_out(parts, hand):
    is_index = (hand.lbs_weights[:, 1:4].sum(1) > 0.5)[:, None]
    vertices = hand.v_template + is_index * np.array([0, 0, -0.018])
    contacts = parts.contacts(vertices)
    assert len(contacts.vertices) > 3
    np.testing.assert_allclose(contacts.gaps_m(vertices), -contacts.depth_m, atol=1e-9)
    moved = np.repeat(vertices[None], len(contacts.vertices), 0)
    rows = np.arange(len(contacts.vertices))
    moved[rows, contacts.vertices] += contacts.depth_m[:, None] * contacts.out
    np.testing.assert_allclose(contacts.gaps_m(moved)[rows, rows], 0, atol=1e-9)


@pytest.mark.parametrize("name", GESTURES)
def test_gestures_touch_at_most(parts, hand, axes, name):
    assert deepest_mm(parts, hand, axes, GESTURES[name].angles_deg()) <= 1.0


@pytest.mark.parametrize("name", POSES)
def test_the_librarys_poses_touch_at_most(parts, hand, axes, name):
    assert deepest_mm(parts, hand, axes, POSES[name].gesture.angles_deg()) <= 1.0


def gap_mm(hand, positions, finger):
    """Between the surfaces of a finger and of the thumb: from the nearest vertices of each to the other's triangles."""
    joint = hand.lbs_weights.argmax(1)
    part = np.where(joint == 0, 5, (joint - 1) // 3)
    gaps = []
    for one, other in ((finger, 4), (4, finger)):
        corners = positions[hand.f[(part[hand.f] == one).all(1)]]
        points = positions[part == other]
        distance = np.linalg.norm(points[:, None] - corners.mean(1), axis=-1)
        for row in distance.min(1).argsort()[:25]:
            near = corners[distance[row].argsort()[:40]]
            closest = trimesh.triangles.closest_point(near, np.broadcast_to(points[row], (len(near), 3)))
            gaps.append(np.linalg.norm(closest - points[row], axis=1).min())
    return 1000 * min(gaps)


@pytest.mark.parametrize(
    "name", ["OK", "Lateral", "Palmar Pinch", "Tip Pinch", "Writing Tripod", "Tripod", "Prismatic 4 Finger", "pinch"]
)
def test_thumb_and_index_finger_touch_in_pinches(hand, axes, name):
    gesture = POSES[name].gesture if name in POSES else GESTURES[name]
    pose = HandPose(theta_of(gesture.angles_deg(), axes), np.zeros(10), np.zeros(3))
    assert gap_mm(hand, posed_vertices(hand, pose), 0) <= 1.0


def test_the_gap_between_index_finger_and_thumb_falls_by_the_push(hand):
    """At rest; the finger is pushed along the line to the thumb's nearest vertex."""
    joint = hand.lbs_weights.argmax(1)
    is_index, is_thumb = (joint >= 1) & (joint <= 3), joint >= 13
    between = hand.v_template[is_thumb][:, None] - hand.v_template[is_index]
    row, column = np.unravel_index(np.linalg.norm(between, axis=-1).argmin(), between.shape[:2])
    pushed = hand.v_template + 0.25 * between[row, column] * is_index[:, None]
    assert gap_mm(hand, pushed, 0) == pytest.approx(0.75 * gap_mm(hand, hand.v_template, 0), rel=0.05)


@pytest.mark.slow
def test_a_pose_is_relieved_by_few_degrees(parts, hand, axes):
    clenched = GESTURES["fist"].angles_deg() + np.array([6.0, 0, 0])
    assert deepest_mm(parts, hand, axes, clenched) > 2
    relieved = relieved_angles(parts, hand, clenched, axes)
    assert deepest_mm(parts, hand, axes, relieved) <= 0.8
    assert np.abs(relieved - clenched).max() < 25


@pytest.mark.slow
def test_limits_are_kept_and_what_is_given_beyond_them_goes_no_farther(parts, hand, axes):
    clenched = GESTURES["fist"].angles_deg() + np.array([6.0, 0, 0])
    flat = clenched.ravel()
    flat[9] = 104.0  # the flexion of the middle finger's knuckle, at most 100
    limits = np.rad2deg(LIMITS)
    relieved = relieved_angles(parts, hand, clenched, axes).ravel()[FREE]
    assert (relieved >= np.minimum(limits[:, 0], flat[FREE]) - 1e-9).all()
    assert (relieved <= np.maximum(limits[:, 1], flat[FREE]) + 1e-9).all()
    tight = np.stack([flat[FREE] - 0.5, flat[FREE] + 0.5], 1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(penetration, "LIMITS", np.deg2rad(tight))
        assert np.abs(relieved_angles(parts, hand, clenched, axes).ravel() - flat).max() < 0.5 + 1e-9


@pytest.mark.slow
def test_of_long_steps_the_best_is_returned(parts, hand, axes, monkeypatch):
    seen_mm = []

    class WatchedParts(HandParts):
        def contacts(self, positions):
            contacts = super().contacts(positions)
            seen_mm.append(1000 * contacts.deepest_m)
            return contacts

    for name, value in (("_LARGEST_STEP_DEG", 60.0), ("_STIFFNESS_M", 1e-6), ("_STEPS", 4)):
        monkeypatch.setattr(penetration, name, value)
    clenched = GESTURES["fist"].angles_deg() + np.array([6.0, 0, 0])
    relieved = relieved_angles(WatchedParts(hand), hand, clenched, axes)
    assert seen_mm[-1] > min(seen_mm) + 0.1
    assert deepest_mm(parts, hand, axes, relieved) == pytest.approx(min(seen_mm), abs=1e-6)


def test_a_pose_that_touches_nothing_is_kept(parts, hand, axes):
    angles = GESTURES["relaxed"].angles_deg()
    np.testing.assert_array_equal(relieved_angles(parts, hand, angles, axes), angles)
