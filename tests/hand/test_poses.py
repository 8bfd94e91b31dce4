"""The library's poses: no fingertip deep inside the hand, straight fingers straight, joints within what hands do."""

import numpy as np
import pytest
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.poses import POSES
from livehand.backend.records.shot import HandPose

pytestmark = pytest.mark.slow

# Flesh gives way: a fingertip pressed on the hand may overlap it by twice this before it counts as inside.
SKIN_M = 0.004
TIP_JOINTS = (3, 6, 9, 12, 15)


def vertex_normals(vertices, faces):
    across = np.cross(*(vertices[faces[:, k]] - vertices[faces[:, 0]] for k in (1, 2)))
    normals = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(normals, faces[:, corner], across)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True)


def winding_numbers(points, vertices, faces):
    """How many times the closed surface goes round each point: solid angles of its triangles (van Oosterom 1983)."""
    a, b, c = (vertices[faces[:, k]] - points[:, None] for k in range(3))
    la, lb, lc = (np.linalg.norm(corner, axis=-1) for corner in (a, b, c))
    above = (a * np.cross(b, c)).sum(-1)
    below = la * lb * lc + (a * b).sum(-1) * lc + (b * c).sum(-1) * la + (c * a).sum(-1) * lb
    return np.arctan2(above, below).sum(1) / (2 * np.pi)


def fingertips_inside(angles_deg):
    """How many vertices of the fingertips lie inside another part of the hand, though moved inwards by SKIN_M."""
    model = load_default_hand()
    theta = theta_of(angles_deg, FingerAxes.of_default_hand())
    vertices = posed_vertices(model, HandPose(theta, np.zeros(10), np.zeros(3)))
    tips = np.flatnonzero(np.isin(model.lbs_weights.argmax(1), TIP_JOINTS))
    inner = vertices[tips] - SKIN_M * vertex_normals(vertices, model.f)[tips]
    return int((winding_numbers(inner, vertices, model.f) > 1.5).sum())


@pytest.mark.parametrize("name", POSES)
def test_no_fingertip_goes_into_the_hand(name):
    assert fingertips_inside(POSES[name].gesture.angles_deg()) <= 12


def test_a_thumb_through_the_palm_is_found():
    angles = POSES["Fist"].gesture.angles_deg()
    angles[12, 1] -= 20
    assert fingertips_inside(angles) > 25


def test_the_library_is_large_and_every_pose_has_its_words():
    assert len(POSES) >= 24
    for name, pose in POSES.items():
        assert name[0].isupper()
        assert pose.catalog in ("Basic", "Gestures", "Counting", "Grasps")
        assert pose.description
        assert ("GRASP" in pose.description) == (pose.catalog == "Grasps")


def test_poses_differ_from_each_other():
    """One counts as the pointing hand does."""
    poses = [pose.gesture.angles_deg() for name, pose in POSES.items() if name != "One"]
    for k, angles in enumerate(poses):
        assert all(np.abs(angles - other).max() >= 2 for other in poses[:k])


def test_counting_holds_up_as_many_fingers():
    for count, name in enumerate(("One", "Two", "Three", "Four"), start=1):
        flexion = POSES[name].gesture.angles_deg()[:12, 0].reshape(4, 3).sum(1)
        assert (flexion < 0).sum() == count
