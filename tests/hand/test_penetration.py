"""Depths against closed forms, and poses in which parts only touch."""

import numpy as np
import pytest
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
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


@pytest.mark.slow
def test_a_pose_is_relieved_by_few_degrees(parts, hand, axes):
    clenched = GESTURES["fist"].angles_deg() + np.array([6.0, 0, 0])
    assert deepest_mm(parts, hand, axes, clenched) > 2
    relieved = relieved_angles(parts, hand, clenched, axes)
    assert deepest_mm(parts, hand, axes, relieved) <= 0.8
    assert np.abs(relieved - clenched).max() < 25


def test_a_pose_that_touches_nothing_is_kept(parts, hand, axes):
    angles = GESTURES["relaxed"].angles_deg()
    np.testing.assert_array_equal(relieved_angles(parts, hand, angles, axes), angles)
