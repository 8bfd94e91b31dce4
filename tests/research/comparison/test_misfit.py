"""Misfit: landmarks fitted again, the shape kept, and a smoother template."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.hand.lbs import posed_arrays, posed_vertices
from livehand.backend.motion.landmarks.skeleton import landmarks_of
from livehand.backend.research.comparison.misfit import Misfit, noisy_poses, smoothed


def vertex_rms_mm(hand, poses, truth):
    off = [posed_vertices(hand, a) - posed_vertices(hand, b) for a, b in zip(poses, truth, strict=True)]
    return 1000 * float(np.sqrt((np.stack(off) ** 2).sum(-1).mean()))


def test_landmarks_are_joints_and_fingertips(hand, painted_capture):
    pose = painted_capture.poses[0]
    points, (vertices, joints) = landmarks_of(hand, pose), posed_arrays(hand, pose)
    np.testing.assert_allclose(points[0], joints[0])
    np.testing.assert_allclose(points[5:8], joints[1:4])  # the index finger
    np.testing.assert_allclose(points[1:4], joints[13:16])  # the thumb
    assert np.abs(vertices - points[8]).sum(1).min() < 1e-12
    assert 0.01 < np.linalg.norm(points[8] - points[7]) < 0.04


@pytest.mark.parametrize("beta", [0.0, 0.7])
def test_noise_on_landmarks_moves_the_mesh_and_keeps_the_shape(hand, painted_capture, beta):
    poses = tuple(replace(pose, beta=pose.beta + beta) for pose in painted_capture.poses)
    errors = []
    for sigma_mm in (0.0, 2.0):
        found = noisy_poses(poses, hand, sigma_mm, 0)
        assert all((a.beta == b.beta).all() for a, b in zip(found, poses, strict=True))
        errors.append(vertex_rms_mm(hand, found, poses))
    assert errors[0] < 1.5  # 21 angles do not say all
    assert 1.0 < errors[1] < 6.0
    assert errors[1] > errors[0] + 0.4


def test_only_the_arm_tracking_has_noise_on_held_out_poses(hand, painted_capture):
    views = tuple(replace(v, split="train" if v.pose_index == 0 else "test") for v in painted_capture.views)
    capture = replace(painted_capture, views=views)
    case = Misfit(1.0).of(capture, hand, 0)
    assert set(case.arms) == {"training", "tracking"}
    assert (case.training.poses[0].theta != capture.poses[0].theta).any()
    assert case.training.poses[1] is capture.poses[1]
    assert (case.arms["tracking"].poses[1].theta != capture.poses[1].theta).any()
    assert case.training.provenance != capture.provenance
    assert case.vertex_mm >= 0
    shaped = Misfit("beta").of(capture, hand, 0)
    assert np.abs(shaped.training.poses[0].beta).max() > 0.3
    assert (shaped.arms["tracking"].poses[1].beta == shaped.training.poses[0].beta).all()


def test_a_smoother_hand_is_the_same_hand_with_another_surface(hand):
    smooth = smoothed(hand)
    assert smooth.sha256 == hand.sha256
    off_mm = 1000 * np.linalg.norm(smooth.v_template - hand.v_template, axis=1)
    assert 0.1 < off_mm.mean() < 4
    assert smoothed(hand, 0).v_template is hand.v_template
    assert Misfit("smooth").of is not None
