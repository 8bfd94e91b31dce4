"""Poses and the one shape come back from landmarks that lie beside the model's joints."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.hand.lbs import posed_arrays
from livehand.backend.person.rig.landmark_pose import landmark_poses, landmark_targets
from livehand.backend.person.rig.rig_cameras import RigCameras

pytestmark = pytest.mark.slow


def test_poses_come_back_from_noisy_landmarks(made_rig):
    found = landmark_poses(made_rig.found(1.0), made_rig.cameras, made_rig.points, made_rig.model)
    assert np.array_equal(found.poses["right"].beta, found.poses["left"].beta)
    for side, pose in found.poses.items():
        vertices, wanted = (posed_arrays(made_rig.model, one)[0] for one in (pose, made_rig.poses[side]))
        hand = made_rig.model.arm_weights < 0.5
        assert np.linalg.norm(vertices - wanted, axis=1)[hand].mean() < 2.5e-3
        assert np.linalg.norm(found.offsets[side], axis=1).mean() < 2e-3


def test_a_landmark_that_all_views_show_elsewhere_gets_an_offset(made_rig):
    shift = np.zeros((21, 3))
    shift[9] = (0.0, 0.0, 0.004)  # the middle knuckle
    points = made_rig.points + shift
    hands = []
    for hand, own in zip(made_rig.found(), points, strict=True):
        finds = tuple(find._replace(px=made_rig.cameras[find.view].project(own)[0]) for find in hand.finds)
        hands.append(replace(hand, finds=finds, points=own))
    found = landmark_poses(hands, made_rig.cameras, points, made_rig.model)
    for offsets in found.offsets.values():
        assert offsets[9, 2] > 1e-3
        assert np.linalg.norm(offsets, axis=1).argmax() == 9


def test_targets_measure_millimetres_at_the_hand(made_rig):
    stacked = RigCameras.of(made_rig.cameras)
    targets = landmark_targets(made_rig.found(), stacked)
    landmarks = torch.as_tensor(made_rig.points, dtype=torch.float32)
    still = torch.zeros(8, 4)
    assert targets.off_mm(stacked, landmarks, still).numpy() == pytest.approx(np.zeros((16, 21)), abs=1e-3)
    nearer = landmarks + 0.003 * torch.as_tensor(made_rig.cameras[5].cam2world[:3, 0], dtype=torch.float32)
    own = targets.in_views([5])
    assert own.view.tolist() == [5, 5]
    assert own.off_mm(stacked, nearer, still).numpy() == pytest.approx(np.full((2, 21), 3.0), rel=0.2)
