"""The library's poses: no fingertip deep inside the hand, nothing seen through a fist, straight fingers straight."""

import numpy as np
import pytest
import torch
from livehand.backend.field.rays import CameraTensors, project
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.poses import POSES
from livehand.backend.records.camera import look_at
from livehand.backend.records.shot import HandPose
from livehand.backend.surface.detail_mesh import first_fronts
from scipy.ndimage import binary_fill_holes

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


# Towards cameras around the thumb's web, along (distal, dorsal, radial) at rest.
AROUND_THE_WEB = ((0.75, 0.5, 0.5), (0.9, 0.3, 0.4), (0.5, 0.5, 0.8), (0.2, 0.6, 0.8), (0.75, 0.2, 0.7), (0.3, 0.2, 1))
MM_PER_PX, SIZE_PX = 0.4, 400


def seen_through_mm2(surface, towards):
    """How much of what is behind a surface is seen through it, with the hand all around, by parallel rays."""
    axes = axis_angle_to_matrix(np.array([0.2, -0.1, 0.3])) * (-1, 1, 1)  # of the fixture's hand
    on_digits = surface.faces[surface.bones.of_face > 0]
    centre = surface.vertices[on_digits].mean((0, 1)).double().numpy()
    cam2world = look_at(centre + axes @ np.array(towards), centre, axes[:, 0])
    K = torch.diag(torch.tensor([1000 / MM_PER_PX, 1000 / MM_PER_PX, 1.0]))
    K[:2, 2] = SIZE_PX / 2
    world2cam = torch.as_tensor(np.linalg.inv(cam2world), dtype=torch.float32)
    camera = CameraTensors(K, world2cam, (SIZE_PX, SIZE_PX), is_orthographic=True)
    shown = (first_fronts(surface, *project(camera, surface.vertices), camera).face >= 0).reshape(SIZE_PX, SIZE_PX)
    return (binary_fill_holes(shown) & ~shown.numpy()).sum() * MM_PER_PX**2


def test_a_fist_is_closed_around_the_thumbs_web(fine_hand):
    """Before index finger and thumb closed, 5 to 68 mm2 were seen through."""
    found = [seen_through_mm2(fine_hand("Fist"), towards) for towards in AROUND_THE_WEB]
    assert max(found) == 0, found


def test_a_ring_of_thumb_and_index_finger_is_seen_through(fine_hand):
    """By more than a circle of 15 mm."""
    assert seen_through_mm2(fine_hand("OK"), (0.0, 0.0, 1.0)) > 177


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
