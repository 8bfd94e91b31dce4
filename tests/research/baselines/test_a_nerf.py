"""A-NeRF: sizes as published, what its inputs depend on, the cutoff, and a short fit."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.evaluation.shot_renderer import ShotRenderer
from livehand.backend.geometry.bones import directions_in_bones, points_in_bones
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.posed_bones import bone_frames
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import Shot
from livehand.backend.research.baselines.a_nerf import (
    A_NERF,
    BODY_PER_HAND,
    CUTOFF,
    PUBLISHED,
    ANerfNetworks,
    ANerfSize,
    JointMlp,
    encoded_points,
    encoded_views,
    sharpness_at,
)


def test_the_networks_have_the_published_sizes(parameters):
    assert parameters(JointMlp(256, 128)) == 762_884
    assert parameters(JointMlp(128, 64)) == 242_180
    assert parameters(ANerfNetworks(PUBLISHED)) == 2 * 762_884


def test_the_inputs_are_unchanged_by_a_rigid_motion_of_hand_and_ray(hand, painted_capture):
    frames = torch.as_tensor(bone_frames(hand, painted_capture.poses[0]))
    motion = torch.eye(4, dtype=torch.float64)
    motion[:3, :3] = torch.as_tensor(axis_angle_to_matrix(np.array([0.4, -1.3, 0.2])))
    motion[:3, 3] = torch.tensor([0.3, -2.0, 1.0])
    points = 0.1 * torch.randn(7, 3, dtype=torch.float64)
    directions = torch.nn.functional.normalize(torch.randn(7, 1, 3, dtype=torch.float64), dim=-1).expand(7, 16, 3)

    def inputs(points, directions, frames):
        spots, cutoff = encoded_points(points_in_bones(points, frames), 20.0)
        return torch.cat([spots, encoded_views(directions_in_bones(directions, frames), cutoff)], 1)

    first = inputs(points, directions, frames)
    assert first.shape == (7, 288 + 432)
    moved = inputs(points @ motion[:3, :3].T + motion[:3, 3], directions @ motion[:3, :3].T, motion @ frames)
    torch.testing.assert_close(moved, first, atol=1e-9, rtol=0)


def test_the_cutoff_is_a_half_at_its_distance():
    spots = torch.zeros(3, 16, 3)
    spots[0, :, 0], spots[1, :, 1], spots[2, :, 2] = CUTOFF / BODY_PER_HAND, 0.0, 5 * CUTOFF / BODY_PER_HAND
    encoded, cutoff = encoded_points(spots, 20.0)
    torch.testing.assert_close(cutoff[0], torch.full((16,), 0.5))
    assert (cutoff[1] > 0.9999).all()
    assert (cutoff[2] < 1e-9).all()
    assert (encoded[2, :240].abs() < 1e-6).all()
    torch.testing.assert_close(encoded[2, 240:].reshape(16, 3), torch.eye(3)[2].expand(16, 3))
    assert CUTOFF / BODY_PER_HAND == pytest.approx(0.056, abs=5e-4)
    assert (sharpness_at(0.0), sharpness_at(0.5), sharpness_at(1.0)) == (20, 40, 80)


def test_a_short_fit_renders_and_refuses_other_meshes(painted_capture, hand, machine, two_steps, cpu, tmp_path):
    method = replace(A_NERF, size=ANerfSize(8, 4, 4, 2))
    fitted = method.fit(painted_capture, hand, two_steps, tmp_path, machine)
    assert fitted.steps == 2
    renderer = method.load(tmp_path, hand, cpu)
    assert isinstance(renderer, ShotRenderer)
    pose, view = painted_capture.poses[0], painted_capture.views[3]
    shot = Shot(pose, posed_vertices(hand, pose), view.camera)
    frame = renderer.render(shot)
    assert frame.rgb.shape == (32, 24, 3)
    assert np.isfinite(frame.rgb).all()
    with pytest.raises(LiveHandError, match="mm off"):
        renderer.render(replace(shot, vertices=shot.vertices + 0.01))
