"""Places in bones' frames: against the definition, and unchanged by a rigid motion or a mirror."""

import numpy as np
import pytest
import torch
from livehand.backend.geometry.bones import directions_in_bones, points_in_bones
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT
from livehand.backend.hand.posed_bones import bone_frames, check_on_pose
from livehand.backend.records.camera import Camera
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose, Shot


@pytest.fixture
def pose():
    theta = theta_of(GESTURES["fist"].angles_deg(), FingerAxes.of_default_hand(), np.array([0.2, -0.1, 0.3]))
    return HandPose(theta, np.zeros(10), np.array([0.1, 0.2, 0.3]))


def test_a_point_that_moves_with_a_bone_stays_in_its_frame(hand, pose):
    rest, frames = bone_frames(hand, HandPose.rest()), bone_frames(hand, pose)
    np.testing.assert_allclose(rest[:, :3, 3], hand.joints, atol=1e-12)
    np.testing.assert_allclose(rest[:, :3, :3], np.broadcast_to(np.eye(3), (16, 3, 3)), atol=1e-12)
    point = np.array([0.01, -0.02, 0.005])
    moved = frames[:, :3, :3] @ point + frames[:, :3, 3]
    found = points_in_bones(torch.as_tensor(moved), torch.as_tensor(frames))
    np.testing.assert_allclose(found[range(16), range(16)], np.tile(point, (16, 1)), atol=1e-12)


def test_the_root_turns_all_bones_with_it(hand, pose):
    turn = axis_angle_to_matrix(np.array([0.4, 0.3, -0.2]))
    frames = torch.as_tensor(bone_frames(hand, pose))
    points = torch.rand(5, 3, dtype=torch.float64)
    motion = torch.eye(4, dtype=torch.float64)
    motion[:3, :3], motion[:3, 3] = torch.as_tensor(turn), torch.tensor([0.3, -0.1, 0.2])
    moved = points @ motion[:3, :3].T + motion[:3, 3]
    torch.testing.assert_close(points_in_bones(moved, motion @ frames), points_in_bones(points, frames))
    directions = torch.rand(5, 1, 3, dtype=torch.float64).expand(5, 16, 3)
    torch.testing.assert_close(
        directions_in_bones(directions @ motion[:3, :3].T, motion @ frames), directions_in_bones(directions, frames)
    )


def test_the_other_hand_is_seen_as_its_mirror_image(hand, pose):
    left = HandPose(pose.theta * MIRROR_AXIS_ANGLE, pose.beta, pose.transl * MIRROR_POINT, "left")
    points = torch.rand(5, 3, dtype=torch.float64)
    mirrored = points * torch.as_tensor(MIRROR_POINT)
    ours, theirs = (torch.as_tensor(bone_frames(hand, one)) for one in (pose, left))
    torch.testing.assert_close(points_in_bones(mirrored, theirs), points_in_bones(points, ours))


def test_a_mesh_off_its_pose_is_refused(hand, pose):
    camera = Camera(np.eye(3), np.eye(4), (4, 4))
    vertices = posed_vertices(hand, pose)
    check_on_pose(Shot(pose, vertices + 0.0005, camera), hand)
    with pytest.raises(LiveHandError, match=r"1\.7 mm off"):
        check_on_pose(Shot(pose, vertices + 0.001, camera), hand)
